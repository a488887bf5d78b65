"""One self-contained HTML page from a results file: it opens without a network and holds its pictures."""

import base64
import io
import json
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

from coslobe.core.files import write_text
from coslobe.evaluate.errors import within_noise
from coslobe.evaluate.pictures import COLOURS
from coslobe.evaluate.verdicts import duration, percent

GRADES = {"good": "good", "fair": "fair", "poor": "poor", "info": ""}

FILM_QUALITY = 88  # JPEG; the frames that are compared are shown without loss


def write_report(results: Path) -> Path:
    """Write report.html beside a results.json of `coslobe eval`, from it and the pictures that it names.

    All texts are escaped, and the page's policy forbids it to load anything.
    """
    from jinja2 import Environment, StrictUndefined
    from markupsafe import Markup

    document = json.loads(results.read_text())
    folder = results.parent
    environment = Environment(
        autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    page = environment.from_string(_resource("report.html")).render(
        style=Markup(_resource("report.css")),
        script=Markup(_resource("report.js")),
        title=document["scene"]["name"],
        lead=_lead(document),
        tiles=_tiles(document),
        verdicts=document["verdicts"],
        grades=GRADES,
        colours=", ".join(COLOURS),
        frames=[
            {
                "index": frame["index"],
                "pictures": [_picture(folder, picture) for picture in frame["pictures"]],
            }
            for frame in document["frames"]
        ],
        film=_film(document["render"]["frames"]),
        fps=document["fps"],
        tables=[_error_table(document), _time_table(document)],
        command=document["command"],
        facts=_facts(document),
    )
    path = folder / "report.html"
    write_text(path, page)
    return path


def _resource(name: str) -> str:
    return (files("coslobe.evaluate.report") / name).read_text(encoding="utf-8")


def _lead(document: dict[str, Any]) -> str:
    compared, rendered = len(document["frames"]), len(document["render"]["frames"])
    return (
        f"{_counted(rendered, 'frame')} rendered on {document['render']['device']['name'].strip()}; "
        f"{compared} of them held against references of {document['frames'][0]['spp']} samples per pixel."
    )


def _counted(n: int, what: str) -> str:
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def _tiles(document: dict[str, Any]) -> list[dict[str, str]]:
    mean = document["mean"]
    rates = [
        frame["points"] / frame["kernel_seconds"]
        for frame in document["render"]["frames"]
        if frame["kernel_seconds"]
    ]
    kernels = [frame["kernel_seconds"] for frame in document["render"]["frames"] if frame["kernel_seconds"]]
    speed = f"{sorted(rates)[len(rates) // 2] / 1e6:.3g}" if rates else "–"
    return [
        _tile("Error, same spheres", mean["relative_rmse_spheres"], "the light integration alone"),
        _tile("Error, true meshes", mean["relative_rmse_mesh"], "with spheres in place of meshes"),
        _tile("Noise of the reference", mean["noise_spheres"], "errors below it cannot be seen"),
        {
            "name": "Shading speed",
            "value": speed,
            "unit": "Mpoints/s",
            "note": f"median frame: {duration(sorted(kernels)[len(kernels) // 2])}"
            if kernels
            else "not timed",
        },
    ]


def _tile(name: str, share: float | None, note: str) -> dict[str, str]:
    value, _, unit = percent(share).partition("\N{NO-BREAK SPACE}")
    return {"name": name, "value": value, "unit": unit, "note": note}


def _picture(folder: Path, picture: dict[str, Any]) -> dict[str, Any]:
    from PIL import Image

    data = (folder / picture["file"]).read_bytes()
    with Image.open(io.BytesIO(data)) as image:
        width, height = image.size
    scale = percent(picture["scale"]) if picture["scale"] else None
    return {
        "label": picture["label"],
        "scale": scale,
        "data": _data("png", data),
        "width": width,
        "height": height,
    }


def _film(frames: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """All rendered frames as small files, where there is more than one."""
    from PIL import Image

    film = []
    for frame in frames if len(frames) > 1 else ():
        with Image.open(Path(frame["file"]).with_suffix(".png")) as image:
            buffer = io.BytesIO()
            image.save(buffer, "JPEG", quality=FILM_QUALITY)
            width, height = image.size
        data = _data("jpeg", buffer.getvalue())
        film.append({"index": frame["index"], "data": data, "width": width, "height": height})
    return film


def _data(kind: str, content: bytes) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def _error_table(document: dict[str, Any]) -> dict[str, Any]:
    rows = []
    for frame in document["frames"]:
        rows.append(_error_row(f"Frame {frame['index']}", frame, strong=True))
        rows += [_error_row(name, part, strong=False) for name, part in frame["objects"].items()]
    return {
        "title": "Errors",
        "text": "≈ marks a difference that is no larger than the reference's own noise.",
        "groups": [("", 2), ("against the same spheres", 3), ("against the true meshes", 5)],
        "columns": [
            "",
            "pixels",
            "relative RMSE",
            "noise",
            "bias",
            "relative RMSE",
            "noise",
            "bias",
            "mean |error|",
            "largest",
        ],
        "rows": rows,
        "notes": [
            ("relative RMSE", document["formulas"]["relative_rmse"]),
            ("mean |error|", document["formulas"]["mean_abs"]),
            ("bias", document["formulas"]["bias"]),
            ("largest", document["formulas"]["max_abs"]),
            ("noise", document["formulas"]["noise"]),
            ("I, R", "picture and reference, linear, over all channels of the pixels that show a surface"),
        ],
    }


def _error_row(name: str, part: dict[str, Any], *, strong: bool) -> dict[str, Any]:
    def rmse(kind: str) -> str:
        value, noise = part[f"relative_rmse_{kind}"], part[f"noise_{kind}"]
        return ("≈ " if within_noise(value, noise) else "") + percent(value)

    cells = [
        name,
        f"{part['pixels']:,}",
        rmse("spheres"),
        percent(part["noise_spheres"]),
        percent(part["bias_spheres"]),
        rmse("mesh"),
        percent(part["noise_mesh"]),
        percent(part["bias_mesh"]),
        percent(part["mean_abs_mesh"]),
        percent(part["max_abs_mesh"]),
    ]
    return {"cells": cells, "strong": strong}


def _time_table(document: dict[str, Any]) -> dict[str, Any]:
    rows = []
    for frame in document["frames"]:
        kernel = frame["kernel_seconds"]
        rate = f"{frame['points'] / kernel / 1e6:.3g}" if kernel else "–"
        cells = [
            f"Frame {frame['index']}",
            f"{frame['points']:,}",
            duration(kernel),
            rate,
            duration(frame["gbuffer_seconds"]),
            duration(frame["seconds"]),
            duration(frame["reference_seconds_spheres"]),
            duration(frame["reference_seconds_mesh"]),
        ]
        rows.append({"cells": cells, "strong": False})
    return {
        "title": "Times",
        "text": "What was there already keeps the time that it took when it was made.",
        "groups": [("", 2), ("rendering", 4), ("references", 2)],
        "columns": [
            "",
            "points",
            "light kernels",
            "Mpoints/s",
            "visibility",
            "whole frame",
            "same spheres",
            "true meshes",
        ],
        "rows": rows,
        "notes": [
            ("light kernels", "all kernels of the frame by the device's own clock, without transfers"),
            ("visibility", "which points the camera sees, by Embree on the host"),
            ("whole frame", "everything, writing the files included"),
        ],
    }


def _facts(document: dict[str, Any]) -> list[tuple[str, str]]:
    device, image, shading = (
        document["render"]["device"],
        document["scene"]["image"],
        document["scene"]["shading"],
    )
    mask = shading["mask"]
    samples = _counted(image["samples"], "sample")
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
        ("made", document["made"]),
    ]
