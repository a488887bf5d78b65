"""The visibility mask on the host: bits, and float64 twins of the device's rasterisation.

Conventions are those of kernels/mask.cl; a mask here is a boolean array [rows, columns], True = blocked.
"""

import numpy as np
from numpy.typing import NDArray

from coslobe.tables.quadtree import blocks_of_disk, cell_centres

# How an interval [low, high] in cell units becomes whole cells: from ceil(low + a) to floor(high + b).
ROUNDING = {
    "centre": (-0.5, -0.5),  # cells whose centre is covered
    "aggressive": (0.0, -1.0),  # cells that are covered along the whole row
    "conservative": (-1.0, 0.0),  # cells that are touched along the row
}


def pack(cells: NDArray) -> NDArray:
    """Boolean [rows, columns <= 32] to uint32 [rows], column 0 in the lowest bit."""
    weights = np.uint32(1) << np.arange(cells.shape[1], dtype=np.uint32)
    return (cells * weights).sum(axis=1, dtype=np.uint32)


def disk_tree(rows: int) -> NDArray:
    """The blocks that hold a cell of the light's disk, as a tree of leaves.cl: uint32 [2 rows - 1]."""
    levels = []
    for blocks in reversed(blocks_of_disk(rows)):
        first_columns = np.zeros((len(blocks), rows), bool)
        first_columns[:, :: rows // len(blocks)] = blocks
        levels.append(pack(first_columns))
    return np.concatenate(levels)


def unpack(bits: NDArray, columns: int) -> NDArray:
    """Inverse of `pack`: uint32 [..., rows] to bool [..., rows, columns]."""
    return (bits[..., None] >> np.arange(columns, dtype=np.uint32) & 1).astype(bool)


def directions(rows: int, h: float) -> NDArray:
    """Unit vectors to the cells' centres in the mask's frame, float64 [rows, rows, 3]."""
    x = cell_centres(rows) * h
    vectors = np.stack(np.broadcast_arrays(x[None, :], x[:, None], 1.0), axis=-1)
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


def covered_by_sphere(rows: int, h: float, centre: NDArray, radius: float) -> NDArray:
    """Cells whose centre's direction meets the sphere, straight from the cone test: bool [rows, rows].

    Inside the sphere (|centre| < radius) the half-space towards its centre counts as covered.
    """
    along = directions(rows, h) @ centre
    tau = max(centre @ centre - radius * radius, 0.0)
    return (along > 0) & (along * along >= tau)


def below_horizon(rows: int, h: float, normal: NDArray) -> NDArray:
    """Cells whose centre's direction lies below the plane with this normal: bool [rows, rows]."""
    return directions(rows, h) @ normal < 0


def frame_around(axis: NDArray, turn: float) -> tuple[NDArray, NDArray]:
    """Unit vectors t and u that complete `axis` [3] to a right-handed frame, turned about it."""
    sign = np.copysign(1.0, axis[2])
    k = -1 / (sign + axis[2])
    b = axis[0] * axis[1] * k
    t = np.array([1 + sign * axis[0] ** 2 * k, sign * b, -sign * axis[0]])
    u = np.array([b, sign + axis[1] ** 2 * k, -axis[1]])
    cosine, sine = np.cos(2 * np.pi * turn), np.sin(2 * np.pi * turn)
    return cosine * t + sine * u, cosine * u - sine * t


def turns(pixel: NDArray, width: int) -> NDArray:
    """By how much the masks of each pixel are turned, in [0, 1): fixed per pixel, unlike its neighbours'.

    A shadow edge along the mask's rows would otherwise show as one band per row in a wide penumbra. The
    sequence is the interleaved gradient noise of Jimenez 2014; frames share it, so nothing flickers.
    """
    row, column = np.divmod(np.asarray(pixel, np.int64), width)
    return np.modf(52.9829189 * np.modf(0.06711056 * column + 0.00583715 * row)[0])[0]
