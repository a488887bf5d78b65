"""The page and the plots of `coslobe eval --pareto`."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coslobe.core.files import atomic_path, write_text
from coslobe.evaluate.fronts import front
from coslobe.evaluate.report.page import Cell, Page, Plot, Table, Tile, html
from coslobe.evaluate.report.plots import Axis, Series, svg
from coslobe.evaluate.verdicts import duration, percent

Row = Mapping[str, Any]

RIVALS = {"embree": "Embree", "mitsuba": "Mitsuba 3"}
COLOURS = {"embree": "#2f6db3", "mitsuba": "#5f8f3c", "coslobe": "#b4471b"}
SHADES = ("#b4471b", "#e0a03c", "#8a5aa8", "#4d4d4d")  # one per device


def write_pareto_report(results: Path) -> Path:
    """Write report.html and figures/*.png beside a results.json of `measure_fronts`."""
    document = json.loads(results.read_text())
    plots = []
    for material in dict.fromkeys(row["material"] for row in document["rows"]):
        rows = [row for row in document["rows"] if row["material"] == material]
        noise = document["noise"][material]
        _plot(results.parent / "figures" / f"fronts.{material.replace(' ', '_')}.png", rows, noise)
        axes = (
            Axis("nanoseconds per point", log=True),
            Axis("relative RMSE, true meshes", log=True, percent=True),
        )
        text = f"Lower left is better. The noise of the reference is {percent(noise)}."
        plots.append(Plot(f"Error against time: {material}", svg(_series(rows), *axes), text))
    page = Page(
        title=f"{Path(document['scene']['file']).stem}: error against time",
        kind="error against time, beside ray tracers",
        lead=f"{document['points']:,} points, lit by coslobe and by ray tracers on the true meshes.",
        tiles=_tiles(document["speedups"]),
        sections=[*plots, _speedup_table(document["speedups"]), _row_table(document["rows"])],
        command=document["command"],
        facts=_facts(document),
    )
    path = results.parent / "report.html"
    write_text(path, html(page))
    return path


def _series(rows: Sequence[Row]) -> list[Series]:
    """The rivals' settings joined; of each device and estimator all settings, and the front of the best."""
    found = []
    for rival, label in RIVALS.items():
        own = sorted((row for row in rows if row["renderer"] == rival), key=_nanoseconds)
        found.append(_line(label, own))
    ours = [row for row in rows if row["renderer"] == "coslobe"]
    for device, estimator in dict.fromkeys((row["device"], row["setting"]["estimator"]) for row in ours):
        own = [row for row in ours if (row["device"], row["setting"]["estimator"]) == (device, estimator)]
        best = set(front([_point(row) for row in own]))
        found.append(
            _line(f"coslobe, {estimator}, {device}: front", [row for row in own if _point(row) in best])
        )
        found.append(_line(f"coslobe, {estimator}, {device}", own, joined=False))
    return [series for series in found if series.points]


def _line(name: str, rows: Sequence[Row], *, joined: bool = True) -> Series:
    rows = sorted(rows, key=_nanoseconds)
    points = [(_nanoseconds(row), row["relative_rmse_mesh"]) for row in rows]
    return Series(name, points, [setting_text(row) for row in rows], joined)


def _point(row: Row) -> tuple[float, float]:
    return row["relative_rmse_mesh"], _nanoseconds(row)


def _tiles(speedups: Sequence[Row]) -> list[Tile]:
    """The best speed-up over each rival with each material."""
    best: dict[tuple[str, str], Row] = {}
    for found in speedups:
        key = (found["material"], found["against"])
        if key not in best or found["speedup"] > best[key]["speedup"]:
            best[key] = found
    return [
        Tile(
            f"over {RIVALS[rival]}, {material}",
            f"{found['speedup']:.0f}",
            "times",
            f"at {percent(found['at_error'])} error, {found['spheres']} spheres",
        )
        for (material, rival), found in best.items()
    ]


def setting_text(row: Row) -> str:
    """The setting of a row in words."""
    setting = row["setting"]
    if row["renderer"] == "coslobe":
        return f"{setting['estimator']}, depth {setting['depth']}, {setting['spheres']} spheres"
    return ", ".join(f"{count} {name} per point" for name, count in setting.items())


def _speedup_table(speedups: Sequence[Row]) -> Table:
    return Table(
        title="Speed-up at equal error",
        text="Of each number of spheres, the setting that gains most. * The rival's front was continued "
        "to this error with the slope of independent samples, error halved in four times the time.",
        columns=["material", "against", "spheres", "setting", "error", "speed-up", "device"],
        rows=[
            [
                found["material"],
                RIVALS[found["against"]],
                Cell(str(found["spheres"]), found["spheres"]),
                f"{found['setting']['estimator']}, depth {found['setting']['depth']}",
                Cell(percent(found["at_error"]), found["at_error"]),
                Cell(f"{found['speedup']:.3g}×" + ("*" if found["extrapolated"] else ""), found["speedup"]),
                found["device"],
            ]
            for found in speedups
        ],
    )


def _row_table(rows: Sequence[Row]) -> Table:
    errors = ("relative_rmse_mesh", "relative_rmse_mesh_no_contact", "relative_rmse_spheres")
    return Table(
        title="All measurements",
        text="Medians of several runs. Kernels by the device's own clock; of Embree only the tracing; of "
        "Mitsuba the render less one that casts only the primary rays. Errors are relative RMSE.",
        columns=[
            *("renderer", "material", "setting", "time", "Mpoints/s"),
            *("error, meshes", "without contact", "error, same spheres"),
        ],
        rows=[
            [
                row["renderer"],
                row["material"],
                setting_text(row),
                Cell(duration(row["seconds"]), row["seconds"]),
                Cell(f"{row['points'] / row['seconds'] / 1e6:.3g}", row["points"] / row["seconds"]),
                *(Cell(percent(row[name]), row[name]) for name in errors),
            ]
            for row in rows
        ],
    )


def _facts(document: Row) -> list[tuple[str, str]]:
    noise = ", ".join(f"{name} {percent(value)}" for name, value in document["noise"].items())
    return [
        ("scene", f"{document['scene']['file']}, frame {document['scene']['frame']}"),
        ("points whose errors are known", f"{document['known_points']:,}"),
        ("noise of the references", noise),
        ("processor", f"{document['processor']}, {document['cpus']} cores used"),
        ("load when it began", f"{document['load_average']:.2f}"),
        *((f"device {d['index']}", f"{d['name']} ({d['version']})") for d in document["devices"]),
        ("versions", ", ".join(f"{name} {version}" for name, version in document["versions"].items())),
        ("coslobe", f"{document['version']}, commit {document['commit'] or 'unknown'}"),
        ("made", document["made"]),
        *(("note", note) for note in document["notes"]),
    ]


def _plot(path: Path, rows: Sequence[Row], noise: float) -> None:
    """Error against time per point: the rivals' settings joined, coslobe's as dots over their front."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 5), layout="constrained")
    axes = figure.add_subplot()
    for rival, label in RIVALS.items():
        points = [(row["relative_rmse_mesh"], _nanoseconds(row)) for row in rows if row["renderer"] == rival]
        if points:
            errors, times = zip(*sorted(points, key=lambda point: point[1]), strict=True)
            axes.plot(times, errors, "o-", color=COLOURS[rival], label=label, markersize=4)
    devices = list(dict.fromkeys(row["device"] for row in rows if row["renderer"] == "coslobe"))
    for device, colour in zip(devices, SHADES * len(devices), strict=False):
        for estimator, marker in (("accurate", "o"), ("paper", "x")):
            points = [
                (row["relative_rmse_mesh"], _nanoseconds(row))
                for row in rows
                if row["device"] == device and row["setting"].get("estimator") == estimator
            ]
            if points:
                errors, times = zip(*points, strict=True)
                label = f"coslobe, {estimator}, {device}"
                axes.scatter(times, errors, s=18, marker=marker, color=colour, alpha=0.75, label=label)
                if estimator == "accurate":
                    errors, times = zip(*front(points), strict=True)
                    axes.plot(times, errors, color=colour, linewidth=1)
    axes.axhline(noise, color="#999999", linestyle=":", linewidth=1, label="noise of the reference")
    axes.set(xscale="log", yscale="log", xlabel="nanoseconds per point", ylabel="relative RMSE, true meshes")
    axes.grid(which="both", linewidth=0.3)
    axes.legend(fontsize=8)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=140)


def _nanoseconds(row: Row) -> float:
    return row["seconds"] / row["points"] * 1e9
