"""Embree beside coslobe: the same points, lit by shadow rays on the true meshes, timed."""

import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.brdf import brdf_terms, dot
from coslobe.evaluate.occlusion import Segments, blocked_by_spheres, entry_distance, light_spheres
from coslobe.evaluate.sampling import Caps, light_caps, light_measure, square_to_cap

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene, SphereLight

RUNS = 7
RAYS = tuple(2**k for k in range(11))
MOST_RAYS = 1 << 25
"""With more rays in all, only the points are traced whose errors are known: time is taken per point."""

CHUNK = 1 << 20
"""Rays at once: enough for all cores, and little memory."""

OFFSET = 1e-6  # of the meshes' radius: shadow rays of receivers that occlude nothing start this far off
OWN_OFFSET = 2e-4  # of those that do


@dataclass(frozen=True)
class Timing:
    """Seconds of each of several runs, and the picture that they made.

    Attributes
    ----------
    seconds, cpu_seconds : list of float
        Wall-clock time, and time of all cores of the process.
    radiance : dict of float64 [m, 3]
        By material, at the points whose errors are known.
    points : int
        Points that were lit in that time.
    """

    seconds: list[float]
    cpu_seconds: list[float]
    radiance: dict[str, NDArray]
    points: int

    def medians(self) -> dict[str, float]:
        """seconds and cpu_seconds."""
        return {
            "seconds": statistics.median(self.seconds),
            "cpu_seconds": statistics.median(self.cpu_seconds),
        }


class Embree:
    """The true meshes of a scene in one Embree scene, which is moved and scaled to unit size for float32."""

    def __init__(self, scene: "Scene", assets: "Assets") -> None:
        import open3d

        self._tensor: Any = open3d.core.Tensor
        self._scene: Any = open3d.t.geometry.RaycastingScene()
        parts = []
        own = []
        for obj in scene.objects.values():
            own.append(obj.visible and obj.occludes and obj.mesh is not None)
            if own[-1]:
                mesh, matrix = assets.mesh(obj), obj.transform.matrix()
                parts.append((mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3], mesh.faces))
        every = np.concatenate([vertices for vertices, _ in parts] or [np.zeros((1, 3))])
        low, high = every.min(axis=0), every.max(axis=0)
        self._origin, self._radius = (low + high) / 2, float(np.linalg.norm(high - low) / 2) or 1.0
        for vertices, faces in parts:
            local = ((vertices - self._origin) / self._radius).astype(np.float32)
            self._scene.add_triangles(self._tensor(local), self._tensor(faces.astype(np.uint32)))
        self._offset = np.where(own, OWN_OFFSET, OFFSET)

    def distance(self, position: NDArray) -> NDArray:
        """From points [n, 3] to the nearest mesh, float64 [n]."""
        local = ((position - self._origin) / self._radius).astype(np.float32)
        return self._scene.compute_distance(self._tensor(local)).numpy().astype(np.float64) * self._radius

    def rays(self, gbuffer: "GBuffer", at: NDArray, wanted: NDArray, ends: NDArray) -> Any:
        """Rays as Embree takes them, from points to `ends` [n, s, 3] (relative to them) where `wanted`."""
        start = (gbuffer.position[at] - self._origin) / self._radius
        start += self._offset[gbuffer.object[at]][:, None] * gbuffer.geometric_normal[at]
        rays = np.empty((int(wanted.sum()), 6), np.float32)
        rays[:, :3] = start[np.nonzero(wanted)[0]]
        rays[:, 3:] = ends[wanted] / self._radius
        return self._tensor(rays)

    def blocked(self, rays: Any) -> NDArray:
        """Which of them meet a mesh before their end."""
        return self._scene.test_occlusions(rays, tfar=1.0).numpy()


