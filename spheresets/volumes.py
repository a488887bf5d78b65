"""Volumes that solid and spheres share and do not share, by samples that are dense where it matters.

Points spread evenly over a box say little about thin meshes, of which they meet next to nothing, and nothing
about spheres that leave the box. So the spheres are sampled one by one, and the solid cell by cell of an
octree that is fine along the surface.
"""

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.union import Union

Array = NDArray[np.float64]

BALL_POINTS = 100_000  # over all spheres
FIRST_CELLS, CUT_CELLS = 4096, 60_000  # at the start, and at most along the surface at the end
CUT_POINTS, WHOLE_POINTS = 120_000, 60_000  # in cells along the surface, and in those within the solid
LEVELS = 12
CHILDREN = np.stack(np.meshgrid(*3 * [[-0.5, 0.5]], indexing="ij"), axis=-1).reshape(-1, 3)


def volumes(solid: Solid, union: Union, spheres: Array, rng: np.random.Generator) -> dict[str, float]:
    """`volume_iou`, `outside_volume`, `uncovered_volume`, `sum_outside_volume`; see `metrics.measure`.

    Raises
    ------
    InvalidInput
        The mesh encloses no volume.
    """
    points, weights = solid_points(solid, rng)
    volume = float(weights.sum())
    if volume == 0:
        raise InvalidInput(f"{solid.name}: the mesh encloses no volume", "give its sheets thickness")
    _, containing = union.points(points)
    uncovered = float(weights[containing == 0].sum())

    points, weights = ball_points(spheres, rng)
    _, containing = union.points(points)
    weights[solid.inside(points)] = 0
    # A point in k spheres stands for the union k times (Karp and Luby 1983).
    outside = float((weights / np.maximum(containing, 1)).sum())
    return {
        "volume_iou": (volume - uncovered) / (volume + outside),
        "outside_volume": outside / volume,
        "uncovered_volume": uncovered / volume,
        "sum_outside_volume": float(weights.sum()) / volume,
    }


def ball_points(spheres: Array, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points [m, 3] in the spheres [n, 4], each sphere with its share, and the volumes [m] they stand for."""
    volume = 4 / 3 * np.pi * spheres[:, 3] ** 3
    counts = np.ceil(BALL_POINTS * volume / volume.sum()).astype(int)
    owner = np.repeat(np.arange(len(spheres)), counts)
    nth = np.arange(len(owner)) - np.repeat(np.cumsum(counts) - counts, counts)
    radius = spheres[owner, 3] * ((nth + rng.random(len(owner))) / counts[owner]) ** (1 / 3)
    directions = rng.normal(size=(len(owner), 3))
    directions *= (radius / np.linalg.norm(directions, axis=1))[:, None]
    return spheres[owner, :3] + directions, (volume / counts)[owner]


def solid_points(solid: Solid, rng: np.random.Generator) -> tuple[Array, Array]:
    """Points [m, 3] in the solid and the volumes [m] they stand for, which add up to its volume."""
    extent = solid.upper - solid.lower
    edge = (extent.prod() / FIRST_CELLS) ** (1 / 3)
    number = np.ceil(np.divide(extent, edge, out=np.ones(3), where=edge > 0)).clip(1, 256).astype(int)
    half = extent / number / 2
    steps = (np.arange(n) * 2 + 1 for n in number)
    cells = solid.lower + half * np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    whole = []
    for _ in range(LEVELS):
        cut = solid.distance(cells) <= np.linalg.norm(half)
        clear = cells[~cut]
        whole.append((clear[solid.inside(clear)], half))
        cells = cells[cut]
        if 8 * len(cells) > CUT_CELLS:
            break
        half = half / 2
        cells = (cells[:, None] + 2 * half * CHILDREN).reshape(-1, 3)

    points, weights = _spread(cells, half, max(1, CUT_POINTS // max(len(cells), 1)), rng)
    inside = solid.inside(points)
    drawn = [(points[inside], weights[inside])]
    total = sum(len(centers) * float((2 * half).prod()) for centers, half in whole)
    for centers, half in whole:
        if len(centers):
            drawn.append(_spread(centers, half, int(np.ceil(WHOLE_POINTS * (2 * half).prod() / total)), rng))
    points, weights = zip(*drawn, strict=True)
    return np.concatenate(points), np.concatenate(weights)


def _spread(cells: Array, half: Array, count: int, rng: np.random.Generator) -> tuple[Array, Array]:
    """`count` points in each cell (center, half of its sides) and their volumes."""
    points = (cells[:, None] + half * rng.uniform(-1, 1, (len(cells), count, 3))).reshape(-1, 3)
    return points, np.full(len(points), (2 * half).prod() / count)
