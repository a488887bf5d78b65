"""The integration table of the paper (Sec. 4.2): 128 linear samples in each interval [0, 1], [1, 10], ...

The integral is known in closed form, 2 pi / (e + 1), and that is what the fast path uses; the table is kept
because it is part of the method, and its interpolation error is reported beside the others.
"""

from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import roots_legendre

BOUNDS = (0.0, 1.0, 1e1, 1e2, 1e3, 1e4, 1e5)
SAMPLES = 128


@dataclass(frozen=True)
class IntegralTable:
    """Attributes: `exponents`, `values` float64 [n]; values are integrals over the sphere in sr."""

    exponents: NDArray
    values: NDArray

    def lookup(self, exponent: ArrayLike) -> NDArray:
        """Linear interpolation, as the paper does; above the last sample the closed form."""
        e = np.asarray(exponent, np.float64)
        return np.where(e > BOUNDS[-1], 2 * np.pi / (e + 1), np.interp(e, self.exponents, self.values))


def build() -> IntegralTable:
    """Integrate every sample by Gauss-Legendre quadrature, without use of the closed form."""
    pieces = [np.linspace(a, b, SAMPLES) for a, b in pairwise(BOUNDS)]
    exponents = np.unique(np.concatenate(pieces))
    return IntegralTable(exponents, _quadrature(exponents))


def _quadrature(e: NDArray) -> NDArray:
    """2 pi * integral of cos^e(g) sin(g) over [0, pi / 2], cut where the lobe is below exp(-40).

    With w = e (1 - cos g) the integrand is close to exp(-w) for large exponents; for small ones w stops at
    e. The square root at cos g = 0 of exponents below 1 is removed by c = x^3.
    """
    x, weight = roots_legendre(128)
    x, weight = (x + 1) / 2, weight / 2
    small = e[e < 30][:, None]
    cosine = x**3
    low = (weight * 3 * x**2 * cosine**small).sum(axis=1)
    large = e[e >= 30][:, None]
    depth = np.minimum(40 / large, 1.0)  # range of 1 - cos g
    high = (weight * depth * np.exp(large * np.log1p(-x * depth))).sum(axis=1)
    return 2 * np.pi * np.concatenate([low, high])
