"""`coslobe eval SCENE`: render, path-trace references, compare, and write it all down."""

import csv
import io
import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device, cpu_count
from coslobe.core.files import write_json, write_text
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.errors import FORMULAS, compare, compare_by_object
from coslobe.evaluate.pictures import error_scale, write_comparison, write_error_map
from coslobe.evaluate.reference import OccluderKind, Reference, read_reference, render_references
from coslobe.evaluate.report import write_report
from coslobe.evaluate.verdicts import verdicts
from coslobe.render.assets import Assets
from coslobe.render.images import BEAUTY, read_attributes, read_exr, write_png
from coslobe.render.scene import SceneFile
from coslobe.render.sequence import render_sequence

REFERENCE_FOLDERS: dict[OccluderKind, str] = {"mesh": "reference", "spheres": "reference_spheres"}

TIMES = ("seconds", "kernel_seconds", "gbuffer_seconds")


def evaluate(
    scene_file: SceneFile,
    out_dir: Path,
    *,
    frames: Sequence[int],
    samples: int,
    device: Device,
    command: str,
    rendered: Sequence[int] | None = None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Hold `frames` against both references; write results.json, results.csv, report.html and figures/*.png.

    `rendered` are the frames to render, where these are more than the ones to compare; `command` is what
    the report says to run for the same result. Everything that is there already with the same settings is
    kept, and so are the times that it took then.

    Returns
    -------
    dict
        The JSON document of `coslobe eval` (see docs/evaluation.md).

    Raises
    ------
    CoslobeError
        A picture holds values that are not finite, or a file cannot be written.
    """
    earlier = _earlier_results(out_dir / "results.json")
    render = render_sequence(scene_file, out_dir, frames=rendered or frames, device=device, progress=progress)
    render["frames"] = [_with_times(record, earlier) for record in render["frames"]]
    assets = Assets(device, progress)
    references: dict[OccluderKind, list[dict[str, Any]]] = {
        kind: render_references(
            scene_file,
            out_dir / folder,
            frames=frames,
            occluders=kind,
            samples=samples,
            assets=assets,
            progress=progress,
        )
        for kind, folder in REFERENCE_FOLDERS.items()
    }
    records = {record["index"]: record for record in render["frames"]}
    compared = [
        _compare(scene_file, records[index], {kind: references[kind][i] for kind in references})
        for i, index in enumerate(frames)
    ]
    scales: dict[OccluderKind, float] = {
        kind: error_scale([frame.errors[kind][frame.references[kind].hit] for frame in compared])
        for kind in REFERENCE_FOLDERS
    }
    with progress.task("figures", len(compared)) as advance:
        for frame in compared:
            frame.record["pictures"] = _write_pictures(out_dir, scene_file.name, frame, scales)
            advance()
    frame_records = [frame.record for frame in compared]
    mean = _mean(frame_records)
    document = {
        "format": "coslobe-results/1",
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "scene": {
            "file": scene_file.path,
            "name": scene_file.name,
            "settings": scene_file.data,
            "image": scene_file.description.image.model_dump(),
            "shading": scene_file.description.shading.model_dump(),
        },
        "fps": scene_file.fps,
        "verdicts": [asdict(verdict) for verdict in verdicts(mean, frame_records)],
        "mean": mean,
        "frames": frame_records,
        "error_scales": scales,
        "formulas": FORMULAS,
        "render": render,
        "cpus": cpu_count(),
        "versions": json.loads((out_dir / "manifest.json").read_text())["versions"],
    }
    results = out_dir / "results.json"
    write_json(results, document)
    write_text(out_dir / "results.csv", _csv(frame_records))
    report = write_report(results)
    shown = [{key: record[key] for key in record if key != "pictures"} for record in frame_records]
    return {"results": results, "report": report, "frames": shown}


class _Frame:
    """A rendered frame, its references, and the signed errors of its pixels."""

    def __init__(self, image: NDArray, references: dict[OccluderKind, Reference]) -> None:
        self.image = image
        self.references = references
        self.errors = {kind: _signed_error(image, reference) for kind, reference in references.items()}
        self.record: dict[str, Any] = {}


def _compare(
    scene_file: SceneFile, record: dict[str, Any], made: dict[OccluderKind, dict[str, Any]]
) -> _Frame:
    index = record["index"]
    layers, _ = read_exr(record["file"])
    names = dict(enumerate(scene_file.at(index).objects))
    frame = _Frame(
        layers[BEAUTY].astype(np.float64), {kind: read_reference(made[kind]["file"]) for kind in made}
    )
    result: dict[str, Any] = {"index": index, "file": record["file"], "points": record["points"]}
    result |= {name: record[name] for name in TIMES}
    objects: dict[str, dict[str, Any]] = {}
    for kind, reference in frame.references.items():
        parts = frame.image, reference.radiance, reference.variance
        image, radiance, variance = (part[reference.hit] for part in parts)
        what = f"frame {index} ({kind})"
        whole = compare(image, radiance, variance, what)
        result |= {f"{name}_{kind}": value for name, value in asdict(whole).items() if name != "pixels"}
        result["pixels"] = whole.pixels
        result["spp"] = made[kind]["spp"]
        result[f"reference_seconds_{kind}"] = made[kind]["seconds"]
        for name, errors in compare_by_object(*parts, reference.object, names, what).items():
            values = {f"{key}_{kind}": value for key, value in asdict(errors).items() if key != "pixels"}
            objects.setdefault(name, {"pixels": errors.pixels}).update(values)
    frame.record = {**result, "objects": objects}
    return frame


def _signed_error(image: NDArray, reference: Reference) -> NDArray:
    """(I - R) / mean(R), averaged over the channels: float64 [h, w], 0 where no surface is seen."""
    scale = reference.radiance[reference.hit].mean() if reference.hit.any() else 0.0
    difference = (image - reference.radiance).mean(axis=-1)
    return np.where(reference.hit, difference / (scale or 1.0), 0.0)


def _write_pictures(
    out_dir: Path, scene: str, frame: _Frame, scales: dict[OccluderKind, float]
) -> list[dict[str, Any]]:
    """Write the frame's figures; what the report shows of them: label, file relative to `out_dir`, scale."""
    index, figures = frame.record["index"], out_dir / "figures"
    exr = Path(frame.record["file"])
    shown: list[dict[str, Any]] = [{"label": "coslobe", "file": exr.with_suffix(".png"), "scale": None}]
    captions: dict[OccluderKind, str] = {"mesh": "true meshes", "spheres": "same spheres"}
    for kind, reference in frame.references.items():
        path = figures / f"reference_{kind}.{index:04d}.png"
        write_png(path, reference.radiance)
        shown.append({"label": f"Reference, {captions[kind]}", "file": path, "scale": None})
    for kind, reference in frame.references.items():
        path = figures / f"error_{kind}.{index:04d}.png"
        write_error_map(path, frame.errors[kind], reference.hit, scales[kind])
        shown.append({"label": f"Error, {captions[kind]}", "file": path, "scale": scales[kind]})
    pictures = {"coslobe": frame.image}
    pictures |= {
        f"reference, {captions[kind]}": reference.radiance for kind, reference in frame.references.items()
    }
    maps = {
        f"error against {captions[kind]} / mean": (frame.errors[kind], reference.hit, scales[kind])
        for kind, reference in frame.references.items()
    }
    write_comparison(figures / f"comparison.{index:04d}.png", pictures, maps, f"{scene}, frame {index}")
    return [{**picture, "file": str(picture["file"].relative_to(out_dir))} for picture in shown]


def _mean(frames: Sequence[dict[str, Any]]) -> dict[str, float | None]:
    """Means over frames of every error; None where a frame has none."""
    names = [f"{name}_{kind}" for name in FORMULAS for kind in REFERENCE_FOLDERS]
    columns = {name: [frame[name] for frame in frames] for name in names}
    return {name: None if None in values else float(np.mean(values)) for name, values in columns.items()}


def _csv(frames: Sequence[dict[str, Any]]) -> str:
    """Long form for data frames: one row per frame, object ("": all), reference and metric."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(["frame", "object", "reference", "metric", "value"])
    for frame in frames:
        for name, part in {"": frame, **frame["objects"]}.items():
            for kind in REFERENCE_FOLDERS:
                for metric in FORMULAS:
                    writer.writerow([frame["index"], name, kind, metric, part[f"{metric}_{kind}"]])
        for metric in (*TIMES, "points"):
            writer.writerow([frame["index"], "", "", metric, frame[metric]])
        for kind in REFERENCE_FOLDERS:
            writer.writerow([frame["index"], "", kind, "seconds", frame[f"reference_seconds_{kind}"]])
    return text.getvalue()


def _earlier_results(path: Path) -> dict[str, dict[str, Any]]:
    """Frame records of an earlier run by the hash of their settings; nothing where there are none."""
    try:
        frames = json.loads(path.read_text())["render"]["frames"]
        return {frame["settings_sha256"]: frame for frame in frames}
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _with_times(record: dict[str, Any], earlier: dict[str, dict[str, Any]]) -> dict[str, Any]:
    """The record of a rendered frame; one that was there already gets the times of the run that made it."""
    settings = read_attributes(record["file"])["config_sha256"]
    times = {}
    if record["resumed"] and settings in earlier:
        times = {name: earlier[settings][name] for name in TIMES}
    return {**record, **times, "settings_sha256": settings}
