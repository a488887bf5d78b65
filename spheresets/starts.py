"""Where a fit starts: balls inside the solid, one after another where most is uncovered."""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.samples import PointSamples

Array = NDArray[np.float64]

SLACK = 0.35  # how much a start prefers uncovered places to deep ones
START_POINTS = 2000  # interior points for the starts after the first


def greedy_start(points: PointSamples, count: int, start: int, rng: np.random.Generator) -> Array:
    """Balls inside the solid, one after another where most is uncovered, [count, 4].

    Start 0 begins with the largest of all; other starts choose among fewer points and begin anywhere.
    """
    from scipy.spatial import KDTree

    interior, depth = points.interior, points.depth
    if start:
        chosen = rng.choice(len(depth), min(max(START_POINTS, count), len(depth)), replace=False)
        interior, depth = interior[chosen], depth[chosen]
    tree = KDTree(interior) if start else points.tree
    index = np.empty(count, np.int64)
    best = rng.integers(len(depth)) if start else np.argmax(depth)
    uncovered, score = (np.full(len(depth), np.inf) for _ in range(2))
    for k in range(count):
        index[k] = best
        # A ball changes only what is closer to it than the farthest point is from all balls before it.
        near = tree.query_ball_point(interior[best], depth[best] + uncovered.max(), return_sorted=False)
        gap = np.linalg.norm(interior[near] - interior[best], axis=1) - depth[best]
        uncovered[near] = np.minimum(uncovered[near], gap)
        score[near] = np.minimum(uncovered[near], depth[near] + SLACK * uncovered[near])
        best = np.argmax(score)
    return np.column_stack([interior[index], depth[index]])
