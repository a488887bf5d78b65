"""Rays against one mesh, and which rays can hit it at all."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.render.camera import BLOCK, Rays, turned

CELLS = 8  # along each side of a mesh's box: what its outline in a picture is taken from
SIDES = 16  # of the polygon around the outline
AT_ONCE = 1 << 13  # rays: for 1 to 2 ms, in which no other thread can run Python


class RayCaster:
    """Nearest hits against one mesh by Embree (through Open3D), in a frame centred on the mesh.

    Attributes
    ----------
    hull : float64 [n, 3]
        Corners of boxes that hold all triangles, in the mesh's coordinates.
    """

    def __init__(self, vertices: NDArray, faces: NDArray) -> None:
        import open3d

        self.hull = _boxes(vertices, faces)
        self._tensor: Any = open3d.core.Tensor
        self._centre = (vertices.min(axis=0) + vertices.max(axis=0)) / 2
        extent = np.max(vertices.max(axis=0) - vertices.min(axis=0))
        self._scale = 1.0 / extent if extent > 0 else 1.0
        local = ((vertices - self._centre) * self._scale).astype(np.float32)
        self._scene: Any = open3d.t.geometry.RaycastingScene()
        self._scene.add_triangles(self._tensor(local), self._tensor(faces.astype(np.uint32)))

    def nearest(self, origin: NDArray, direction: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        """Distance (inf: no hit) [n], triangle [n] and barycentric u, v [n, 2] of rays.

        From `origin` [3] along the unit vectors `direction` [3, n]; float64, int32 and float32.
        """
        n = direction.shape[1]
        t, triangle, uv = np.empty(n), np.empty(n, np.int32), np.empty((n, 2), np.float32)
        for first in range(0, n, AT_ONCE):
            part = slice(first, first + AT_ONCE)
            t[part], triangle[part], uv[part] = self._cast(origin, direction[:, part])
        return t, triangle, uv

    def _cast(self, origin: NDArray, direction: NDArray) -> tuple[NDArray, NDArray, NDArray]:
        origin = (origin - self._centre) * self._scale
        towards = turned(-origin[None], direction)[0]
        start = np.maximum(towards - 1, 0)  # the mesh begins there; a far origin has no digits
        rays = np.empty((len(start), 6), np.float32)
        for axis in range(3):
            rays[:, axis] = origin[axis] + start * direction[axis]
            rays[:, 3 + axis] = direction[axis]
        answer = self._scene.cast_rays(self._tensor.from_numpy(rays))
        t = (answer["t_hit"].numpy() + start) / self._scale
        return t, answer["primitive_ids"].numpy(), answer["primitive_uvs"].numpy()


def _boxes(vertices: NDArray, faces: NDArray) -> NDArray:
    """Corners [8 m, 3] of the boxes around the triangles whose centres share a cell."""
    corners = vertices[faces]
    low, high = corners.min(axis=1), corners.max(axis=1)
    middle = (low + high) / 2
    origin, extent = middle.min(axis=0), np.ptp(middle, axis=0)
    place = (middle - origin) / np.where(extent > 0, extent, 1) * CELLS
    cell = np.minimum(place, CELLS - 1).astype(np.int64) @ [CELLS * CELLS, CELLS, 1]
    order = np.argsort(cell, kind="stable")
    starts = np.flatnonzero(np.diff(cell[order], prepend=-1))
    lows, highs = np.minimum.reduceat(low[order], starts), np.maximum.reduceat(high[order], starts)
    upper = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], bool)
    return np.where(upper, highs[:, None], lows[:, None]).reshape(-1, 3)


def near_rays(hull: NDArray, matrix: NDArray, rays: Rays) -> NDArray:
    """Indices of the rays that may hit what lies in the convex hull of `hull` [n, 3], moved by `matrix`.

    Whole blocks, by a polygon around the hull's picture; all rays where a part of it is behind the camera.
    """
    seen = (hull @ matrix[:3, :3].T + (matrix[:3, 3] - rays.origin)) @ rays.frame.T
    reach = np.abs(seen).max()
    if seen[:, 2].min() <= 1e-6 * reach:
        return np.arange(len(rays.pixel))
    angle = np.arange(SIDES) * (2 * np.pi / SIDES)
    normals = np.stack([np.cos(angle), np.sin(angle)])
    slopes = seen[:, :2] / seen[:, 2:]
    support = (slopes @ normals).max(axis=0) + 1e-6 * (1 + np.abs(slopes).max())
    low, high = rays.blocks
    nearest = low @ np.maximum(normals, 0) + high @ np.minimum(normals, 0)  # of a block along each normal
    near = np.flatnonzero((nearest <= support).all(axis=1))
    index = (near[:, None] * BLOCK + np.arange(BLOCK)).ravel()
    return index[: np.searchsorted(index, len(rays.pixel))]
