"""Frames in order: rendering what is not there yet, and what is written beside the pictures.

How light is computed is the business of a lighting method; here it is only called.
"""

import json
import time
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.errors import CoslobeError
from coslobe.core.files import remove_leftovers, write_json
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import VERSION, library_versions
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.budget import within_budget
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.images import BEAUTY, write_exr, write_png
from coslobe.render.methods import create_method
from coslobe.render.plan import METHOD_LAYERS, PlannedFrame, check_layers, plan_frames
from coslobe.render.scene import Scene, SceneFile
from coslobe.render.vertices import interpolate, vertex_points, write_vertices
from coslobe.render.video import find_ffmpeg, write_video

if TYPE_CHECKING:
    from coslobe.render.methods.base import Method


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
    renderer = _Renderer(scene_file, assets, device, layers)
    records: list[dict[str, Any]] = []
    with _tidy(folder):
        try:
            pending = [planned.index for planned in plan if not planned.done]
            if pending:
                renderer.prepare(pending[0], progress)
            with progress.task("rendering", len(plan)) as advance:
                for planned in plan:
                    records.append(_record(planned) if planned.done else renderer.render(planned))
                    advance(1, f"{renderer.frames_per_second:.1f} frames/s")
        finally:
            if records:
                _write_manifest(out_dir, scene_file, assets, device, layers, plan, records)
        if len(plan) > 1:
            _write_video(out_dir / "sequence.mp4", plan, scene_file.fps, progress)
    return {
        "frames": records,
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


class _Renderer:
    """Renders frame after frame; keeps what they have in common, and what the method reports."""

    def __init__(self, scene_file: SceneFile, assets: Assets, device: Device, layers: Sequence[str]) -> None:
        self.build_seconds = 0.0
        self._scene_file = scene_file
        self._assets = assets
        self._device = device
        self._layers = layers
        self._method: Method | None = None
        self._gbuffer: GBuffer | None = None
        self._seen: Any = None
        self._frames, self._seconds = 0, 0.0
        self._skipped: Counter[str] = Counter()

    @property
    def frames_per_second(self) -> float:
        """Of the frames rendered so far, without preparations; 0 before the first."""
        return self._frames / self._seconds if self._frames else 0.0

    @property
    def skipped(self) -> dict[str, float]:
        """What the method reports as not computed, on average over the frames rendered so far."""
        return {name: total / self._frames for name, total in self._skipped.items()}

    def prepare(self, frame: int, progress: Progress) -> None:
        """Load, fit and build what `frame` has in common with later frames; it does not count as its time."""
        scene = self._scene_file.at(frame)
        self._method = create_method(scene.shading.method, self._device, progress)
        self._method.prepare(scene)
        world_blockers(scene, self._assets)
        for obj in scene.objects.values():
            if obj.mesh is not None and obj.visible:
                self._assets.raycaster(obj)

    def render(self, planned: PlannedFrame) -> dict[str, Any]:
        """Render and write one frame; its record. Building programs does not count as the frame's time."""
        assert self._method is not None
        start = time.perf_counter()
        scene = self._scene_file.at(planned.index)
        gbuffer = self._visible(scene)
        at_vertices = scene.shading.at == "vertices"
        points = vertex_points(scene, self._assets) if at_vertices else gbuffer
        gbuffer_seconds = time.perf_counter() - start
        blockers = world_blockers(scene, self._assets)
        scene = within_budget(self._method, scene, points, blockers)
        made = [name for name in self._layers if name in METHOD_LAYERS]
        shading = self._method.shade(scene, points, blockers, made)
        self.build_seconds += shading.build_seconds
        self._skipped.update(shading.skipped)
        values = {BEAUTY: shading.radiance, **shading.layers}
        if at_vertices:
            write_vertices(planned.ply, scene, self._assets, points, shading.radiance)
            values = {name: _between(scene, self._assets, gbuffer, value) for name, value in values.items()}
        _write_pictures(planned, gbuffer, len(points.position), values, self._layers)
        seconds = time.perf_counter() - start - shading.build_seconds
        self._frames, self._seconds = self._frames + 1, self._seconds + seconds
        return _record(planned, len(points.position), shading.kernel_seconds, gbuffer_seconds, seconds)

    def _visible(self, scene: Scene) -> GBuffer:
        """The shaded points, traced again only where the camera, an object or a picture has changed."""
        materials = [
            (name, part.pictures, part.anisotropic, part.tangent) for name, part in scene.materials.items()
        ]
        seen = (scene.camera, scene.image, scene.objects, materials)
        if self._gbuffer is None or seen != self._seen:
            self._gbuffer, self._seen = trace_gbuffer(scene, self._assets), seen
        return self._gbuffer


def _record(
    planned: PlannedFrame,
    points: int | None = None,
    kernel_seconds: float | None = None,
    gbuffer_seconds: float | None = None,
    seconds: float | None = None,
) -> dict[str, Any]:
    """The entry of one frame in the JSON document; a frame that was there already has no times."""
    return {
        "index": planned.index,
        "file": planned.exr,
        "points": planned.points if planned.done else points,
        "kernel_seconds": kernel_seconds,
        "gbuffer_seconds": gbuffer_seconds,
        "seconds": seconds,
        "resumed": planned.done,
    }


def _between(scene: Scene, assets: Assets, gbuffer: GBuffer, values: NDArray) -> NDArray:
    """Values of the vertices, [m] or [m, 3], at the visible points."""
    columns = values if values.ndim == 2 else values[:, None]
    between = interpolate(scene, assets, gbuffer, columns)
    return between if values.ndim == 2 else between[:, 0]


def _write_pictures(
    planned: PlannedFrame, gbuffer: GBuffer, points: int, values: Mapping[str, NDArray], layers: Sequence[str]
) -> None:
    """The frame's two files. The preview goes first and comes last: where it is, both are new."""
    pictures = {name: gbuffer.image(value) for name, value in values.items()}
    pictures = {BEAUTY: pictures[BEAUTY]} | {
        name: pictures[name] if name in pictures else _layer(gbuffer, name) for name in layers
    }
    attributes = {
        "version": VERSION,
        "config_sha256": planned.settings,
        "frame": planned.index,
        "points": points,
    }
    try:
        planned.png.unlink(missing_ok=True)
    except OSError as error:
        message = f"{planned.png}: cannot be replaced ({error.strerror})"
        raise CoslobeError(message, "choose another folder with -o") from error
    write_exr(planned.exr, pictures, attributes)
    write_png(planned.png, pictures[BEAUTY])


def _layer(gbuffer: GBuffer, name: str) -> NDArray:
    """What the first sample of each pixel hit: averages of indices or normals would mean nothing."""
    if name == "object":
        return gbuffer.first_image(gbuffer.object.astype(np.float32), background=-1)
    values = {"normal": gbuffer.shading_normal, "position": gbuffer.position, "depth": gbuffer.depth}
    return gbuffer.first_image(values[name], background=0)


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
