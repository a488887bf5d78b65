"""The sampling that the tables share: exponent axes, and linear interpolation on regular grids."""

import itertools

import numpy as np
from numpy.typing import ArrayLike, NDArray

MAX_EXPONENT = 1e5  # the paper's range (Sec. 4.1)


def exponent_coordinate(exponent: ArrayLike) -> NDArray:
    """log(1 + 2 e): dense below 1, where products vary most, logarithmic above."""
    return np.log1p(2 * np.asarray(exponent, np.float64))


def exponent_of(coordinate: ArrayLike) -> NDArray:
    """Inverse of `exponent_coordinate`."""
    return np.expm1(np.asarray(coordinate, np.float64)) / 2


def exponent_nodes(n: int) -> NDArray:
    """n exponents from 0 to MAX_EXPONENT, equally spaced in `exponent_coordinate`."""
    return exponent_of(np.linspace(0, exponent_coordinate(MAX_EXPONENT), n))


def multilinear(table: NDArray, positions: tuple[NDArray, ...]) -> NDArray:
    """Interpolate [n1, ..., nd, channels] at fractional indices (clamped to the grid): [..., channels]."""
    lower, fraction = [], []
    for position, n in zip(positions, table.shape, strict=False):
        clamped = np.clip(position, 0, n - 1)
        base = np.minimum(clamped.astype(np.int64), n - 2)
        lower.append(base)
        fraction.append(clamped - base)
    result = 0.0
    for corner in itertools.product((0, 1), repeat=len(positions)):
        weight = np.prod([f if bit else 1 - f for f, bit in zip(fraction, corner, strict=True)], axis=0)
        index = tuple(base + bit for base, bit in zip(lower, corner, strict=True))
        result = result + weight[..., None] * table[index]
    return np.asarray(result)


def cubic_weights(position: NDArray, n: int) -> tuple[NDArray, NDArray]:
    """Taps and weights of cubic Lagrange interpolation at fractional indices: int [..., 4], float64 [..., 4].

    The four taps are shifted inwards at the ends of the n samples, so the order holds up to the border.
    """
    clamped = np.clip(position, 0, n - 1)
    base = np.clip(clamped.astype(np.int64) - 1, 0, n - 4)
    x = clamped - base
    weights = np.stack(
        [
            -(x - 1) * (x - 2) * (x - 3) / 6,
            x * (x - 2) * (x - 3) / 2,
            -x * (x - 1) * (x - 3) / 2,
            x * (x - 1) * (x - 2) / 6,
        ],
        axis=-1,
    )
    return base[..., None] + np.arange(4), weights
