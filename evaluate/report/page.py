"""A self-contained HTML page from data: key numbers, verdicts, pictures to compare, plots, tables, facts.

All texts are escaped, and the page's policy forbids it to load anything.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from importlib.resources import files
from typing import Any

from coslobe.evaluate.verdicts import Verdict

GRADES = {"good": "good", "fair": "fair", "poor": "poor", "info": ""}


@dataclass(frozen=True)
class Tile:
    """A key number: its name, its value with a unit, and a line on what it means."""

    name: str
    value: str
    unit: str
    note: str


@dataclass(frozen=True)
class Picture:
    """A picture of a viewer or a card of its own.

    Attributes
    ----------
    label : str
    data : str
        The picture as data URL.
    width, height : int
        In pixels.
    radiance : str or None
        The same in full range, as `embed.radiance` packs it.
    bar : dict or None
        A map's colour bar: colours, ticks and note.
    """

    label: str
    data: str
    width: int
    height: int
    radiance: str | None = None
    bar: dict[str, Any] | None = None


@dataclass(frozen=True)
class Viewer:
    """Pictures of one size, any two of them to compare; maps stand beside them as cards."""

    title: str
    pictures: Sequence[Picture]
    text: str = ""
    kind = "viewer"


@dataclass(frozen=True)
class Gallery:
    """Pictures side by side, with nothing to compare."""

    title: str
    pictures: Sequence[Picture]
    text: str = ""
    kind = "gallery"


@dataclass(frozen=True)
class Film:
    """The frames of a sequence as pictures in order, labelled by frame number."""

    title: str
    pictures: Sequence[Picture]
    fps: float
    kind = "film"


@dataclass(frozen=True)
class Plot:
    """A plot as inline SVG text from `plots.svg`."""

    title: str
    svg: str
    text: str = ""
    kind = "plot"


@dataclass(frozen=True)
class Cell:
    """A table's cell: the text, what it is sorted by (None: the text), and whether it stands out."""

    text: str
    value: float | None = None
    faint: bool = False

    @property
    def words(self) -> bool:
        """Whether it is text rather than a number."""
        return self.value is None and self.text != "–"


@dataclass(frozen=True)
class Table:
    """A table that sorts by any column.

    Attributes
    ----------
    columns : sequence of str
    rows : sequence of sequences of Cell or str
    groups : sequence of (name, span)
        Headings above the columns; may be empty.
    notes : sequence of (name, text)
        Below the table.
    strong : set of int
        Rows that stand out.
    """

    title: str
    columns: Sequence[str]
    rows: Sequence[Sequence[Cell | str]]
    text: str = ""
    groups: Sequence[tuple[str, int]] = ()
    notes: Sequence[tuple[str, str]] = ()
    strong: frozenset[int] = frozenset()
    kind = "table"

    @property
    def cells(self) -> list[list[Cell]]:
        """The rows, all of cells."""
        return [[cell if isinstance(cell, Cell) else Cell(cell) for cell in row] for row in self.rows]


@dataclass(frozen=True)
class Figure:
    """Pictures with what they show elsewhere and here, and the numbers of both.

    Attributes
    ----------
    paper, ours : str
        What the paper shows, and what is seen here.
    rows : sequence of (quantity, paper's, ours)
    seconds : str
        How long it took, in words.
    """

    title: str
    pictures: Sequence[Picture]
    paper: str
    ours: str
    rows: Sequence[tuple[str, Cell, Cell]]
    seconds: str
    kind = "figure"


Section = Viewer | Gallery | Film | Plot | Table | Figure


@dataclass(frozen=True)
class Page:
    """All that a report shows, in the order in which it does."""

    title: str
    kind: str
    lead: str
    sections: Sequence[Section]
    command: str
    facts: Sequence[tuple[str, str]]
    tiles: Sequence[Tile] = ()
    verdicts: Sequence[Verdict] = field(default_factory=tuple)


def html(page: Page) -> str:
    """The page as one HTML document."""
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    environment.filters["svg"] = Markup  # made by `plots.svg`, which escapes its texts
    scripts = (_resource(name) for name in ("viewer.js", "report.js"))
    return environment.from_string(_resource("report.html")).render(
        style=Markup(_resource("report.css")), script=Markup("\n".join(scripts)), page=page, grades=GRADES
    )


def _resource(name: str) -> str:
    return (files("coslobe.evaluate.report") / name).read_text(encoding="utf-8")
