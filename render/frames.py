"""Frames that are traced, shaded and written at the same time, each stage one frame behind the former."""

import time
from collections.abc import Generator, Iterator, Sequence
from contextlib import closing
from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.errors import CoslobeError
from coslobe.core.progress import Progress
from coslobe.core.version import VERSION
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.budget import SHARE, within_budget
from coslobe.render.camera import BLOCK, Part, bands
from coslobe.render.images import BEAUTY, write_exr, write_png
from coslobe.render.methods import create_method
from coslobe.render.picture import Picture
from coslobe.render.pipeline import Behind, ahead
from coslobe.render.plan import METHOD_LAYERS, PlannedFrame
from coslobe.render.scene import Scene, SceneFile
from coslobe.render.vertices import interpolate, vertex_points, write_vertices
from coslobe.render.visible import Viewer, Visible

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.methods.base import Method

COUNTS = ("pairs", "points")  # of what methods report: these add up over the parts of a frame


@dataclass
class FrameTimes:
    """What is told of a frame that has been rendered.

    Attributes
    ----------
    points : int
        That were shaded.
    kernel_seconds : float
        All kernels, by profiling events.
    gbuffer_seconds : float
        Finding the visible points, on a thread of its own.
    seconds : float
        From the completion of the former frame (or the start) to this one's, without building programs.
    """

    points: int = 0
    kernel_seconds: float = 0.0
    gbuffer_seconds: float = 0.0
    seconds: float = 0.0


@dataclass
class _Frame:
    """A frame on its way."""

    planned: PlannedFrame
    scene: Scene
    picture: Picture
    times: FrameTimes = field(default_factory=FrameTimes)
    build_seconds: float = 0.0
    skipped: list[tuple[int, dict[str, Any]]] = field(default_factory=list)  # with points, part by part
    vertices: "tuple[GBuffer, dict[str, NDArray]] | None" = None  # with values, where light is computed there


