"""Which points are shaded: the nearest surface behind every camera sample, in float64 on the host."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.render.camera import Part, turned
from coslobe.render.fields import Source
from coslobe.render.hits import Hits, Layer, Tracer
from coslobe.render.plane import locate
from coslobe.render.surface import with_surface

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Object, Scene


@dataclass(frozen=True, eq=False)
class GBuffer:
    """The shaded points of one frame, in tiles of 8x8 pixels; samples that hit nothing are left out.

    `len` is their number.

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

    def __len__(self) -> int:
        return len(self.object)

    def on(self, index: int) -> tuple[NDArray, NDArray, NDArray]:
        """Which points lie on an object [m], their triangles [m] and the weights of the corners [m, 3]."""
        here = np.flatnonzero(self.object == index)
        return here, self.triangle[here], self.weights[here]

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


def trace_gbuffer(scene: "Scene", assets: "Assets") -> GBuffer:
    """Find the nearest surface behind every camera sample.

    Raises
    ------
    InvalidInput
        A texture or a tangent frame is missing; see `with_surface`.
    """
    whole = Part(0, scene.image.width * scene.image.height)
    gbuffer = resolve(scene, assets, Tracer(assets).hits(scene, whole))
    return with_surface(gbuffer, scene, assets)


def resolve(scene: "Scene", assets: "Assets", hits: Hits) -> GBuffer:
    """The points behind `hits`, without texels and tangents.

    Positions come from barycentric coordinates or distances in float64; kernels/visible.cl does the same.
    """
    ray = np.flatnonzero(hits.object >= 0)
    number = np.zeros(len(hits.object), np.int64)
    number[ray] = np.arange(len(ray))
    position, geometric, shading, weights = (np.zeros((len(ray), 3)) for _ in range(4))
    triangle, material = np.zeros((2, len(ray)), np.int32)
    names = list(scene.materials)
    for index, obj in enumerate(scene.objects.values()):
        if index in hits.layers:
            layer, entries = hits.layers[index], hits.of(index)
            here = number[layer.ray[entries]]
            triangle[here], weights[here] = corners(obj, hits, layer, entries)
            if obj.plane is not None:
                along = hits.rays.local[:, layer.ray[entries]]
                position[here] = hits.rays.origin + (layer.t[entries] * turned(hits.rays.frame.T, along)).T
                geometric[here] = shading[here] = _unit(np.linalg.inv(obj.transform.matrix()[:3, :3])[1:2])
            else:
                surface = _on_mesh(obj, assets, triangle[here], weights[here])
                position[here], geometric[here], shading[here] = surface
            material[here] = names.index(obj.material)
    view = -turned(hits.rays.frame.T, hits.rays.local[:, ray]).T
    geometric *= np.where(_dot(geometric, view) < 0, -1.0, 1.0)[:, None]
    # The file's normals need not agree with its winding: they are taken to the side of the true surface.
    shading *= np.where(_dot(shading, geometric) < 0, -1.0, 1.0)[:, None]
    return GBuffer(
        position=position,
        geometric_normal=geometric,
        shading_normal=shading,
        view=view,
        object=hits.object[ray],
        material=material,
        pixel=hits.rays.pixel[ray],
        depth=hits.t[ray],
        triangle=triangle,
        weights=weights,
        width=scene.image.width,
        height=scene.image.height,
        samples=scene.image.samples,
    )


def corners(obj: "Object", hits: Hits, layer: Layer, entries: NDArray) -> tuple[NDArray, NDArray]:
    """Triangles [m] and the weights of their corners [m, 3] of some `entries` of an object's layer."""
    if layer.uv is not None and layer.triangle is not None:
        u, v = layer.uv[entries].astype(np.float64).T
        return layer.triangle[entries], np.stack([1 - u - v, u, v], axis=1)
    assert obj.plane is not None
    matrix = obj.transform.matrix()
    inverse = np.linalg.inv(matrix[:3, :3])
    origin = inverse @ (hits.rays.origin - matrix[:3, 3])
    x, _, z = turned(inverse @ hits.rays.frame.T, hits.rays.local[:, layer.ray[entries]])
    t = layer.t[entries]
    return locate(obj.plane, origin[0] + t * x, origin[2] + t * z)


def _on_mesh(
    obj: "Object", assets: "Assets", triangle: NDArray, weights: NDArray
) -> tuple[NDArray, NDArray, NDArray]:
    """Position, geometric and shading normal, [m, 3] each; normals face any side."""
    mesh, matrix = assets.mesh(obj), obj.transform.matrix()
    inverse = np.linalg.inv(matrix[:3, :3])
    three = mesh.faces[triangle]
    a, b, c = (mesh.vertices[three[:, k]] for k in range(3))
    geometric = np.cross(b - a, c - a)
    smooth = geometric
    if obj.normals == "smooth":
        smooth = np.einsum("nk,nkd->nd", weights, mesh.normals[three])
        smooth = np.where(np.linalg.norm(smooth, axis=1, keepdims=True) > 1e-6, smooth, geometric)
    local = np.einsum("nk,nkd->nd", weights, mesh.vertices[three])
    return local @ matrix[:3, :3].T + matrix[:3, 3], _unit(geometric @ inverse), _unit(smooth @ inverse)


def _unit(vectors: NDArray) -> NDArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)


def _dot(a: NDArray, b: NDArray) -> NDArray:
    return np.einsum("ij,ij->i", a, b)
