"""The report of `coslobe eval SCENE`, from its results file and the pictures that it names."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from coslobe.core.files import write_text
from coslobe.evaluate.report import embed
from coslobe.evaluate.report.page import Film, Page, Picture, Section, Table, Tile, Viewer, html
from coslobe.evaluate.report.tables import error_table, metric_table, skip_table, split_table, time_table
from coslobe.evaluate.verdicts import Verdict, counted, duration, percent


def write_report(results: Path) -> Path:
    """Write report.html beside a results.json of `coslobe eval`."""
    document = json.loads(results.read_text())
    folder = results.parent
    frames = document["frames"]
    sections: list[Section] = [*_film(document)]
    sections += [
        Viewer(
            f"Frame {frame['index']} against its references",
            [_picture(folder, picture) for picture in frame["pictures"]],
        )
        for frame in frames
    ]
    sections += [*_tables(document)]
    page = Page(
        title=document["scene"]["name"],
        kind="measured against path-traced references",
        lead=_lead(document),
        tiles=_tiles(document),
        verdicts=[Verdict(**verdict) for verdict in document["verdicts"]],
        sections=sections,
        command=document["command"],
        facts=_facts(document),
    )
    path = folder / "report.html"
    write_text(path, html(page))
    return path


def _tables(document: Mapping[str, Any]) -> Sequence[Table]:
    formulas, frames = document["formulas"], document["frames"]
    skipped = document["render"]["skipped"]  # empty where all frames were there already
    return (
        error_table(frames, formulas),
        split_table(frames, formulas),
        metric_table(frames, formulas),
        time_table(frames),
        *([skip_table(skipped)] if skipped else []),
    )


def _lead(document: Mapping[str, Any]) -> str:
    compared, rendered = len(document["frames"]), len(document["render"]["frames"])
    return (
        f"{counted(rendered, 'frame')} rendered on {document['render']['device']['name'].strip()}; "
        f"{compared} of them held against references of {document['frames'][0]['spp']} samples per pixel."
    )


def _tiles(document: Mapping[str, Any]) -> list[Tile]:
    mean = document["mean"]
    timed = [frame for frame in document["render"]["frames"] if frame["kernel_seconds"]]
    kernels = sorted(frame["kernel_seconds"] for frame in timed)
    rates = sorted(frame["points"] / frame["kernel_seconds"] for frame in timed)
    speed, note = "–", "not timed"
    if timed:
        speed = f"{rates[len(rates) // 2] / 1e6:.3g}"
        note = f"median frame: {duration(kernels[len(kernels) // 2])}"
    return [
        _tile("Error, same spheres", mean["relative_rmse_spheres"], "the light integration alone"),
        _tile("Error, true meshes", mean["relative_rmse_mesh"], "with spheres in place of meshes"),
        _tile("Noise of the reference", mean["noise_spheres"], "errors below it cannot be seen"),
        Tile("Shading speed", speed, "Mpoints/s", note),
    ]


def _tile(name: str, share: float | None, note: str) -> Tile:
    value, _, unit = percent(share).partition("\N{NO-BREAK SPACE}")
    return Tile(name, value, unit, note)


def _picture(folder: Path, picture: Mapping[str, Any]) -> Picture:
    exr = None if picture["exr"] is None else folder / picture["exr"]
    return embed.png(folder / picture["file"], picture["label"], exr=exr, bar=picture["bar"])


def _film(document: Mapping[str, Any]) -> list[Film]:
    """All rendered frames, where there is more than one."""
    frames = document["render"]["frames"]
    if len(frames) < 2:
        return []
    pictures = [embed.jpeg(Path(frame["file"]).with_suffix(".png"), str(frame["index"])) for frame in frames]
    return [Film("The sequence", pictures, document["fps"])]


def _facts(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    device, image, shading = (
        document["render"]["device"],
        document["scene"]["image"],
        document["scene"]["shading"],
    )
    mask = shading["mask"]
    samples = counted(image["samples"], "sample")
    return [
        ("scene", str(document["scene"]["file"])),
        ("image", f"{image['width']} × {image['height']}, {samples} per pixel"),
        (
            "shading",
            f"{shading['method']}, {shading['estimator']} estimator, mask depth {mask['depth']} "
            f"({mask['mode']}), threshold {shading['threshold']:g}",
        ),
        ("device", f"{device['name']} ({device['platform']}, {device['version']})"),
        ("CPUs used by the reference", str(document["cpus"])),
        ("versions", ", ".join(f"{name} {version}" for name, version in document["versions"].items())),
        ("all settings", json.dumps(document["scene"]["settings"])),
        ("made", document["made"]),
    ]
