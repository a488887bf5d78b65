"""The square of the scene file as a grid of triangles, and where a point lies in it."""

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.render.scene import Plane
from coslobe.spheresets.mesh import Mesh


def plane_mesh(plane: Plane) -> Mesh:
    """The square in y = 0 as resolution x resolution cells of two triangles, facing +y."""
    n = plane.resolution
    ticks = (np.arange(n + 1) / n - 0.5) * plane.size
    z, x = np.meshgrid(ticks, ticks, indexing="ij")
    vertices = np.stack([x.ravel(), np.zeros(x.size), z.ravel()], axis=-1)
    row, column = np.divmod(np.arange(n * n), n)
    corner = row * (n + 1) + column
    near, far = corner + n + 1, corner  # towards +z and -z
    triangles = [np.stack([near, near + 1, far + 1], -1), np.stack([near, far + 1, far], -1)]
    faces = np.stack(triangles, axis=1).reshape(-1, 3).astype(np.int32)
    normals = np.tile([0.0, 1.0, 0.0], (len(vertices), 1))
    uv = np.stack([x.ravel(), -z.ravel()], axis=-1) / plane.size + 0.5  # v grows away from the viewer at +z
    digest = cache.digest("plane", plane.size, plane.resolution)
    return Mesh(vertices, faces, normals, "plane", digest, uv)


def locate(plane: Plane, x: NDArray, z: NDArray) -> tuple[NDArray, NDArray]:
    """Triangle [n] of `plane_mesh` and weights of its corners [n, 3] at points [n] of the square."""
    n = plane.resolution
    across, down = ((c / plane.size + 0.5) * n for c in (x, z))
    column, row = (np.clip(np.floor(c), 0, n - 1).astype(np.int64) for c in (across, down))
    fx, fz = across - column, down - row
    second = fx + fz < 1  # the far triangle of the cell
    first_weights = np.stack([1 - fx, fx + fz - 1, 1 - fz], axis=1)
    second_weights = np.stack([fz, fx, 1 - fx - fz], axis=1)
    weights = np.where(second[:, None], second_weights, first_weights)
    return (2 * (row * n + column) + second).astype(np.int32), weights
