"""What a ray from anywhere meets first: the surfaces that reflect light from one to another."""

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.occlusion import RAY_OFFSET, ROUNDING_OFFSET, box
from coslobe.render.gbuffer import GBuffer
from coslobe.render.surface import with_surface

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Scene


class Surfaces:
    """The triangles of all visible objects, also of those that do not occlude, in one Embree scene.

    Embree works in float32, so everything is moved to the middle and scaled to unit size; what is met is then
    worked out in float64.
    """

    def __init__(self, scene: "Scene", assets: "Assets") -> None:
        import open3d

        self._scene = scene
        self._assets = assets
        self._tensor: Any = open3d.core.Tensor
        self._embree: Any = open3d.t.geometry.RaycastingScene()
        names = list(scene.materials)
        objects = [(index, obj) for index, obj in enumerate(scene.objects.values()) if obj.visible]
        meshes = [assets.mesh(obj) for _, obj in objects]
        matrices = [obj.transform.matrix() for _, obj in objects]
        moved = [mesh.vertices @ m[:3, :3].T + m[:3, 3] for mesh, m in zip(meshes, matrices, strict=True)]
        # The inverse transpose; its length does not matter.
        normals = [mesh.normals @ np.linalg.inv(m[:3, :3]) for mesh, m in zip(meshes, matrices, strict=True)]
        first = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
        self._first_face = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
        self._faces = _stacked([mesh.faces + k for mesh, k in zip(meshes, first, strict=False)], np.int64)
        self._vertices, self._normals = _stacked(moved, np.float64), _stacked(normals, np.float64)
        self._object = np.array([index for index, _ in objects], np.int32)
        self._material = np.array([names.index(obj.material) for _, obj in objects], np.int32)
        self._flat = np.array([obj.normals == "flat" for _, obj in objects])
        self._origin, radius = box(self._vertices if len(self._vertices) else np.zeros((1, 3)))
        self._scale = 1 / radius if radius > 0 else 1.0
        self._offset = np.full(len(scene.objects), 2 * ROUNDING_OFFSET * radius)
        for (index, obj), vertices in zip(objects, moved, strict=True):
            if obj.mesh is not None:
                self._offset[index] = max(2 * RAY_OFFSET * box(vertices)[1], self._offset[index])
        if len(self._faces):
            local = ((self._vertices - self._origin) * self._scale).astype(np.float32)
            self._embree.add_triangles(self._tensor(local), self._tensor(self._faces.astype(np.uint32)))

    def nearest(self, start: GBuffer, direction: NDArray) -> tuple[NDArray, NDArray, GBuffer]:
        """What unit directions [n, 3] from the points `start` meet first.

        Returns
        -------
        rays : int64 [m]
            Those that meet a surface.
        distance : float64 [m]
        hits : GBuffer
            Where; `view` looks back along the ray, normals are turned to that side, `pixel` is the start's.
        """
        rays = np.empty((len(direction), 6), np.float32)
        position = start.position + self._offset[start.object][:, None] * start.geometric_normal
        rays[:, :3] = (position - self._origin) * self._scale
        rays[:, 3:] = direction
        answer = self._embree.cast_rays(self._tensor(rays))
        face = answer["primitive_ids"].numpy()
        met = np.flatnonzero(face < len(self._faces))
        face = face[met].astype(np.int64)
        uv = answer["primitive_uvs"].numpy()[met].astype(np.float64)
        weights = np.stack([1 - uv.sum(axis=1), uv[:, 0], uv[:, 1]], axis=1)
        part = np.searchsorted(self._first_face, face, side="right") - 1
        corners = self._faces[face]
        a, b, c = (self._vertices[corners[:, k]] for k in range(3))
        geometric = np.cross(b - a, c - a)
        smooth = np.einsum("nk,nkd->nd", weights, self._normals[corners])
        length = np.linalg.norm(smooth, axis=1)
        flat = self._flat[part] | (length <= 1e-6 * np.linalg.norm(self._normals[corners[:, 0]], axis=1))
        shading = np.where(flat[:, None], geometric, smooth)
        view = -direction[met]
        geometric = _towards(_unit(geometric), view)
        hits = replace(
            start,
            position=weights[:, 0:1] * a + weights[:, 1:2] * b + weights[:, 2:3] * c,
            geometric_normal=geometric,
            shading_normal=_towards(_unit(shading), geometric),
            view=view,
            object=self._object[part],
            material=self._material[part],
            pixel=start.pixel[met],
            depth=answer["t_hit"].numpy()[met] / self._scale,
            triangle=(face - self._first_face[part]).astype(np.int32),
            weights=weights,
            texels={},
            tangent=None,
        )
        return met, hits.depth, with_surface(hits, self._scene, self._assets)


def _stacked(arrays: list[NDArray], dtype: Any) -> NDArray:
    return np.concatenate([np.empty((0, 3), dtype), *arrays])


def _towards(vectors: NDArray, side: NDArray) -> NDArray:
    """`vectors` or their opposites, whichever lie on the given side."""
    return vectors * np.where(np.einsum("ij,ij->i", vectors, side) < 0, -1.0, 1.0)[:, None]


def _unit(vectors: NDArray) -> NDArray:
    return vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
