"""Nearest spheres by power distance |p - c|^2 - r^2: negative inside a sphere, and easy to search."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

LEAF = 32  # spheres that are tried one by one: half the time of scipy's 10


def nearest_by_power(spheres: Array) -> Callable[[Array, int], NDArray[np.int64]]:
    """Makes a function that names the k spheres of [n, 4] nearest to points [m, 3], as [m, min(k, n)].

    Lifting each center to (c, sqrt(max r^2 - r^2)) turns the power distance into an ordinary one.
    """
    from scipy.spatial import KDTree

    r2 = spheres[:, 3] ** 2
    tree = KDTree(np.column_stack([spheres[:, :3], np.sqrt(r2.max() - r2)]), leafsize=LEAF)

    def nearest(points: Array, k: int) -> NDArray[np.int64]:
        k = min(k, len(spheres))
        found = tree.query(np.column_stack([points, np.zeros(len(points))]), k=k)[1]
        return np.reshape(found, (len(points), k))

    return nearest
