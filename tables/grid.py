"""The sampling that the tables share: exponent axes, interpolation on regular grids, builds on all cores."""

import os
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import NamedTuple

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


class Cells(NamedTuple):
    """Where fractional indices lie between samples: the lower index, and the weights of it and the next."""

    index: NDArray
    weight: tuple[NDArray, NDArray]


def cells(position: NDArray, n: int) -> Cells:
    """Cells of linear interpolation among n samples; positions outside take the nearest sample."""
    clamped = np.clip(position, 0, n - 1)
    index = np.minimum(clamped.astype(np.int64), n - 2)
    fraction = clamped - index
    return Cells(index, (1 - fraction, fraction))


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


def in_parts(function: Callable[..., NDArray], *arrays: NDArray, size: int = 2048) -> NDArray:
    """Concatenated `function(*parts)` over parts of `arrays` along their first axis, on all cores.

    NumPy runs outside the interpreter's lock; parts bound the memory, and their size fixes every bit of the
    result whatever the number of cores.
    """
    parts = [[array[k : k + size] for array in arrays] for k in range(0, len(arrays[0]), size)]
    with ThreadPoolExecutor(os.cpu_count()) as pool:
        return np.concatenate(list(pool.map(lambda part: function(*part), parts)))
