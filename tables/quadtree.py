"""The quadtree of shadow leaves over a light (Sec. 5.3), as an AND-pyramid of the mask's cells.

The root is the square [-1, 1]^2 that circumscribes the light's disk; depth d has 2^d blocks along each side.
Cells outside the disk belong to no light: they count as covered where blocks are merged, so that a covered
disk is one leaf, and are no leaves themselves.
"""

import numpy as np
from numpy.typing import NDArray


def cell_centres(rows: int) -> NDArray:
    """Coordinates of the centres of `rows` cells along one side of the square, float64 [rows]."""
    return (np.arange(rows) + 0.5) * 2 / rows - 1


def disk(rows: int) -> NDArray:
    """Cells whose centre lies in the light's disk, bool [rows, rows]."""
    x = cell_centres(rows)
    return x[:, None] ** 2 + x**2 <= 1


def blocks_of_disk(rows: int) -> list[NDArray]:
    """Per depth, from the root: the blocks that hold a cell of the disk, bool [2^d, 2^d]."""
    return [~outside for outside in _pyramid(~disk(rows))]


def shadow_leaves(blocked: NDArray) -> list[NDArray]:
    """Per depth, from the root: the largest blocks that are wholly blocked, bool [..., 2^d, 2^d].

    `blocked` are the cells of masks, bool [..., rows, rows]. The device's twin is leaves.cl.
    """
    rows = blocked.shape[-1]
    whole = _pyramid(blocked | ~disk(rows))
    parents = [np.zeros_like(whole[0]), *(level.repeat(2, -1).repeat(2, -2) for level in whole[:-1])]
    blocks = blocks_of_disk(rows)
    return [level & ~above & part for level, above, part in zip(whole, parents, blocks, strict=True)]


def _pyramid(cells: NDArray) -> list[NDArray]:
    """Per depth, from the root: blocks all of whose cells are set."""
    levels = [cells]
    while levels[-1].shape[-1] > 1:
        rows = levels[-1][..., ::2, :] & levels[-1][..., 1::2, :]
        levels.append(rows[..., ::2] & rows[..., 1::2])
    return levels[::-1]
