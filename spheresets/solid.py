"""The solid that a mesh bounds: inside test, distances and rays, by Embree through Open3D."""

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.mesh import Mesh, blocks, counted
from coslobe.spheresets.orientation import study

RAYS = (4, 16, 64)  # 3 of the first; more where those disagree; most where it is near 1/2 that they find
UNSURE = 0.2
CHECKED, CHECK_RAYS = 500, 128
LEAST_VOLUME = 1e-10  # of a closed mesh
BLOCK = 1 << 19  # rays per call: bounds the memory for their intersections
BESIDE = 1e-4  # from the surface to points that stand for one side of it
LOOKS, MOST_LOOKS = 20_000, 200_000  # points from which both sides of the surface look out
EVIDENT = 0.1  # of the looks from one side escape, less those from the other
LEAST_SHARE, ALL_SHARES = 3e-4, 0.05  # of the samples, for a small part and for all of them
PROBES = 2000
NOTED = 0.005  # share of the surface that is worth a word

# A rotation without any symmetry, so that no direction lies in the planes that meshes like.
ASKEW = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]

Points = NDArray[np.float64]


def solid_of(mesh: Mesh) -> "Solid":
    """The solid of a mesh, analysed once as long as the mesh lives: fits, figures and pictures share it."""
    if mesh not in _solids:
        _solids[mesh] = Solid(mesh)
    return _solids[mesh]


