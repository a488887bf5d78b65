"""What a figure of the paper is here, and what rebuilding it gives."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

from coslobe.core.files import atomic_path

if TYPE_CHECKING:
    from coslobe.evaluate.paper_figures.bench import Bench

DPI = 110


class Quantity(NamedTuple):
    """A number of a figure: ours, and the paper's where it has one.

    Attributes
    ----------
    name : str
        In words; unique within its figure.
    ours : float or None
        None where it has no value, such as a ratio to a black picture.
    paper : float or None
        What the paper states.
    form : str
        How both are written: "percent" (of a share), or a format of numbers such as ".3g".
    unit : str
    """

    name: str
    ours: float | None
    paper: float | None = None
    form: str = ".3g"
    unit: str = ""


@dataclass(frozen=True)
class Rebuilt:
    """A figure as it was rebuilt: labelled picture files, what they show in words, and numbers."""

    pictures: Sequence[tuple[str, Path]]
    text: str
    quantities: Sequence[Quantity] = ()


@dataclass(frozen=True)
class PaperFigure:
    """A figure of the paper.

    Attributes
    ----------
    number : int
    title : str
    paper : str
        What the paper shows, in our words.
    rebuild : function of (Bench, Path)
        Draws it into a folder.
    """

    number: int
    title: str
    paper: str
    rebuild: "Callable[[Bench, Path], Rebuilt]"


def new_plot(width: float = 9.0, height: float = 3.4) -> Any:
    """An empty figure, in inches."""
    from matplotlib.figure import Figure

    return Figure(figsize=(width, height), layout="constrained")


def save_plot(plot: Any, path: Path) -> Path:
    """Write it as PNG, atomically and the same at every run; returns the path."""
    with atomic_path(path) as temporary:
        plot.savefig(temporary, dpi=DPI, metadata={"Software": None})
    return path
