"""What stands between a point and a light: the true meshes, or the exact spheres of the sphere sets."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.brdf import Vectors, dot

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Scene

NONE = -1  # owner of an emitter's sphere, emitter of an object's sphere

RAY_OFFSET = 1e-4
"""Shadow rays start this far off the surface, in diagonals of the receiver's own mesh: beyond the rounding of
Embree's float32, and far below what a sphere set can resolve."""

ROUNDING_OFFSET = 1e-6
"""The same for receivers that occlude nothing themselves, in diagonals of all occluding meshes together."""


MOST_PAIRS = 1 << 20
"""Pairs of a point and a sphere that are looked at together: what bounds the memory."""


@dataclass(frozen=True)
class Spheres:
    """Spheres in world space that block light.

    Attributes
    ----------
    centers : float64 [n, 3]
    radii : float64 [n]
    outside : float64 [n]
        How far each sphere sticks out of its object's mesh at most.
    owner : int32 [n]
        The object whose sphere set it belongs to, in scene order; NONE for a light's own sphere.
    emitter : int32 [n]
        The light that it is, in scene order; NONE for an object's sphere.
    """

    centers: NDArray
    radii: NDArray
    outside: NDArray
    owner: NDArray
    emitter: NDArray

    def __getitem__(self, index: NDArray) -> "Spheres":
        parts = (self.centers, self.radii, self.outside, self.owner, self.emitter)
        return Spheres(*(part[index] for part in parts))

    def __len__(self) -> int:
        return len(self.radii)


@dataclass(frozen=True)
class Segments:
    """The sampled directions of a block of points towards one light.

    Attributes
    ----------
    position, normal : float64 [n, 3]
        The points and their unit geometric normals on the viewer's side.
    object : int32 [n]
        Index of the object that each point lies on.
    light : int
        Index of the light.
    center, radius : float64 [3], float
        Its sphere.
    directions : three float64 [n, s]
        x, y and z of unit directions.
    reach : float64 [n, s]
        Distance at which each direction enters the light; 0 from inside it.
    wanted : bool [n, s]
        Directions whose occlusion matters; the answer for others is arbitrary.
    """

    position: NDArray
    normal: NDArray
    object: NDArray
    light: int
    center: NDArray
    radius: float
    directions: Vectors
    reach: NDArray
    wanted: NDArray

    def part(self, first: int, count: int) -> "Segments":
        """Those of `count` points from the index `first` on."""
        some = slice(first, first + count)
        x, y, z = self.directions
        return replace(
            self,
            position=self.position[some],
            normal=self.normal[some],
            object=self.object[some],
            directions=(x[some], y[some], z[some]),
            reach=self.reach[some],
            wanted=self.wanted[some],
        )


def entry_distance(position: NDArray, directions: Vectors, center: NDArray, radius: float) -> NDArray:
    """Distance from points [n, 3] along directions [n, s] of their caps to the light; 0 from inside it."""
    offset = center - position
    distance2 = np.einsum("ij,ij->i", offset, offset)[:, None]
    along = dot(offset, directions)
    half_chord = np.sqrt(np.maximum(radius * radius - (distance2 - along * along), 0.0))
    return np.where(distance2 > radius * radius, along - half_chord, 0.0)