def stratified(count: int, points: int, rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Positions in the unit square, float32 [points, count], one in each cell of a grid; `count` is 2^k."""
    rows = 2 ** (int(np.log2(count)) // 2)
    columns = count // rows
    row, column = np.divmod(np.arange(count), columns)
    u, v = rng.random((2, points, count), np.float32)
    return (u + row.astype(np.float32)) / np.float32(rows), (v + column.astype(np.float32)) / np.float32(
        columns
    )


def embree_front(
    scenes: "Mapping[str, Scene]",
    gbuffer: "GBuffer",
    known: NDArray,
    assets: "Assets",
    progress: Progress = SILENT,
    *,
    rays: Sequence[int] = RAYS,
) -> Iterator[tuple[int, Timing]]:
    """Shadow rays to the lights' caps, by number per point and light: only the tracing is timed.

    `scenes` are the same scene with several materials, by name: the rays are the same for all, and BRDFs
    weigh them afterwards. `known` are the points whose radiance is wanted.
    """
    scene = next(iter(scenes.values()))
    embree = Embree(scene, assets)
    with progress.task("Embree", len(rays)) as advance:
        for count in rays:
            n = len(gbuffer.position)
            whole = n * count * len(scene.lights) <= MOST_RAYS
            points = np.arange(n) if whole else known
            yield count, _traced(embree, scenes, gbuffer, points, known, count)
            advance()


def _traced(
    embree: Embree,
    scenes: "Mapping[str, Scene]",
    gbuffer: "GBuffer",
    points: NDArray,
    known: NDArray,
    count: int,
) -> Timing:
    place = np.full(len(gbuffer.position), -1)
    place[known] = np.arange(len(known))
    radiance = {name: np.zeros((len(known), 3)) for name in scenes}
    seconds, cpu_seconds = np.zeros(RUNS), np.zeros(RUNS)
    rng = np.random.default_rng((7, count))
    lights = [light.sphere for light in next(iter(scenes.values())).lights.values()]
    for at in np.array_split(points, -(-len(points) * count // CHUNK)):
        for index, light in enumerate(lights):
            caps = _caps(gbuffer, at, light)
            directions = square_to_cap(*stratified(count, len(at), rng), caps)
            center = np.asarray(light.center, np.float32)
            reach = entry_distance(gbuffer.position[at].astype(np.float32), directions, center, light.radius)
            cosine = np.maximum(dot(gbuffer.shading_normal[at].astype(np.float32), directions), 0)
            wanted = (cosine > 0) & (dot(gbuffer.geometric_normal[at].astype(np.float32), directions) > 0)
            prepared = embree.rays(gbuffer, at, wanted, np.stack(directions, axis=-1) * reach[..., None])
            dark = embree.blocked(prepared)  # a warm-up, too
            for run in range(RUNS):
                start, cpu = time.perf_counter(), time.process_time()
                embree.blocked(prepared)
                seconds[run] += time.perf_counter() - start
                cpu_seconds[run] += time.process_time() - cpu
            visible = np.zeros(wanted.shape, bool)
            visible[wanted] = ~dark
            some = np.flatnonzero(place[at] >= 0)
            directions = tuple(part[some].astype(np.float64) for part in directions)
            visible = visible[some]
            if len(lights) > 1:
                scene = next(iter(scenes.values()))
                visible &= ~_blocked_by_lights(
                    scene, gbuffer, at[some], index, directions, reach[some], visible
                )
            to_light = np.asarray(light.center, np.float64) - gbuffer.position[at[some]]
            measure = light_measure(Caps(caps.axis[some], caps.height[some]), to_light, light.radius)
            for name, scene in scenes.items():
                light_on = _weighted(scene, gbuffer, at[some], directions, cosine[some], visible)
                radiance[name][place[at[some]]] += light_on * measure[:, None] * light.emission()
    return Timing(seconds.tolist(), cpu_seconds.tolist(), radiance, len(points))


def _caps(gbuffer: "GBuffer", at: NDArray, light: "SphereLight") -> Caps:
    center = np.asarray(light.center, np.float64)
    caps = light_caps(gbuffer.position[at], gbuffer.geometric_normal[at], center, light.radius)
    return Caps(caps.axis.astype(np.float32), caps.height.astype(np.float32))


def _weighted(
    scene: "Scene", gbuffer: "GBuffer", at: NDArray, directions: Any, cosine: NDArray, visible: NDArray
) -> NDArray:
    """Mean of BRDF times cosine over the directions that are visible, float64 [n, 3]."""
    result = np.zeros((len(at), 3))
    for index, material in enumerate(scene.materials.values()):
        mine = np.flatnonzero(gbuffer.material[at] == index)
        if len(mine) == 0:
            continue
        light = tuple(part[mine] for part in directions)
        for term in brdf_terms(material, gbuffer, at[mine]):
            weight = visible[mine] * (cosine[mine] if term.cosine else 1.0)
            result[mine] += term.colour * (term.values(light) * weight).mean(axis=1)[:, None]
    return result


def _blocked_by_lights(
    scene: "Scene",
    gbuffer: "GBuffer",
    at: NDArray,
    index: int,
    directions: Any,
    reach: NDArray,
    wanted: NDArray,
) -> NDArray:
    """Lights block one another."""
    light = list(scene.lights.values())[index].sphere
    center = np.asarray(light.center, np.float64)
    position, normal = gbuffer.position[at], gbuffer.geometric_normal[at]
    segments = Segments(
        position, normal, gbuffer.object[at], index, center, light.radius, directions, reach, wanted
    )
    return blocked_by_spheres(segments, light_spheres(scene))
