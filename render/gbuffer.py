"""Which points are shaded: the nearest surface behind every camera sample."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.render.camera import Rays, camera_rays
from coslobe.render.fields import Source
from coslobe.render.plane import locate
from coslobe.render.surface import with_surface

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Object, Scene


@dataclass(frozen=True)
class GBuffer:
    """The shaded points of one frame, in tiles of 8x8 pixels; samples that hit nothing are left out.

    Attributes
    ----------
    position : float64 [n, 3]
        World units.
    geometric_normal, shading_normal : float64 [n, 3]
        Unit vectors, turned to the viewer's side of the surface.
    view : float64 [n, 3]
        Unit vectors from the point towards the viewer.
    object, material : int32 [n]
        Indices in the order of the scene file.
    pixel : int32 [n]
        row * width + column, row 0 on top.
    depth : float64 [n]
        Distance from the camera's origin along the ray.
    triangle : int32 [n]
        Of the object's mesh.
    weights : float64 [n, 3]
        Barycentric: of the triangle's corners.
    width, height, samples : int
        Image size in pixels, and samples per pixel.
    texels : dict
        By picture, what it holds at the points, [n] or [n, 3]; 0 where no texture of it is seen.
    tangent : float64 [n, 3] or None
        Unit vectors perpendicular to the shading normal, the x of tangent frames; None where no material
        needs it.
    """

    position: NDArray
    geometric_normal: NDArray
    shading_normal: NDArray
    view: NDArray
    object: NDArray
    material: NDArray
    pixel: NDArray
    depth: NDArray
    triangle: NDArray
    weights: NDArray
    width: int
    height: int
    samples: int
    texels: Mapping[Source, NDArray] = field(default_factory=dict)
    tangent: NDArray | None = None

    def some(self, index: NDArray) -> "GBuffer":
        """The points that `index` names, in that order."""
        arrays = {
            name: getattr(self, name)[index]
            for name in (
                "position",
                "geometric_normal",
                "shading_normal",
                "view",
                "object",
                "material",
                "pixel",
                "depth",
                "triangle",
                "weights",
            )
        }
        texels = {source: values[index] for source, values in self.texels.items()}
        tangent = None if self.tangent is None else self.tangent[index]
        return replace(self, **arrays, texels=texels, tangent=tangent)

    def image(self, values: NDArray) -> NDArray:
        """Average `values` [n] or [n, c] over each pixel's samples (box filter, background 0).

        Returns float64 [h, w] or [h, w, c].
        """
        size = self.width * self.height
        columns = values.reshape(len(values), int(np.prod(values.shape[1:]))).T
        channels = [np.bincount(self.pixel, column, size) for column in columns]
        mean = np.stack(channels, axis=-1) / self.samples
        return mean.reshape(self.height, self.width, *values.shape[1:])

    def first_image(self, values: NDArray, background: float) -> NDArray:
        """`values` [n] or [n, c] of one sample of each pixel, unfiltered: for indices and normals."""
        image = np.full((self.height * self.width, *values.shape[1:]), background, values.dtype)
        image[self.pixel[::-1]] = values[::-1]  # the last write wins, so the first sample does
        return image.reshape(self.height, self.width, *values.shape[1:])


@dataclass
class _Nearest:
    """The nearest hit so far of each ray, filled object by object; normals face any side."""

    t: NDArray
    position: NDArray
    geometric_normal: NDArray
    shading_normal: NDArray
    object: NDArray
    material: NDArray
    triangle: NDArray
    weights: NDArray

    def accept(self, rays: NDArray, index: int, material: int, hits: "_Hits") -> None:
        self.t[rays] = hits.t
        self.position[rays] = hits.position
        self.geometric_normal[rays] = hits.geometric_normal
        self.shading_normal[rays] = hits.shading_normal
        self.object[rays] = index
        self.material[rays] = material
        self.triangle[rays] = hits.triangle
        self.weights[rays] = hits.weights


@dataclass(frozen=True)
class _Hits:
    t: NDArray
    position: NDArray
    geometric_normal: NDArray
    shading_normal: NDArray
    triangle: NDArray
    weights: NDArray


def trace_gbuffer(scene: "Scene", assets: "Assets") -> GBuffer:
    """Find the nearest surface behind every camera sample.

    Each object is traced in its own frame, so that meshes need one acceleration structure for all frames
    and instances, and positions come from barycentric coordinates in float64.

    Raises
    ------
    InvalidInput
        A texture or a tangent frame is missing; see `with_surface`.
    """
    rays = camera_rays(scene)
    n = len(rays.direction)
    zeros = np.zeros((n, 3))
    nearest = _Nearest(
        np.full(n, np.inf),
        zeros,
        zeros.copy(),
        zeros.copy(),
        np.full(n, -1, np.int32),
        np.zeros(n, np.int32),
        np.zeros(n, np.int32),
        zeros.copy(),
    )
    materials = {name: index for index, name in enumerate(scene.materials)}
    for index, obj in enumerate(scene.objects.values()):
        if obj.visible:
            hit_object = _hit_plane if obj.plane is not None else _hit_mesh
            hit_object(obj, index, materials[obj.material], assets, rays, nearest)
    return with_surface(_turned_to_viewer(scene, rays, nearest), scene, assets)


def _hit_plane(
    obj: "Object", index: int, material: int, assets: "Assets", rays: Rays, nearest: _Nearest
) -> None:
    """The square y = 0 of the object's frame, intersected in closed form."""
    assert obj.plane is not None
    matrix = obj.transform.matrix()
    linear, translation = matrix[:3, :3], matrix[:3, 3]
    inverse = np.linalg.inv(linear)
    origin = inverse @ (rays.origin - translation)
    with np.errstate(divide="ignore", invalid="ignore"):
        t = -origin[1] / (rays.direction @ inverse[1])
        candidates = np.flatnonzero((t > 0) & (t < nearest.t))
    t = t[candidates]
    local = origin + t[:, None] * (rays.direction[candidates] @ inverse.T)
    local[:, 1] = 0.0  # where rounding left a trace of height
    half = obj.plane.size / 2
    inside = np.flatnonzero((np.abs(local[:, 0]) <= half) & (np.abs(local[:, 2]) <= half))
    hit, local = candidates[inside], local[inside]
    normal = inverse.T @ np.array([0.0, 1.0, 0.0])
    normals = np.broadcast_to(normal / np.linalg.norm(normal), (len(hit), 3))
    place = locate(obj.plane, local[:, 0], local[:, 2])
    hits = _Hits(t[inside], local @ linear.T + translation, normals, normals, *place)
    nearest.accept(hit, index, material, hits)


