"""Evenly spread unit vectors, the same ones every time."""

import numpy as np
from numpy.typing import NDArray


def fibonacci_sphere(count: int) -> NDArray[np.float64]:
    """`count` unit vectors [count, 3] on the spherical Fibonacci lattice, equal areas each."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    azimuth = np.pi * (3 - np.sqrt(5)) * k
    ring = np.sqrt(1 - z * z)
    return np.stack([ring * np.cos(azimuth), ring * np.sin(azimuth), z], axis=1)


def frames(normals: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Two unit tangents [n, 3] for each unit normal; (s, t, normal) is right-handed (Duff et al. 2017)."""
    x, y, z = normals.T
    sign = np.where(z < 0, -1.0, 1.0)
    a = -1 / (sign + z)
    b = x * y * a
    s = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=1)
    t = np.stack([b, sign + y * y * a, -y], axis=1)
    return s, t