class Occluders:
    """Blocks light by spheres, by triangle meshes, or by both."""

    def __init__(self, spheres: Spheres, meshes: "Meshes | None" = None) -> None:
        self._spheres = spheres
        self._meshes = meshes

    def blocked(self, segments: Segments) -> NDArray:
        """Which of the sampled directions are blocked before they reach the light: bool [n, s]."""
        count = max(MOST_PAIRS // max(len(self._spheres), 1), 1)
        parts = [segments.part(first, count) for first in range(0, len(segments.position), count)]
        blocked = np.concatenate([blocked_by_spheres(part, self._spheres) for part in parts])
        if self._meshes is not None:
            blocked |= self._meshes.blocked(segments, segments.wanted & ~blocked)
        return blocked


def sphere_occluders(scene: "Scene", assets: "Assets") -> Occluders:
    """The sphere sets of all visible occluding objects, and the lights, which block one another."""
    from coslobe.render.assets import world_blockers

    blockers = world_blockers(scene, assets)
    lights = light_spheres(scene)
    no_emitter = np.full(len(blockers.radii), NONE, np.int32)
    parts = (
        (blockers.centers, lights.centers),
        (blockers.radii, lights.radii),
        (blockers.outside, lights.outside),
        (blockers.owner, lights.owner),
        (no_emitter, lights.emitter),
    )
    return Occluders(Spheres(*(np.concatenate(pair) for pair in parts)))


def mesh_occluders(scene: "Scene", assets: "Assets") -> Occluders:
    """The true meshes of all visible occluding objects, and the lights as spheres."""
    return Occluders(light_spheres(scene), Meshes(scene, assets))


def light_spheres(scene: "Scene") -> Spheres:
    """The lights of a scene as blockers of one another."""
    lights = [light.sphere for light in scene.lights.values()]
    n = len(lights)
    return Spheres(
        np.array([light.center for light in lights], np.float64).reshape(n, 3),
        np.array([light.radius for light in lights], np.float64),
        np.zeros(n),
        np.full(n, NONE, np.int32),
        np.arange(n, dtype=np.int32),
    )


def may_block(
    position: NDArray, centers: NDArray, radii: NDArray, light_center: NDArray, light_radius: float
) -> NDArray:
    """Which spheres can meet a ray from each point into the light: bool [points, spheres].

    Never wrongly False. A sphere of angular radius b misses the cone of half-angle a around the light when
    the angle between the axes exceeds a + b: a comparison of cosines, without trigonometry. A point inside
    a sphere keeps it, because what the sphere bounds may lie on any side; a point inside the light, where
    there is no cone, keeps all.
    """
    axis = light_center - position
    light2 = np.einsum("ij,ij->i", axis, axis)
    light_distance = np.sqrt(light2)
    inside = light_distance <= light_radius
    safe = np.where(inside, 1.0, light_distance)
    sin_a = (light_radius / safe)[:, None]
    cos_a = np.sqrt(np.maximum(1 - sin_a * sin_a, 0.0))
    to_center = centers[None] - position[:, None]
    distance2 = np.einsum("ijk,ijk->ij", to_center, to_center)
    along = np.einsum("ijk,ik->ij", to_center, axis / safe[:, None])
    tangent = np.sqrt(np.maximum(distance2 - radii * radii, 0.0))
    slack = 1e-9 * (light_distance[:, None] + tangent + radii)
    in_cone = along >= cos_a * tangent - sin_a * radii - slack
    return in_cone | (distance2 <= radii * radii) | inside[:, None]


def blocked_by_spheres(segments: Segments, spheres: Spheres) -> NDArray:
    """Exact ray-sphere tests: bool [n, s].

    A sphere (c, r) with o = c - x and m = max(o.o - r^2, 0) blocks the unit direction l if o.l > 0,
    (o.l)^2 >= m, and it is entered, at o.l - sqrt((o.l)^2 - m), before the light is. A point inside a sphere
    thus loses the half-space towards its centre, the limit of touching it from outside. A point's own
    object's spheres have the radius that `own_radii` gives them.
    """
    blocked = np.zeros(segments.reach.shape, bool)
    spheres = _near_block(segments, spheres)
    pairs, radii = _pairs(segments, spheres)
    rank_of_pair = np.arange(len(pairs)) - np.searchsorted(pairs[:, 0], pairs[:, 0])
    for rank in range(
        int(rank_of_pair.max(initial=-1)) + 1
    ):  # the rank-th sphere of every point that has one
        chosen = rank_of_pair == rank
        point, sphere = pairs[chosen].T
        o = spheres.centers[sphere] - segments.position[point]
        m = np.maximum(np.einsum("ij,ij->i", o, o) - radii[chosen] ** 2, 0.0)[:, None]
        x, y, z = segments.directions
        along = dot(o, (x[point], y[point], z[point]))
        beyond = along * along - m
        hit = (along > 0) & (beyond >= 0)
        along -= np.sqrt(np.maximum(beyond, 0.0))
        hit &= along < segments.reach[point]
        blocked[point] |= hit
    return blocked


def own_radii(height: NDArray, distance: NDArray, radii: NDArray, outside: NDArray) -> NDArray:
    """Radii at which spheres of the receiver's own object block it, 0 where they do not (docs/reference.md).

    `height` is the centre's height above the tangent plane, `distance` its distance to the point. Sphere sets
    bulge by up to `outside` above the true surface: a sphere that comes so close to the point is this surface
    rather than something in front of it, unless its centre stands above the tangent plane. A little farther
    off it is smaller by its bulge, because the surface that it stands for lies that much lower.
    """
    bulge = outside * np.clip(0.25 - height / radii, 0.0, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        near = np.clip((radii + 2 * outside - distance) / outside, 0.0, 1.0)
    shrunk = radii - np.where(outside > 0, bulge * near, 0.0)
    return np.where((height <= -radii) | (distance < radii + bulge), 0.0, shrunk)


def _near_block(segments: Segments, spheres: Spheres) -> Spheres:
    """The spheres that may matter to any point of the block.

    With all points within p of b, the segments from x and from b to the same y on the light are nowhere more
    than p apart: a sphere of radius r can meet one from x only where one of radius r + p meets that from b.
    """
    spheres = spheres[spheres.emitter != segments.light]
    low, high = segments.position.min(axis=0), segments.position.max(axis=0)
    reach = np.linalg.norm(high - low) / 2
    near = may_block(
        (low + high)[None] / 2, spheres.centers, spheres.radii + reach, segments.center, segments.radius
    )
    return spheres[near[0]]


def _pairs(segments: Segments, spheres: Spheres) -> tuple[NDArray, NDArray]:
    """(point, sphere) pairs that need testing, sorted by point, and the spheres' radii: int64 [m, 2], [m]."""
    near = may_block(segments.position, spheres.centers, spheres.radii, segments.center, segments.radius)
    point, sphere = np.nonzero(near & (segments.reach.max(axis=1) > 0)[:, None])
    o = spheres.centers[sphere] - segments.position[point]
    height = np.einsum("ij,ij->i", o, segments.normal[point])
    distance = np.sqrt(np.einsum("ij,ij->i", o, o))
    radii = spheres.radii[sphere]
    own = spheres.owner[sphere] == segments.object[point]
    radii = np.where(own, own_radii(height, distance, radii, spheres.outside[sphere]), radii)
    needed = (radii > 0) & (height > -radii)  # else wholly below the tangent plane
    needed &= distance - radii < segments.reach.max(axis=1)[point]  # else wholly behind the light
    return np.stack([point, sphere], axis=-1)[needed], radii[needed]


class Meshes:
    """The triangle meshes of all visible occluding objects of one frame, in one Embree scene.

    Embree works in float32, so the scene is moved to the middle of the meshes and scaled to unit size.
    """

    def __init__(self, scene: "Scene", assets: "Assets") -> None:
        import open3d

        self._tensor: Any = open3d.core.Tensor
        self._embree: Any = open3d.t.geometry.RaycastingScene()
        occluding = [
            (index, obj)
            for index, obj in enumerate(scene.objects.values())
            if obj.visible and obj.occludes and obj.mesh is not None
        ]
        world = {
            index: (_transformed(mesh.vertices, obj.transform.matrix()), mesh.faces)
            for index, obj in occluding
            for mesh in (assets.mesh(obj),)
        }
        boxes = {index: box(vertices) for index, (vertices, _) in world.items()}
        self._centers = np.array([center for center, _ in boxes.values()]).reshape(-1, 3)
        self._radii = np.array([radius for _, radius in boxes.values()])
        self._origin, radius = box(np.concatenate([v for v, _ in world.values()] or [np.zeros((1, 3))]))
        self._scale = 1 / radius if radius > 0 else 1.0
        for vertices, faces in world.values():
            local = ((vertices - self._origin) * self._scale).astype(np.float32)
            self._embree.add_triangles(self._tensor(local), self._tensor(faces.astype(np.uint32)))
        self._offset = np.full(len(scene.objects), ROUNDING_OFFSET * 2 * radius)
        for index, (_, own_radius) in boxes.items():
            self._offset[index] = max(RAY_OFFSET * 2 * own_radius, self._offset[index])

    def blocked(self, segments: Segments, wanted: NDArray) -> NDArray:
        """Which of the `wanted` directions meet a triangle before they reach the light: bool [n, s]."""
        radii = self._radii * (1 + 1e-6)
        near = np.any(
            may_block(segments.position, self._centers, radii, segments.center, segments.radius), axis=1
        )
        blocked = np.zeros(wanted.shape, bool)
        wanted = wanted & near[:, None] & (segments.reach > 0)
        point = np.nonzero(wanted)[0]
        if len(point):
            start = segments.position + self._offset[segments.object][:, None] * segments.normal
            rays = np.empty((len(point), 6), np.float32)
            rays[:, :3] = ((start - self._origin) * self._scale)[point]
            # Open3D takes one tfar for all rays: each is scaled so that the light is at t = 1.
            reach = segments.reach[wanted] * self._scale
            for axis in range(3):
                rays[:, 3 + axis] = segments.directions[axis][wanted] * reach
            blocked[wanted] = self._embree.test_occlusions(self._tensor(rays), tfar=1.0).numpy()
        return blocked


def _transformed(vertices: NDArray, matrix: NDArray) -> NDArray:
    return vertices @ matrix[:3, :3].T + matrix[:3, 3]


def box(vertices: NDArray) -> tuple[NDArray, float]:
    """Centre of the bounding box, and half its diagonal."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    return (low + high) / 2, float(np.linalg.norm(high - low) / 2)
