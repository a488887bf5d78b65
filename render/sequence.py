"""Frames in order: rendering what is not there yet, and what is written beside the pictures.

How light is computed is the business of a lighting method; here it is only called.
"""

import json
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any

from coslobe.core.device import Device
from coslobe.core.errors import CoslobeError
from coslobe.core.files import remove_leftovers, write_json
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import library_versions
from coslobe.render.assets import Assets
from coslobe.render.frames import FrameRenderer, FrameTimes
from coslobe.render.plan import PlannedFrame, check_layers, plan_frames
from coslobe.render.scene import SceneFile
from coslobe.render.video import find_ffmpeg, write_video


def render_sequence(
    scene_file: SceneFile,
    out_dir: Path,
    *,
    frames: Sequence[int],
    device: Device,
    layers: Sequence[str] = (),
    resume: bool = True,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Render `frames` into `out_dir`: frames/beauty.0000.exr and .png, manifest.json, sequence.mp4.

    A frame that is there with the same settings is left as it is (unless `resume` is off). An interruption
    leaves the finished frames and a manifest of them.

    Returns
    -------
    dict
        The JSON document of `coslobe render` (see docs/commands.md).

    Raises
    ------
    InvalidInput
        The scene is wrong at one of the frames, or a file that it names cannot be used.
    CoslobeError
        A picture cannot be written, or would hold NaN or infinite values.
    """
    layers = check_layers(layers)
    folder = out_dir / "frames"
    assets = Assets(device, progress)
    plan = plan_frames(
        scene_file, folder, frames, device=device.info, layers=layers, resume=resume, assets=assets
    )
    renderer = FrameRenderer(scene_file, assets, device, layers)
    pending = [planned for planned in plan if not planned.done]
    with _tidy(folder):
        try:
            if pending:
                renderer.prepare(pending[0].index, progress)
            with progress.task("rendering", len(plan)) as advance:
                if len(pending) < len(plan):
                    advance(len(plan) - len(pending))
                with closing(renderer.render(pending)) as rendering:
                    start = time.perf_counter()
                    for count in rendering:
                        speed = len(renderer.finished) / (time.perf_counter() - start)
                        advance(count, f"{speed:.1f} frames/s")
        finally:
            records = _records(plan, renderer.finished)
            if records:
                _write_manifest(out_dir, scene_file, assets, device, layers, plan, records)
        if len(plan) > 1:
            _write_video(out_dir / "sequence.mp4", plan, scene_file.fps, progress)
    return {
        "frames": _records(plan, renderer.finished),
        "device": device.describe(),
        "build_seconds": renderer.build_seconds,
        "skipped": renderer.skipped,
    }


@contextmanager
def _tidy(frames: Path) -> Iterator[None]:
    """Make the folder; keep it and the one above free of temporary files, before (of a killed run) and after.

    A signal can arrive at moments when the writer of a file has no chance to remove its own.
    """

    def clean() -> None:
        for folder in (frames.parent, frames):
            remove_leftovers(folder)

    try:
        frames.mkdir(parents=True, exist_ok=True)
        clean()
    except OSError as error:
        message = f"{frames}: cannot be written ({error.strerror})"
        raise CoslobeError(message, "choose another folder with -o") from error
    try:
        yield
    finally:
        clean()


def _records(plan: Sequence[PlannedFrame], finished: Mapping[int, FrameTimes]) -> list[dict[str, Any]]:
    """The entries of the JSON document, in order, up to the first frame that is missing.

    A frame that was there already has no times.
    """
    records = []
    for planned in plan:
        if not planned.done and planned.index not in finished:
            break
        times = dict.fromkeys(("kernel_seconds", "gbuffer_seconds", "seconds"))
        known = {"points": planned.points, **times} if planned.done else vars(finished[planned.index])
        file = {"index": planned.index, "file": planned.exr}
        records.append({**file, **known, "resumed": planned.done})
    return records


def _write_manifest(
    out_dir: Path,
    scene_file: SceneFile,
    assets: Assets,
    device: Device,
    layers: Sequence[str],
    plan: Sequence[PlannedFrame],
    records: Sequence[dict[str, Any]],
) -> None:
    """What went into the pictures. Frames from earlier runs keep the times that they took then."""
    path = out_dir / "manifest.json"
    earlier = earlier_seconds(path)
    scene = {"file": scene_file.path, "sha256": scene_file.document.sha256}
    files = [{"file": file, "sha256": digest} for file, digest in assets.inputs.items()]
    frames = []
    for planned, record in zip(plan, records, strict=False):  # an interruption leaves fewer records
        seconds = earlier.get(planned.settings) if planned.done else record["seconds"]
        part = {"index": planned.index, "file": planned.exr, "settings_sha256": planned.settings}
        frames.append({**part, "seconds": seconds})
    document = {
        "inputs": [scene, *files],
        "settings": scene_file.data,
        "layers": list(layers),
        "device": device.describe(),
        "versions": library_versions(),
        "frames": frames,
    }
    write_json(path, document)


def earlier_seconds(manifest: Path) -> dict[str, float]:
    """Seconds per settings hash in the manifest of an earlier run; nothing where there is none."""
    try:
        return {
            frame["settings_sha256"]: frame["seconds"] for frame in json.loads(manifest.read_text())["frames"]
        }
    except (OSError, ValueError, KeyError, TypeError):
        return {}


def _write_video(path: Path, plan: Sequence[PlannedFrame], fps: float, progress: Progress) -> None:
    """The frames as a video, where ffmpeg is found; the pictures are what counts, so it never fails a run."""
    ffmpeg = find_ffmpeg()
    if ffmpeg is None:
        progress.say("no video: ffmpeg is not installed")
        return
    try:
        write_video(path, [planned.png for planned in plan], fps, ffmpeg)
    except CoslobeError as error:
        progress.say(f"no video: {error}")
