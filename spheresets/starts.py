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
    interior, depth = points.interior, points.depth
    if start:
        chosen = rng.choice(len(depth), min(max(START_POINTS, count), len(depth)), replace=False)
        interior, depth = interior[chosen], depth[chosen]
    index = np.empty(count, np.int64)
    index[0] = rng.integers(len(depth)) if start else np.argmax(depth)
    uncovered = np.full(len(depth), np.inf)
    for k in range(count):
        if k:
            index[k] = np.argmax(np.minimum(uncovered, depth + SLACK * uncovered))
        offset = interior - interior[index[k]]
        gap = np.sqrt(np.einsum("nd,nd->n", offset, offset)) - depth[index[k]]
        uncovered = np.minimum(uncovered, gap)
    return np.column_stack([interior[index], depth[index]])
