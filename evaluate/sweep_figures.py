"""The figures of a sweep: its plot, its pictures, and lobe products in false colours (Figs 5 and 16)."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from numpy.typing import NDArray

from coslobe.core.files import atomic_path
from coslobe.evaluate.pictures import HEAT_COLOURS, write_heat_map
from coslobe.render.images import write_png

if TYPE_CHECKING:
    from coslobe.evaluate.sweeps import Shot


def write_pictures(
    out_dir: Path, name: str, shots: "Sequence[Shot]", knee: float | None, beside: Mapping[str, NDArray]
) -> list[dict[str, Any]]:
    """Write pictures and false colours at the ends and the knee, and pictures `beside` them by label.

    Returns what the report shows: label, file relative to `out_dir`, bar, and group.
    """
    known = sorted({shot.row["value"] for shot in shots})
    values = {known[0], known[len(known) // 2] if knee is None else knee, known[-1]}
    shown = []
    for shot in shots:
        value, frame = shot.row["value"], shot.row["frame"]
        if value not in values:
            continue
        stem = f"{name}_{value:g}.{frame:04d}.png"
        picture = out_dir / "figures" / f"sweep_{stem}"
        write_png(picture, shot.radiance)
        label = f"{value:g}, frame {frame}"
        shown.append({"label": label, "file": picture, "bar": None, "group": "pictures"})
        first = next(other for other in shots if other.row["frame"] == frame)  # of the smallest value
        most = float(first.products.max())
        if most == 0:
            continue
        path = out_dir / "figures" / f"products_{stem}"
        write_heat_map(path, shot.products, most)
        share = shot.row["products"] / first.row["products"]
        text = f"{label}: {shot.row['products']:.1f} products per point, {100 * share:.0f} %"
        bar = {"colours": HEAT_COLOURS, "ticks": ["0", f"{most:.0f}"], "note": "lobe products per point"}
        shown.append({"label": text, "file": path, "bar": bar, "group": "products"})
    for i, (label, radiance) in enumerate(beside.items()):
        path = out_dir / "figures" / f"beside.{i:04d}.png"
        write_png(path, radiance)
        shown.append({"label": label, "file": path, "bar": None, "group": "beside"})
    return [{**picture, "file": str(picture["file"].relative_to(out_dir))} for picture in shown]


def write_plot(path: Path, document: Mapping[str, Any]) -> None:
    """Errors, kernel time, and products with leaves over the parameter, as one figure for papers."""
    from matplotlib.figure import Figure

    summary = document["summary"]
    figure = Figure(figsize=(11, 3.4), layout="constrained")
    errors, times, work = figure.subplots(1, 3)
    for axes, lines in (
        (
            errors,
            (
                ("own_spheres", "same spheres"),
                ("own_mesh", "true meshes"),
                ("noise_spheres", "noise"),
            ),
        ),
        (times, (("kernel_seconds", "kernels"),)),
        (work, (("products", "products"), ("leaves", "leaves"))),
    ):
        for key, label in lines:
            points = [(entry["value"], entry[key]) for entry in summary if entry[key]]
            axes.plot(*zip(*points, strict=True), marker="o", label=label) if points else None
        if document["knee"] is not None:
            axes.axvline(document["knee"], color="0.5", linestyle="--", label="knee")
        smallest = min((entry["value"] for entry in summary if entry["value"] > 0), default=1.0)
        axes.set_xscale("symlog", linthresh=smallest) if summary[0]["value"] == 0 else axes.set_xscale("log")
        axes.set_xlabel(document["label"])
        axes.legend()
    errors.set_yscale("log")
    errors.set_ylabel("relative RMSE")
    times.set_ylabel("seconds per frame")
    work.set_ylabel("per point")
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150)
