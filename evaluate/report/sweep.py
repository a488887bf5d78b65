"""The report of a sweep, from its results file."""

import json
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from coslobe.core.files import write_text
from coslobe.evaluate.report import embed
from coslobe.evaluate.report.page import Cell, Gallery, Page, Plot, Section, Table, Tile, html
from coslobe.evaluate.report.plots import Axis, Series, svg
from coslobe.evaluate.verdicts import Verdict, counted, duration, percent

RMSE = "relative RMSE: sqrt(mean((I − R)²)) / mean(R) over all shaded points and channels"


def write_sweep_report(results: Path) -> Path:
    """Write report.html beside a results.json of `coslobe eval --sweep`."""
    document = json.loads(results.read_text())
    page = Page(
        title=f"{document['scene']['name']}: {document['label']}",
        kind="a sweep of one parameter",
        lead=f"{len(document['summary'])} values, {counted(len(document['frames']), 'frame')} and "
        f"{counted(document['seeds'], 'seed')} on {document['device']['name'].strip()}, "
        f"against references of {document['samples']} samples.",
        tiles=_tiles(document),
        verdicts=_verdicts(document),
        sections=[*_plots(document), *_galleries(results.parent, document), _table(document)],
        command=document["command"],
        facts=_facts(document),
    )
    path = results.parent / "report.html"
    write_text(path, html(page))
    return path


def _tiles(document: Mapping[str, Any]) -> list[Tile]:
    first, last = document["summary"][0], document["summary"][-1]
    knee = "–" if document["knee"] is None else f"{document['knee']:g}"

    def change(name: str, show: Any) -> str:
        return f"from {show(first[name])} to {show(last[name])}"

    return [
        Tile("Knee", knee, "", f"of the error over {document['label']}"),
        Tile(
            "Error, same spheres",
            *_split(percent(first["own_spheres"])),
            change("own_spheres", percent),
        ),
        Tile(
            "Error, true meshes",
            *_split(percent(first["own_mesh"])),
            change("own_mesh", percent),
        ),
        Tile("Kernels", *_split(duration(first["kernel_seconds"]), " "), change("kernel_seconds", duration)),
    ]


def _split(text: str, space: str = "\N{NO-BREAK SPACE}") -> tuple[str, str]:
    value, _, unit = text.partition(space)
    return value, unit


def _verdicts(document: Mapping[str, Any]) -> list[Verdict]:
    summary, label, knee = document["summary"], document["label"], document["knee"]
    found = []
    if knee is not None:
        at = next(entry for entry in summary if entry["value"] == knee)
        text = (
            f"At {label} = {knee:g} the error is {percent(at[document['knee_of']])} and the kernels take "
            f"{duration(at['kernel_seconds'])}; there the curve bends most."
        )
        found.append(Verdict(f"The knee is at {label} = {knee:g}", "info", text))
    saved = [entry for entry in summary if entry["products_saved"]]
    if document["sweep"] == "ti" and saved:
        parts = ", ".join(f"{percent(entry['products_saved'])} at {entry['value']:g}" for entry in saved)
        text = (
            f"Of the lobe products at {label} = {summary[0]['value']:g}, thresholds save {parts}. "
            "The 2009 paper shows about 50 % in its Fig. 16 at 0.001."
        )
        found.append(Verdict("A threshold saves products", "info", text))
    return found


