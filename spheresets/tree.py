"""Levels of detail over a sphere set, and a bounding hierarchy over its finest level."""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.model import Hierarchy

Array = NDArray[np.float64]

BRANCHING = 4
BLOCK = 512  # children per step of the search for parents: bounds its memory
ROUNDING = 2.0**-22  # of numbers as large as a bound's: children stay inside when all becomes float32


def level_counts(count: int, levels: int | None = None) -> list[int]:
    """Sphere counts 4, 16, 64, ... below `count`, then `count`; the last `levels` of them (None: all)."""
    counts = [count]
    power = 4
    while power < count:
        counts.insert(-1, power)
        power *= 4
    return counts if levels is None else counts[-levels:]


def parents(children: Array, above: Array) -> NDArray[np.int32]:
    """For each child [n, 4] the sphere of the level above [m, 4] in which its center lies deepest.

    Where the center is in none, that is the sphere nearest to it.
    """
    blocks = np.array_split(children, len(children) // BLOCK + 1)
    gaps = (np.linalg.norm(part[:, None, :3] - above[:, :3], axis=2) - above[:, 3] for part in blocks)
    return np.concatenate([gap.argmin(1) for gap in gaps]).astype(np.int32)


def bounding_hierarchy(spheres: Array) -> tuple[NDArray[np.int64], Hierarchy]:
    """An order of the spheres [n, 4] and a hierarchy over them in that order.

    Nodes are numbered breadth-first from the root 0; each has up to four children, all nodes or all leaves,
    from halving its spheres twice at the median of their longest extent. Bounds are tight to a few percent,
    and hold as float32, too.
    """
    order = np.arange(len(spheres))
    ranges, depths, first_child = [(0, len(spheres))], [0], []
    for start, end in ranges:  # grows while it is walked
        if end - start <= BRANCHING:
            first_child.append(-start - 1)  # leaves: numbered once the count of nodes is known
        else:
            first_child.append(len(ranges))
            depths += BRANCHING * [depths[len(first_child) - 1] + 1]
            for half in _halves(spheres, order, start, end):
                ranges += _halves(spheres, order, *half)

    m = len(ranges)
    first, depth = np.array(first_child), np.array(depths)
    count = np.where(first < 0, np.ptp(ranges, axis=1), BRANCHING)
    first = np.where(first < 0, m - 1 - first, first)
    children = first[:, None] + np.minimum(np.arange(BRANCHING), count[:, None] - 1)
    everything = np.concatenate([np.zeros((m, 4)), spheres[order]])
    for level in range(depth.max(), -1, -1):
        nodes = np.flatnonzero(depth == level)
        everything[nodes] = enclosing_spheres(everything[children[nodes]])
    bounds = everything[:m]
    centers, radii = np.ascontiguousarray(bounds[:, :3]), np.ascontiguousarray(bounds[:, 3])
    return order, Hierarchy(centers, radii, first.astype(np.int32), count.astype(np.int32))


def _halves(spheres: Array, order: NDArray[np.int64], start: int, end: int) -> list[tuple[int, int]]:
    """Sorts order[start:end] along its longest extent and splits it in the middle; one sphere stays whole."""
    part = order[start:end]
    centers = spheres[part, :3]
    axis = int(np.ptp(centers, axis=0).argmax())
    order[start:end] = part[np.argsort(centers[:, axis], kind="stable")]
    middle = (start + end) // 2
    return [(start, middle), (middle, end)]


def enclosing_spheres(groups: Array) -> Array:
    """For each group [k, n, 4] of spheres one around them all, [k, 4]; nearly the smallest.

    The iteration of Bădoiu and Clarkson (2003), pulled by the farthest point of the farthest sphere.
    """
    centers, radii = groups[:, :, :3], groups[:, :, 3]
    middle = centers[:, 0]
    for step in range(1, 65):
        reach, offset = _reach(centers, radii, middle)
        length = np.linalg.norm(offset, axis=1)
        pull = np.divide(reach, length, out=np.zeros_like(length), where=length > 0) / (step + 1)
        middle = middle + offset * pull[:, None]
    radius = _reach(centers, radii, middle)[0]
    return np.column_stack([middle, radius + ROUNDING * (np.linalg.norm(middle, axis=1) + radius)])


def _reach(centers: Array, radii: Array, middle: Array) -> tuple[Array, Array]:
    """Distance [k] from `middle` to the farthest point of each group, and the way to that sphere's center."""
    distance = np.linalg.norm(centers - middle[:, None], axis=2) + radii
    farthest = distance.argmax(1)
    rows = np.arange(len(centers))
    return distance[rows, farthest], centers[rows, farthest] - middle