class Solid:
    """A mesh in unit coordinates: its bounding box is centred at the origin and has diagonal 1.

    Embree computes in float32, and fits are compared across meshes of all sizes: both want this frame.
    All methods take and return unit coordinates.

    A point is inside where the generalised winding number (Jacobson et al. 2013) exceeds 1/2 in absolute
    value. It is the mean over directions of the signed number of surfaces that a ray leaves through, here
    estimated from a few rays and, where those leave doubts, from more. Small holes therefore do not matter,
    overlapping shells count as solid, and a mesh turned inside out is the same solid.

    Signs need triangles that agree about which side is out. Within a connected part neighbours decide
    (`orientation.study`); of several parts, each is turned so that out is the side from which rays escape
    (after Takayama et al. 2014). A part that hides in others stays as it is: turned inwards, it is a cavity.

    Attributes
    ----------
    name : str
        The mesh's file, for messages.
    vertices : float64 [n, 3]
    faces : int32 [m, 3]
        In the order and orientation of the file.
    areas : float64 [m]
        Zero for copies of other triangles.
    lower, upper : float64 [3]
        Corners of the bounding box.
    center, size
        File coordinates are `center + size * unit coordinates`.
    """

    def __init__(self, mesh: Mesh) -> None:
        import open3d

        self.name = mesh.file
        lower, upper = mesh.bounds
        self.center = (lower + upper) / 2
        self.size = float(np.linalg.norm(upper - lower))
        if not 0 < self.size < np.inf:
            raise InvalidInput(
                f"{mesh.file}: its bounding box has size {self.size:g}", "export the mesh again"
            )
        self.vertices = (mesh.vertices - self.center) / self.size
        self.faces = mesh.faces
        self.lower, self.upper = (lower - self.center) / self.size, (upper - self.center) / self.size
        self._cross = np.empty(self.faces.shape, np.float32)
        for part in blocks(len(self.faces)):
            a, b, c = (self.vertices[self.faces[part, k]] for k in range(3))
            self._cross[part] = np.cross(b - a, c - a)
        self.areas = np.linalg.norm(self._cross, axis=1).astype(np.float64) / 2
        if not self.areas.any():
            raise InvalidInput(f"{mesh.file}: all triangles have zero area", "export surfaces, not lines")
        self._tensor = open3d.core.Tensor.from_numpy
        self._scene = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(
            self._tensor(self.vertices.astype(np.float32)), self._tensor(self.faces.view(np.uint32))
        )
        self._defects = mesh.defects
        self._surface = study(self.vertices, self.faces, self.areas)
        self.areas[self._surface.turn == 0] = 0
        self._cross *= self._surface.turn[:, None]
        turned = self._surface.turn < 0
        over = self._inside_out()
        self._cross[over] *= -1
        self._turned = int((turned ^ over).sum())
        self._turn = np.where(over, -self._surface.turn, self._surface.turn)

    @property
    def closed(self) -> bool:
        """Whether the triangles, after turning, leave no hole."""
        return self._surface.closed

    @property
    def triangles(self) -> Points:
        """Corners [k, 3, 3] of the triangles that count, turned so that neighbours agree."""
        counts = self._turn != 0
        corners = self.vertices[self.faces[counts]]
        return np.where(self._turn[counts, None, None] > 0, corners, corners[:, ::-1])

    def _inside_out(self) -> NDArray[np.bool_]:
        """Triangles [m] of the parts that the other side is out of."""
        _, part = np.unique(self._surface.part, return_inverse=True)
        area, volume = (np.bincount(part, weights) for weights in (self.areas, self._volumes()))
        same = (volume > 0).all() or (volume < 0).all()  # then the winding number needs no help
        if len(area) == 1 or (self._surface.closed and same):
            return np.zeros(len(part), bool)
        rng = np.random.default_rng(0)
        points, face = self._looks(part, area, rng)
        normals = self._cross[face] / np.linalg.norm(self._cross[face], axis=1, keepdims=True)
        spread = rng.normal(size=points.shape)
        spread /= np.linalg.norm(spread, axis=1, keepdims=True)
        escapes = np.zeros(len(points))
        for side in (1, -1):
            out = side * normals
            escapes += side * ~self.occluded(points + BESIDE * out, out + spread, np.inf)
        balance = np.bincount(part[face], escapes, minlength=len(area))
        looks = np.bincount(part[face], minlength=len(area))
        over = np.where(np.abs(balance) > EVIDENT * looks, balance < 0, balance.sum() < 0)
        return over[part]

    @property
    def sheets(self) -> NDArray[np.bool_]:
        """Triangles [m] of the connected parts that enclose nothing, neither alone nor together."""
        _, part = np.unique(self._surface.part, return_inverse=True)
        if self._surface.closed:
            return np.zeros(len(part), bool)
        points, face = self._looks(part, np.bincount(part, self.areas), np.random.default_rng(0))
        open_ = np.bincount(part[face], self.both_sides(points, face) < 0.5, minlength=part.max() + 1)
        return (open_ > 0.5 * np.bincount(part[face], minlength=len(open_)))[part]

    def _looks(
        self, part: NDArray[np.int64], area: NDArray[Any], rng: np.random.Generator
    ) -> tuple[Points, NDArray[np.int64]]:
        """Points on the surface and their triangles; half of them go to all parts alike, however small."""
        share = self.areas * (1 / area.sum() + 1 / (len(area) * np.maximum(area, 1e-30))[part])
        return self._sample(min(max(LOOKS, 16 * len(area)), MOST_LOOKS), share, rng)

    def _volumes(self) -> NDArray[np.float64]:
        """Signed volumes [m] of the cones from the origin to each triangle."""
        return np.einsum("nd,nd->n", self.vertices[self.faces[:, 0]], self._cross) / 6

    @property
    def report(self) -> str:
        """What was found that is not as it should be, and what was done about it; empty where all is well."""
        surface = self._surface
        found = [
            *self._defects,
            *counted(surface.holes, "hole"),
            *counted(surface.merged, "duplicate vertex", "duplicate vertices", " merged"),
            *counted(int((surface.turn == 0).sum()), "useless triangle", end=" left out"),
            *counted(surface.crowded, "edge", end=" with more than two triangles"),
            *counted(self._turned, "triangle", end=" turned over"),
            *(counted(surface.shells, "shell") if surface.shells > 1 else ()),
        ]
        if surface.closed and self._volumes().sum() < 0:
            found.append("inside out")
        points, face = self._sample(PROBES, self.areas, np.random.default_rng(0))
        both = self.both_sides(points, face)
        for state, what in (
            (both > 1.5, "within the solid"),
            (both < 0.5, "without thickness, which gets no spheres"),
        ):
            if state.mean() > NOTED:
                found.append(f"{state.mean():.0%} of the surface {what}")
        return f"{self.name}: {', '.join(found)}; inside by winding number" if found else ""

    @property
    def parts(self) -> NDArray[np.int32]:
        """Number [m] of the connected part that each triangle belongs to."""
        return self._surface.part

    def sample_parts(self, count: int, rng: np.random.Generator) -> tuple[Points, NDArray[np.int64]]:
        """Points [count, 3] by area, but some on each connected part; and the triangle [count] of each."""
        area = np.bincount(self.parts, self.areas)
        least = area.sum() * min(LEAST_SHARE, ALL_SHARES / np.count_nonzero(area))
        more = np.divide(least, area, out=np.ones_like(area), where=(area > 0) & (area < least))
        return self._sample(count, self.areas * more[self.parts], rng)

    def clearance(self, points: Points, faces: NDArray[np.int64]) -> NDArray[np.float64]:
        """Distance [n] from points on triangles to the next surface along their normals, on either side."""
        normals = self._cross[faces] / np.linalg.norm(self._cross[faces], axis=1, keepdims=True)
        ahead, behind = (self.first_hit(points + BESIDE * w, w)[0] for w in (normals, -normals))
        return BESIDE + np.minimum(ahead, behind)

    def sample_surface(self, count: int, rng: np.random.Generator) -> Points:
        """Points [count, 3] uniform by area, one in each of `count` equal shares of it in file order."""
        return self.sample_faces(count, rng)[0]

    def sample_faces(self, count: int, rng: np.random.Generator) -> tuple[Points, NDArray[np.int64]]:
        """The same points, and the triangle [count] on which each lies."""
        return self._sample(count, self.areas, rng)

    def _sample(
        self, count: int, weights: NDArray[np.float64], rng: np.random.Generator
    ) -> tuple[Points, NDArray[np.int64]]:
        """Points [count, 3] on triangles chosen by weight, and these triangles."""
        ends = np.cumsum(weights)
        share = (np.arange(count) + rng.random(count)) / count
        last = np.searchsorted(ends, ends[-1])  # what follows has no weight
        face = np.searchsorted(ends, share * ends[-1], side="right").clip(max=last)
        root, v = np.sqrt(rng.random(count)), rng.random(count)
        corner_weights = np.stack([1 - root, root * (1 - v), root * v], axis=1)
        return np.einsum("nk,nkd->nd", corner_weights, self.vertices[self.faces[face]]), face

    def inside(self, points: Points) -> NDArray[np.bool_]:
        """Which of the points [n, 3] are in the solid."""
        return np.abs(self._winding(points)) > 0.5

    def both_sides(self, points: Points, faces: NDArray[np.int64]) -> NDArray[np.float64]:
        """Sum [n] of the winding numbers on both sides of the surface, at points on triangles; its size.

        1 where the surface bounds the solid, more where it lies within the solid, 0 at open sheets.
        """
        offset = self._cross[faces] / np.linalg.norm(self._cross[faces], axis=1, keepdims=True) * BESIDE
        return np.abs(self._winding(points + offset) + self._winding(points - offset))

    def _winding(self, points: Points) -> NDArray[np.float64]:
        few = np.stack([self._crossings(points, w) for w in _directions(RAYS[0])[:3]])
        winding, unsure = few.mean(0), np.flatnonzero((few != few[0]).any(0))
        for count in RAYS[1:]:
            if len(unsure):
                total = sum(self._crossings(points[unsure], w) for w in _directions(count))
                winding[unsure] = total / count
                unsure = unsure[np.abs(np.abs(winding[unsure]) - 0.5) < UNSURE]
        return winding

    def encloses(self, points: Points) -> bool:
        """Whether points [n, 3] that are inside are so for a reason other than lying next to a sheet.

        Next to an open sheet the winding number is 1/2 and the rays' verdict is luck; more rays tell.
        """
        if not len(points):
            return False
        if self._surface.closed:
            return abs(float(self._volumes().sum())) > LEAST_VOLUME
        some = points[:: len(points) // CHECKED + 1]
        total = np.sum([self._crossings(some, w) for w in _directions(CHECK_RAYS)], axis=0)
        return bool(np.mean(np.abs(total) > 0.6 * CHECK_RAYS) > 0.05)

    def _crossings(self, points: Points, direction: NDArray[np.float64]) -> NDArray[np.float64]:
        """Surfaces that each ray leaves through, less those that it enters through."""
        sign = np.sign(self._cross @ direction.astype(np.float32))
        counts = []
        for start in range(0, len(points), BLOCK):
            rays = _rays(points[start : start + BLOCK], direction)
            hits = self._scene.list_intersections(self._tensor(rays))
            ray, face = hits["ray_ids"].numpy(), hits["primitive_ids"].numpy()
            counts.append(np.bincount(ray.astype(np.int64), sign[face], minlength=len(rays)))
        return np.concatenate(counts) if counts else np.zeros(0)

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
    """Evenly spread directions [count, 3], each followed by its opposite: of these, one meets a near sheet.

    So a sheet alone never gets beyond a winding number of 1/2, whichever way it lies.
    """
    half = fibonacci_sphere(count)[: count // 2] @ ASKEW
    return np.stack([half, -half], axis=1).reshape(-1, 3)


def _rays(origins: Points, directions: NDArray[np.float64]) -> NDArray[np.float32]:
    origins, directions = np.broadcast_arrays(origins, directions)
    return np.concatenate([origins, directions], axis=1, dtype=np.float32)


_solids: WeakKeyDictionary[Mesh, Solid] = WeakKeyDictionary()