def _plots(document: Mapping[str, Any]) -> list[Plot]:
    summary, label = document["summary"], document["label"]
    log = summary[0]["value"] > 0 and summary[-1]["value"] / summary[0]["value"] >= 8
    shown = [entry for entry in summary if entry["value"] > 0] if summary[0]["value"] == 0 else summary
    log = log or len(shown) < len(summary)
    x = Axis(label, log=log)
    knee = [] if document["knee"] is None else [(document["knee"], f"knee: {document['knee']:g}")]

    def line(name: str, key: str, spread: str | None = None) -> Series:
        known = [entry for entry in shown if entry[key] is not None]
        notes = (
            [
                f"with noise {percent(entry[spread][0])} to {percent(entry[spread][1])} over seeds and frames"
                for entry in known
            ]
            if spread
            else []
        )
        return Series(name, [(entry["value"], entry[key]) for entry in known], notes)

    zero = ""
    if len(shown) < len(summary):
        first = summary[0]
        zero = (
            f"Not drawn: {label} = 0 with {percent(first['own_spheres'])}, "
            f"{duration(first['kernel_seconds'])} and {first['products']:.1f} products per point."
        )
    errors = svg(
        [
            line("against the same spheres", "own_spheres", "range_spheres"),
            line("against the true meshes", "own_mesh", "range_mesh"),
            line("noise of the references, taken off", "noise_spheres"),
        ],
        x,
        Axis("relative RMSE", log=True, percent=True),
        knee,
    )
    milliseconds = Series("kernels", [(entry["value"], 1000 * entry["kernel_seconds"]) for entry in shown])
    times = svg([milliseconds], x, Axis("kernels, ms per frame"), knee)
    work = svg([line("lobe products", "products"), line("mask leaves", "leaves")], x, Axis("per point"), knee)
    return [
        Plot("Error", errors, zero),
        Plot("Time", times, "Median of the kernels' times by the device's own clock."),
        Plot("Work", work),
    ]


def _galleries(folder: Path, document: Mapping[str, Any]) -> list[Section]:
    titles = {
        "pictures": f"Pictures over {document['label']}",
        "products": "Lobe products in false colours",
        "beside": "Thresholds as in Fig. 5 of the 2009 paper",
    }
    galleries: list[Section] = []
    for group, title in titles.items():
        pictures = [
            embed.png(folder / picture["file"], picture["label"], bar=picture["bar"])
            for picture in document["pictures"]
            if picture["group"] == group
        ]
        if pictures:
            galleries.append(Gallery(title, pictures))
    return galleries


def _table(document: Mapping[str, Any]) -> Table:
    rows = []
    for entry in document["summary"]:
        cells = [Cell(f"{entry['value']:g}", entry["value"])]
        for kind in ("spheres", "mesh"):
            value, noise = entry[f"relative_rmse_{kind}"], entry[f"noise_{kind}"]
            own = entry[f"own_{kind}"]
            cells += [
                Cell(percent(value), value),
                Cell(percent(noise), noise, faint=True),
                Cell("≈ 0" if own == 0 else percent(own), own),
            ]
        cells.append(Cell(duration(entry["kernel_seconds"]), entry["kernel_seconds"]))
        cells += [Cell(f"{entry[name]:.2f}", entry[name]) for name in ("products", "leaves")]
        cells.append(Cell(percent(entry["products_saved"]), entry["products_saved"]))
        rows.append(cells)
    return Table(
        title="All values",
        text="Means over seeds and frames; single runs are in results.csv.",
        groups=[("", 1), ("against the same spheres", 3), ("against the true meshes", 3), ("", 4)],
        columns=[
            document["label"],
            *("relative RMSE", "noise", "without noise") * 2,
            "kernels",
            "products per point",
            "leaves per point",
            "products saved",
        ],
        rows=rows,
        notes=[
            ("error", RMSE),
            ("noise", "what a perfect picture would show: sqrt(mean(variance of R)) / mean(R)"),
        ],
    )


def _facts(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    device = document["device"]
    return [
        ("scene", str(document["scene"]["file"])),
        ("frames", ", ".join(map(str, document["frames"]))),
        ("device", f"{device['name']} ({device['platform']}, {device['version']})"),
        ("versions", ", ".join(f"{name} {version}" for name, version in document["versions"].items())),
        ("all settings", json.dumps(document["scene"]["settings"])),
        ("made", document["made"]),
    ]
