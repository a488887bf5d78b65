"""The figures of an evaluation as files: references, error maps, parts of errors, zones."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from coslobe.evaluate.comparison import KINDS, Frame
from coslobe.evaluate.pictures import (
    COLOURS,
    SHARE_COLOURS,
    error_scale,
    write_comparison,
    write_error_map,
    write_share_map,
)
from coslobe.evaluate.reference import OccluderKind
from coslobe.render.images import write_png

CAPTIONS: dict[OccluderKind, str] = {"mesh": "true meshes", "spheres": "same spheres"}

SIGNED = "blue: too dark, orange: too bright, in units of the reference's mean"

Scales = dict[str, float]


def error_scales(frames: Sequence[Frame]) -> Scales:
    """The ends of the colour scales for all frames, by reference and by part of the error."""
    scales: Scales = {
        kind: error_scale([frame.signed_error(kind)[frame.hit] for frame in frames]) for kind in KINDS
    }
    return scales | {"geometry": scales["mesh"], "visibility": scales["spheres"], "lobes": scales["spheres"]}


def write_figures(
    out_dir: Path, scene: str, frame: Frame, exrs: Mapping[str, Path], scales: Scales
) -> list[dict[str, Any]]:
    """Write the frame's figures; what a report shows of them, files relative to `out_dir`.

    `exrs` are the files of the pictures in full range: of "coslobe" and of each reference.

    Returns
    -------
    list of dict
        label, file, exr (or None), and bar: colours, ticks and note of a map's colour bar (or None).
    """
    index, figures = frame.index, out_dir / "figures"
    shown: list[dict[str, Any]] = [_shown("coslobe", exrs["coslobe"].with_suffix(".png"), exrs["coslobe"])]
    for kind, reference in frame.references.items():
        path = figures / f"reference_{kind}.{index:04d}.png"
        write_png(path, reference.radiance)
        shown.append(_shown(f"Reference, {CAPTIONS[kind]}", path, exrs[kind]))
    for kind in KINDS:
        path = figures / f"error_{kind}.{index:04d}.png"
        write_error_map(path, frame.signed_error(kind), frame.hit, scales[kind])
        shown.append(_shown(f"Error, {CAPTIONS[kind]}", path, bar=_signed_bar(scales[kind])))
    path = figures / f"zones.{index:04d}.png"
    write_share_map(path, frame.analysis.share, frame.hit)
    bar = {
        "colours": SHARE_COLOURS,
        "ticks": ["umbra", "penumbra", "lit"],
        "note": "share of light that arrives",
    }
    shown.append(_shown("Zones", path, bar=bar))
    for name, part in frame.split().maps.items():
        path = figures / f"part_{name}.{index:04d}.png"
        write_error_map(path, frame.relative(part), frame.hit, scales[name])
        shown.append(_shown(f"Part: {name}", path, bar=_signed_bar(scales[name])))
    _write_comparison(figures / f"comparison.{index:04d}.png", scene, frame, scales)
    return [
        {**picture, **{key: _relative(picture[key], out_dir) for key in ("file", "exr")}} for picture in shown
    ]


def _shown(
    label: str, file: Path, exr: Path | None = None, bar: dict[str, Any] | None = None
) -> dict[str, Any]:
    return {"label": label, "file": file, "exr": exr, "bar": bar}


def _relative(path: Path | None, folder: Path) -> str | None:
    return None if path is None else str(path.relative_to(folder))


def _signed_bar(scale: float) -> dict[str, Any]:
    ends = f"{100 * scale:.3g}\N{NO-BREAK SPACE}%"
    return {"colours": COLOURS, "ticks": [f"−{ends}", "0", f"+{ends}"], "note": SIGNED}


def _write_comparison(path: Path, scene: str, frame: Frame, scales: Scales) -> None:
    pictures: dict[str, NDArray] = {"coslobe": frame.image}
    pictures |= {f"reference, {CAPTIONS[kind]}": frame.references[kind].radiance for kind in KINDS}
    maps = {
        f"error against {CAPTIONS[kind]} / mean": (frame.signed_error(kind), frame.hit, scales[kind])
        for kind in KINDS
    }
    write_comparison(path, pictures, maps, f"{scene}, frame {frame.index}")
