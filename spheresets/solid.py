"""The solid that a mesh bounds: inside test, distances and rays, by Embree through Open3D."""

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.mesh import Mesh

FIRST_RAYS = 3
MORE_RAYS = 13
CHECKED, CHECK_RAYS = 500, 128
LEAST_VOLUME = 1e-10  # of a closed mesh
BLOCK = 1 << 19  # rays per call: bounds the memory for their intersections

Points = NDArray[np.float64]


class Solid:
    """A mesh in unit coordinates: its bounding box is centred at the origin and has diagonal 1.

    Embree computes in float32, and fits are compared across meshes of all sizes: both want this frame.
    All methods take and return unit coordinates.

    A point is inside where the generalised winding number (Jacobson et al. 2013) exceeds 1/2 in absolute
    value. It is the mean over directions of the signed number of surfaces that a ray leaves through, here
    estimated from a few rays and, where those disagree, from more. Small holes therefore do not matter,
    overlapping shells count as solid, and a mesh turned inside out is the same solid. Where triangles are
    not oriented consistently, signs mean nothing, and the parity of the crossings votes instead.

    Attributes
    ----------
    name : str
        The mesh's file, for messages.
    vertices : float64 [n, 3]
    faces : int32 [m, 3]
    lower, upper : float64 [3]
        Corners of the bounding box.
    center, size
        File coordinates are `center + size * unit coordinates`.
    oriented, closed : bool
        Whether neighbouring triangles agree about which side is out; whether there is also no open edge.
    """

    def __init__(self, mesh: Mesh) -> None:
        import open3d

        self.name = mesh.file
        lower, upper = mesh.bounds
        self.center = (lower + upper) / 2
        self.size = float(np.linalg.norm(upper - lower))
        self.vertices = (mesh.vertices - self.center) / self.size
        self.faces = mesh.faces
        self.lower, self.upper = (lower - self.center) / self.size, (upper - self.center) / self.size
        corners = self.vertices[self.faces]
        self._cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        self.areas = np.linalg.norm(self._cross, axis=1) / 2
        if not self.areas.any():
            raise InvalidInput(f"{mesh.file}: all triangles have zero area", "export surfaces, not lines")
        self.oriented, self.closed = _orientation(self.vertices, self.faces)
        self._tensor = open3d.core.Tensor.from_numpy
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(self.vertices.astype(np.float32)), self._tensor(self.faces.astype(np.uint32))
        )

    def sample_surface(self, count: int, rng: np.random.Generator) -> Points:
        """Points [count, 3] uniform by area, one in each of `count` equal shares of it in file order."""
        ends = np.cumsum(self.areas)
        share = (np.arange(count) + rng.random(count)) / count
        face = np.searchsorted(ends, share * ends[-1], side="right").clip(max=len(ends) - 1)
        root, v = np.sqrt(rng.random(count)), rng.random(count)
        weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
        return np.einsum("nk,nkd->nd", weights, self.vertices[self.faces[face]])

    def inside(self, points: Points) -> NDArray[np.bool_]:
        """Which of the points [n, 3] are in the solid."""
        directions = _directions(FIRST_RAYS + MORE_RAYS)
        first = np.stack([self._crossings(points, w) for w in directions[:FIRST_RAYS]])
        unsure = np.flatnonzero((first != first[0]).any(0))
        total = first.sum(0)
        for w in directions[FIRST_RAYS:] if unsure.size else ():
            total[unsure] += self._crossings(points[unsure], w)
        rays = np.full(len(points), FIRST_RAYS)
        rays[unsure] += MORE_RAYS
        return np.abs(total) > 0.5 * rays

    def encloses(self, points: Points) -> bool:
        """Whether points [n, 3] that are inside are so for a reason other than lying next to a sheet.

        Next to an open sheet the winding number is 1/2 and the rays' verdict is luck; more rays tell.
        """
        if not len(points):
            return False
        if self.closed:
            a, b, c = (self.vertices[self.faces[:, k]] for k in range(3))
            return abs(np.einsum("nd,nd->", a, np.cross(b, c))) / 6 > LEAST_VOLUME
        some = points[:: len(points) // CHECKED + 1]
        total = np.sum([self._crossings(some, w) for w in _directions(CHECK_RAYS)], axis=0)
        return bool(np.mean(np.abs(total) > 0.6 * CHECK_RAYS) > 0.05)

    def _crossings(self, points: Points, direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """Surfaces that each ray leaves through, signed; without orientation their parity."""
        sign = np.sign(self._cross @ direction) if self.oriented else np.ones(len(self.faces))
        counts = []
        for start in range(0, len(points), BLOCK):
            rays = _rays(points[start : start + BLOCK], direction)
            hits = self._scene.list_intersections(self._tensor(rays))
            ray, face = hits["ray_ids"].numpy(), hits["primitive_ids"].numpy()
            counts.append(np.bincount(ray.astype(np.int64), sign[face], minlength=len(rays)))
        total = np.concatenate(counts) if counts else np.zeros(0)
        return total if self.oriented else total % 2

    def distance(self, points: Points) -> NDArray[np.float64]:
        """Distance [n] of each point to the surface, on either side."""
        return (
            self._scene.compute_distance(self._tensor(points.astype(np.float32))).numpy().astype(np.float64)
        )

    def signed_distance(self, points: Points) -> NDArray[np.float64]:
        """Distance [n] to the surface, negative inside."""
        return np.where(self.inside(points), -1, 1) * self.distance(points)

    def occluded(self, origins: Points, directions: NDArray[np.float64], reach: float) -> NDArray[np.bool_]:
        """Whether the rays [n, 3] + t [n, 3], 0 < t < reach, hit the surface; arguments broadcast."""
        rays = _rays(origins, directions)
        return self._scene.test_occlusions(self._tensor(rays), tfar=reach).numpy()

    def first_hit(
        self, origins: Points, directions: NDArray[np.float64]
    ) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.float64]]:
        """Distance [n] along each ray (inf: none), the triangle hit [n], its corners' weights [n, 3]."""
        hit = self._scene.cast_rays(self._tensor(_rays(origins, directions)))
        distance = hit["t_hit"].numpy().astype(np.float64)
        face = np.where(np.isfinite(distance), hit["primitive_ids"].numpy(), 0).astype(np.int64)
        u, v = hit["primitive_uvs"].numpy().astype(np.float64).T
        return distance, face, np.stack([1 - u - v, u, v], axis=1)


def _directions(count: int) -> NDArray[np.float64]:
    directions = np.random.default_rng(0).normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _rays(origins: Points, directions: NDArray[np.float64]) -> NDArray[np.float32]:
    origins, directions = np.broadcast_arrays(origins, directions)
    return np.concatenate([origins, directions], axis=1, dtype=np.float32)


def _orientation(vertices: Points, faces: NDArray[np.int32]) -> tuple[bool, bool]:
    """Whether the two triangles at an edge run along it in opposite directions, and each edge has two."""
    corners = np.unique(vertices, axis=0, return_inverse=True)[1].reshape(-1)[faces].astype(np.int64)
    start, end = corners.reshape(-1), np.roll(corners, -1, axis=1).reshape(-1)
    proper = start != end  # triangles with coincident corners have no such edge
    start, end = start[proper], end[proper]
    edge = np.minimum(start, end) * (corners.max() + 1) + np.maximum(start, end)
    _, edge = np.unique(edge, return_inverse=True)
    balance = np.bincount(edge.reshape(-1), np.where(start < end, 1, -1))
    uses = np.bincount(edge.reshape(-1))
    return bool((np.abs(balance) == uses % 2).all()), bool((balance == 0).all())