def _hit_mesh(
    obj: "Object", index: int, material: int, assets: "Assets", rays: Rays, nearest: _Nearest
) -> None:
    """A triangle mesh, intersected by Embree in the object's frame; t is the same in both frames."""
    mesh = assets.mesh(obj)
    caster = assets.raycaster(obj)
    matrix = obj.transform.matrix()
    linear, translation = matrix[:3, :3], matrix[:3, 3]
    inverse = np.linalg.inv(linear)
    origin = inverse @ (rays.origin - translation)
    candidates = _near_mesh(mesh.vertices, matrix, rays)
    direction = rays.direction[candidates] @ inverse.T
    length = np.linalg.norm(direction, axis=1)  # 1 / scale: Embree is given unit directions
    t, triangle, u, v = caster.nearest(origin, direction / length[:, None])
    t = t / length
    hit = np.flatnonzero(t < nearest.t[candidates])
    triangle = triangle[hit]
    weights = np.stack([1 - u[hit] - v[hit], u[hit], v[hit]], axis=1)
    corners = mesh.faces[triangle]
    a, b, c = (mesh.vertices[corners[:, k]] for k in range(3))
    local = np.einsum("nk,nkd->nd", weights, mesh.vertices[corners])
    geometric = np.cross(b - a, c - a)
    if obj.normals == "flat":
        smooth = geometric
    else:
        smooth = np.einsum("nk,nkd->nd", weights, mesh.normals[corners])
        smooth = np.where(np.linalg.norm(smooth, axis=1, keepdims=True) > 1e-6, smooth, geometric)
    position = local @ linear.T + translation
    normals = _unit(geometric @ inverse), _unit(smooth @ inverse)
    hits = _Hits(t[hit], position, *normals, triangle.astype(np.int32), weights)
    nearest.accept(candidates[hit], index, material, hits)


