"""`coslobe eval SCENE`: render, path-trace references, compare, and write it all down."""

import json
from collections.abc import Sequence
from dataclasses import asdict
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from coslobe.core.device import Device, cpu_count
from coslobe.core.files import write_json, write_text
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate import metrics, split
from coslobe.evaluate.analysis import read_analysis, render_analyses
from coslobe.evaluate.comparison import KINDS, Frame, compare_frames
from coslobe.evaluate.figures import error_scales, write_figures
from coslobe.evaluate.reference import OccluderKind, read_reference, render_references
from coslobe.evaluate.report import write_report
from coslobe.evaluate.results import TIMES, long_form, mean_over_frames
from coslobe.evaluate.verdicts import verdicts
from coslobe.render.assets import Assets
from coslobe.render.images import BEAUTY, read_attributes, read_exr
from coslobe.render.scene import SceneFile
from coslobe.render.sequence import render_sequence

REFERENCE_FOLDERS: dict[OccluderKind, str] = {"mesh": "reference", "spheres": "reference_spheres"}

ANALYSIS_FOLDER = "analysis"


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
    analyses = render_analyses(
        scene_file,
        out_dir / ANALYSIS_FOLDER,
        references=[[references[kind][i]["file"] for kind in KINDS] for i in range(len(frames))],
        frames=frames,
        samples=samples,
        assets=assets,
        progress=progress,
    )
    records = {record["index"]: record for record in render["frames"]}
    compared = [
        Frame(
            index,
            read_exr(records[index]["file"])[0][BEAUTY].astype(np.float64),
            {kind: read_reference(references[kind][i]["file"]) for kind in KINDS},
            read_analysis(analyses[i]),
            dict(enumerate(scene_file.at(index).objects)),
        )
        for i, index in enumerate(frames)
    ]
    frame_records = [
        _record(records[index], {kind: references[kind][i] for kind in KINDS}, numbers)
        for i, (index, numbers) in enumerate(
            zip(frames, compare_frames(compared, out_dir / ANALYSIS_FOLDER, progress), strict=True)
        )
    ]
    scales = error_scales(compared)
    with progress.task("figures", len(compared)) as advance:
        for i, (frame, record) in enumerate(zip(compared, frame_records, strict=True)):
            exrs = {"coslobe": Path(record["file"])} | {kind: references[kind][i]["file"] for kind in KINDS}
            record["pictures"] = write_figures(out_dir, scene_file.name, frame, exrs, scales)
            advance()
    mean = mean_over_frames(frame_records)
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
        "formulas": metrics.FORMULAS | split.FORMULAS,
        "render": render,
        "cpus": cpu_count(),
        "versions": json.loads((out_dir / "manifest.json").read_text())["versions"],
    }
    results = out_dir / "results.json"
    write_json(results, document)
    write_text(out_dir / "results.csv", long_form(frame_records))
    report = write_report(results)
    shown = [{key: record[key] for key in record if key != "pictures"} for record in frame_records]
    return {"results": results, "report": report, "frames": shown}


def _record(
    rendered: dict[str, Any], made: dict[OccluderKind, dict[str, Any]], numbers: dict[str, Any]
) -> dict[str, Any]:
    """A frame's entry in the results: what was rendered, the times, and the comparison's numbers."""
    times = {name: rendered[name] for name in TIMES}
    references = {f"reference_seconds_{kind}": made[kind]["seconds"] for kind in KINDS}
    own = {name: rendered[name] for name in ("index", "file", "points")}
    return {**own, **times, **references, "spp": made["mesh"]["spp"], **numbers}


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
