"""The cap table: the lobe that stands for a spherical cap, such as a spherical light (Sec. 5.2)."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

SAMPLES = 1000  # as in the paper
SMALLEST_DEPTH = 1e-30  # the reciprocal still fits a float32


@dataclass(frozen=True)
class CapTable:
    """e_cap (1 - cos alpha) over 1 - cos alpha in [0, 1], equally spaced; float64 [SAMPLES].

    The product of exponent and depth of the cap is smooth and bounded (0.9613 for small caps), so linear
    interpolation of it gives the exponent at every size, down to the Sun and below.
    """

    values: NDArray

    def exponent(self, depth: ArrayLike) -> NDArray:
        """e_cap of the cap of `depth` = 1 - cos alpha.

        Beyond (0, 1]: no lobe is wider than the hemisphere, which stands for every larger cap; the smallest
        cap stands for those without extent.
        """
        depth = _inside_range(depth)
        return np.interp(depth, np.linspace(0, 1, SAMPLES), self.values) / depth

    def energy_amplitude(self, depth: ArrayLike) -> NDArray:
        """Amplitude (1 - cos alpha)(e + 1) that gives the lobe the solid angle of the cap."""
        return _inside_range(depth) * (self.exponent(depth) + 1)


def _inside_range(depth: ArrayLike) -> NDArray:
    return np.clip(np.asarray(depth, np.float64), SMALLEST_DEPTH, 1.0)


def build() -> CapTable:
    """Solve (32) for every sample."""
    depths = np.linspace(0, 1, SAMPLES)
    return CapTable(np.array([best_exponent_depth(depth) for depth in depths]))


def l2_distance(depth: ArrayLike, exponent: ArrayLike) -> NDArray:
    """Integral of (f_cap - c_cap)^2 (32), divided by 2 pi; amplitude 1."""
    d, e = np.asarray(depth, np.float64), np.asarray(exponent, np.float64)
    return d - 2 * _inside(d, e) + 1 / (2 * e + 1)


def _inside(depth: NDArray, e: NDArray) -> NDArray:
    """Integral of the lobe inside the cap divided by 2 pi: (1 - c^(e+1)) / (e + 1)."""
    with np.errstate(divide="ignore"):
        return -np.expm1((e + 1) * np.log1p(-depth)) / (e + 1)


def best_exponent(depth: float) -> float:
    """e_cap solved for one cap, without the table; depth in (0, 1]."""
    return best_exponent_depth(depth) / depth


def best_exponent_depth(depth: float) -> float:
    """The minimising e * depth: the root of the derivative of (32) in e."""
    if depth == 1.0:
        return 0.0  # a hemisphere is the lobe of exponent 0
    if depth == 0.0:
        # Limit of small caps: 1 - 2 (1 - exp(-x)) / x + 1 / (2 x) is smallest.
        return _root(lambda x: 1.5 - 2 * (1 + x) * np.exp(-x), 0.1, 5.0)
    log_c = np.log1p(-depth)

    def slope(e: float) -> float:
        m = e + 1
        c_power = np.exp(m * log_c)
        return 2 * (1 - c_power + m * log_c * c_power) / m**2 - 2 / (2 * e + 1) ** 2

    return _root(lambda x: slope(x / depth), 1e-12, 3.0)


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    from scipy.optimize import root_scalar  # slow to import, and needed for building tables only

    return float(root_scalar(function, method="brentq", bracket=(low, high), xtol=1e-14).root)