def _near_mesh(vertices: NDArray, matrix: NDArray, rays: Rays) -> NDArray:
    """Indices of the rays that meet the sphere around the box of `vertices`, moved by `matrix`."""
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    corners = np.array(
        [[x, y, z] for x in (low[0], high[0]) for y in (low[1], high[1]) for z in (low[2], high[2])]
    )
    corners = corners @ matrix[:3, :3].T + matrix[:3, 3]
    centre = corners.mean(axis=0)
    radius = np.linalg.norm(corners - centre, axis=1).max() * (1 + 1e-6)
    to_centre = centre - rays.origin
    tangent2 = to_centre @ to_centre - radius * radius
    if tangent2 <= 0:
        return np.arange(len(rays.direction))
    return np.flatnonzero(rays.direction @ to_centre >= np.sqrt(tangent2))


def _unit(vectors: NDArray) -> NDArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _turned_to_viewer(scene: "Scene", rays: Rays, nearest: _Nearest) -> GBuffer:
    hit = np.flatnonzero(nearest.object >= 0)
    view = -rays.direction[hit]
    geometric, shading = nearest.geometric_normal[hit], nearest.shading_normal[hit]
    geometric = geometric * np.where(_dot(geometric, view) < 0, -1.0, 1.0)[:, None]
    # The file's normals need not agree with its winding: they are taken to the side of the true surface.
    shading = shading * np.where(_dot(shading, geometric) < 0, -1.0, 1.0)[:, None]
    return GBuffer(
        position=nearest.position[hit],
        geometric_normal=geometric,
        shading_normal=shading,
        view=view,
        object=nearest.object[hit],
        material=nearest.material[hit],
        pixel=rays.pixel[hit],
        depth=nearest.t[hit],
        triangle=nearest.triangle[hit],
        weights=nearest.weights[hit],
        width=scene.image.width,
        height=scene.image.height,
        samples=scene.image.samples,
    )


def _dot(a: NDArray, b: NDArray) -> NDArray:
    return np.einsum("ij,ij->i", a, b)


class RayCaster:
    """Nearest hits against one mesh by Embree (through Open3D), in a frame centred on the mesh."""

    def __init__(self, vertices: NDArray, faces: NDArray) -> None:
        import open3d

        self._tensor: Any = open3d.core.Tensor
        self._centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        extent = np.max(vertices.max(axis=0) - vertices.min(axis=0))
        self._scale = 1.0 / extent if extent > 0 else 1.0
        local = ((vertices - self._centre) * self._scale).astype(np.float32)
        self._scene: Any = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._tensor(local), self._tensor(faces.astype(np.uint32)))

    def nearest(self, origin: NDArray, direction: NDArray) -> tuple[NDArray, NDArray, NDArray, NDArray]:
        """Distance (inf: no hit), triangle and barycentric u, v of rays from `origin` [3] along [n, 3]."""
        origin = (origin - self._centre) * self._scale
        start = np.maximum(-(direction @ origin) - 1, 0)  # the mesh begins there; a far origin has no digits
        rays = np.empty((len(direction), 6), np.float32)
        rays[:, :3] = origin + start[:, None] * direction
        rays[:, 3:] = direction
        answer = self._scene.cast_rays(self._tensor(rays))
        t = (answer["t_hit"].numpy() + start) / self._scale
        uv = answer["primitive_uvs"].numpy().astype(np.float64)
        return t, answer["primitive_ids"].numpy(), uv[:, 0], uv[:, 1]