class FrameRenderer:
    """Renders frame after frame; keeps what they have in common, and what the method reports.

    Attributes
    ----------
    build_seconds : float
        Spent on building programs so far.
    finished : dict
        What is told of the frames whose files are complete, by index.
    """

    def __init__(self, scene_file: SceneFile, assets: Assets, device: Device, layers: Sequence[str]) -> None:
        self.build_seconds = 0.0
        self.finished: dict[int, FrameTimes] = {}
        self._scene_file = scene_file
        self._assets = assets
        self._device = device
        self._made = [name for name in layers if name in METHOD_LAYERS]
        self._layers = layers
        self._completed = time.perf_counter()  # the former frame
        self._viewer = Viewer(assets)
        self._method: Method | None = None
        self._skipped: list[dict[str, float]] = []

    @property
    def skipped(self) -> dict[str, float]:
        """What the method reports as not computed, on average over the frames rendered so far."""
        names = dict.fromkeys(name for one in self._skipped for name in one)
        return {name: sum(one.get(name, 0) for one in self._skipped) / len(self._skipped) for name in names}

    def prepare(self, frame: int, progress: Progress) -> None:
        """Load, fit and build what `frame` has in common with later frames; it does not count as its time."""
        scene = self._scene_file.at(frame)
        self._method = create_method(scene.shading.method, self._device, progress)
        self._method.prepare(scene)
        world_blockers(scene, self._assets)
        for obj in scene.objects.values():
            if obj.mesh is not None and obj.visible:
                self._assets.raycaster(obj)

    def render(self, planned: Sequence[PlannedFrame]) -> Generator[int]:
        """Render and write frames; yields how many have become complete since it yielded last.

        While one is shaded, the next is traced and the last is written, on threads of their own.
        """
        told = 0
        self._completed = time.perf_counter()
        with Behind() as behind, closing(ahead(self._see(planned))) as seen:
            for frame, visible, last in seen:
                behind.put(partial(self._add, frame, visible, self._shade(frame, visible)))
                if last:
                    behind.put(partial(self._finish, frame))
                del frame, visible  # which hold memory
                if len(self.finished) > told:
                    yield len(self.finished) - told
                    told = len(self.finished)
        yield len(self.finished) - told

    def _see(self, planned: Sequence[PlannedFrame]) -> Iterator[tuple[_Frame, Visible, bool]]:
        """The frames' parts and the points that are visible there; whether it is a frame's last."""
        for one in planned:
            start = time.perf_counter()
            scene = self._scene_file.at(one.index)
            frame = _Frame(one, scene, Picture(scene.image))
            if scene.shading.at == "vertices":
                frame.vertices = (vertex_points(scene, self._assets), {})
            parts = bands(scene.image)
            for part in parts:
                visible = self._viewer.visible(scene, part)
                frame.times.gbuffer_seconds += time.perf_counter() - start
                yield frame, visible, part == parts[-1]
                start = time.perf_counter()

    def _shade(self, frame: _Frame, visible: Visible) -> dict[str, NDArray]:
        """The method's layers at the visible points."""
        if frame.vertices is None:
            return self._lit(frame, visible)
        points, values = frame.vertices
        if not values:
            values.update(self._lit(frame, points))
        return {name: _between(frame.scene, self._assets, visible, value) for name, value in values.items()}

    def _lit(self, frame: _Frame, points: "Visible | GBuffer") -> dict[str, NDArray]:
        assert self._method is not None
        blockers = world_blockers(frame.scene, self._assets)
        if frame.scene.shading.time_budget is not None and not frame.skipped:
            frame.scene = within_budget(self._method, frame.scene, *self._sample(frame), blockers)
        shading = self._method.shade(frame.scene, points, blockers, self._made)
        frame.skipped.append((len(points), shading.skipped))
        frame.build_seconds += shading.build_seconds
        self.build_seconds += shading.build_seconds
        frame.times.points += len(points)
        frame.times.kernel_seconds += shading.kernel_seconds
        return {BEAUTY: shading.radiance, **shading.layers}

    def _sample(self, frame: _Frame) -> "tuple[Visible | GBuffer, float]":
        """Some of the frame's points, and which share of all they are."""
        if frame.vertices is not None:
            points = frame.vertices[0]
            some = points.some(np.flatnonzero(np.arange(len(points)) // BLOCK % SHARE == 0))
            return some, len(some) / max(len(points), 1)
        image = frame.scene.image
        return self._viewer.visible(frame.scene, Part(0, image.width * image.height, SHARE)), 1 / SHARE

    def _add(self, frame: _Frame, visible: Visible, values: dict[str, NDArray]) -> None:
        frame.picture.add(visible, values, _first_seen(visible, self._layers))

    def _finish(self, frame: _Frame) -> None:
        """Write the frame's files. The preview goes first and comes last: where it is, all are new."""
        planned, layers, times = frame.planned, frame.picture.layers, frame.times
        attributes = {
            "version": VERSION,
            "config_sha256": planned.settings,
            "frame": planned.index,
            "points": times.points,
        }
        if frame.vertices is not None:
            points, values = frame.vertices
            write_vertices(planned.ply, frame.scene, self._assets, points, values[BEAUTY])
        try:
            planned.png.unlink(missing_ok=True)
        except OSError as error:
            message = f"{planned.png}: cannot be replaced ({error.strerror})"
            raise CoslobeError(message, "choose another folder with -o") from error
        pictures = {name: layers[name] for name in (BEAUTY, *self._layers)}
        write_exr(planned.exr, pictures, attributes, compressed=bool(self._layers))
        write_png(planned.png, layers[BEAUTY])
        former, self._completed = self._completed, time.perf_counter()
        times.seconds = max(self._completed - former - frame.build_seconds, 0.0)
        self._skipped.append(_together(frame.skipped))
        self.finished[planned.index] = times


def _between(scene: Scene, assets: Assets, visible: Visible, values: NDArray) -> NDArray:
    """Values of the vertices, [m] or [m, 3], at the visible points."""
    columns = values if values.ndim == 2 else values[:, None]
    between = interpolate(scene, assets, visible, columns)
    return between if values.ndim == 2 else between[:, 0]


def _first_seen(visible: Visible, layers: Sequence[str]) -> dict[str, NDArray]:
    """What rays hit, as far as it is asked for."""
    found = {
        "object": lambda: visible.object,
        "normal": lambda: visible.gbuffer.shading_normal,
        "position": lambda: visible.gbuffer.position,
        "depth": lambda: visible.gbuffer.depth,
    }
    return {name: found[name]() for name in layers if name in found}


def _together(parts: Sequence[tuple[int, dict[str, Any]]]) -> dict[str, float]:
    """What the method reports of all parts of a frame: sums of counts, averages over the points of shares."""
    total = sum(points for points, _ in parts)
    weights = [points / total if total else 1 / len(parts) for points, _ in parts]
    reports = [report for _, report in parts]
    return {
        name: sum(
            report.get(name, 0) * (1 if name in COUNTS else weight)
            for report, weight in zip(reports, weights, strict=True)
        )
        for name in dict.fromkeys(name for report in reports for name in report)
    }
