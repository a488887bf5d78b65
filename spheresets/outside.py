"""How far spheres reach out of the solid."""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.solid import Solid

TOLERANCE = 0.003  # of the bounding box's diagonal
HOLE = 0.01  # patches of this size are looked at one by one where the solid can end at a hole
BLOCK = 1024  # spheres that are refined together: bounds the memory

Array = NDArray[np.float64]


def outside_distances(solid: Solid, spheres: Array) -> Array:
    """Largest distance [n] outside the solid over the surface of each sphere [n, 4]; 0 where none is outside.

    Unit coordinates. At most TOLERANCE too small: no point of a patch of the sphere is farther out than the
    patch's middle by more than the patch's radius, so patches are split until none can beat the farthest
    middle by more. Only at holes of the surface, where the solid ends without one, patches smaller than HOLE
    may be missed. The whole sphere counts, whether or not another one holds it.
    """
    parts = np.array_split(spheres, len(spheres) // BLOCK + 1)
    return np.concatenate([_farthest(solid, part) for part in parts])


def _farthest(solid: Solid, spheres: Array) -> Array:
    farthest = np.zeros(len(spheres))
    patches = np.tile(_split(_octahedron()), (len(spheres), 1, 1))
    owner = np.repeat(np.arange(len(spheres)), len(patches) // len(spheres))
    while len(owner):
        middle = patches.sum(1)
        middle /= np.linalg.norm(middle, axis=1, keepdims=True)
        size = spheres[owner, 3] * np.linalg.norm(patches - middle[:, None], axis=2).max(1)
        out = solid.signed_distance(spheres[owner, :3] + spheres[owner, 3:] * middle)
        np.maximum.at(farthest, owner, out)
        within = np.where(solid.closed | (size < HOLE), out, np.abs(out))
        kept = within + size > farthest[owner] + TOLERANCE
        patches = _split(patches[kept])
        owner = np.repeat(owner[kept], 4)
    return farthest


def _octahedron() -> Array:
    """Corners [8, 3, 3] of the faces of an octahedron in the unit sphere."""
    signs = np.stack(np.meshgrid([-1.0, 1.0], [-1.0, 1.0], [-1.0, 1.0], indexing="ij"), -1).reshape(8, 3)
    return signs[:, :, None] * np.eye(3)


def _split(triangles: Array) -> Array:
    """Four spherical triangles [4 m, 3, 3] for each of [m, 3, 3], in a row."""
    middles = triangles + np.roll(triangles, -1, axis=1)
    middles /= np.linalg.norm(middles, axis=2, keepdims=True)
    corners = [np.stack([triangles[:, k], middles[:, k], middles[:, k - 1]], axis=1) for k in range(3)]
    return np.stack([*corners, middles], axis=1).reshape(-1, 3, 3)
