"""The product table: the lobe that stands for the product of two lobes (Sec. 4.1), and its exact integral.

Sampled where products live: exponents in log(1 + 2 e), angles as fractions of the range in which the product
is not negligible. What is stored are the logarithms relative to closed forms; they are small and smooth, so
linear interpolation is enough. The table is symmetric in its two lobes and only half of it is kept.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaln

from coslobe.tables import lobe
from coslobe.tables.grid import MAX_EXPONENT, exponent_coordinate, exponent_nodes, multilinear

EXPONENTS = 52
ANGLES = 72
REACH = 10.0  # beyond this many joint lobe widths a product integrates to less than 1e-20 of its peak


class Product(NamedTuple):
    """Interpolated product of two lobes of amplitude 1, arrays of the broadcast shape.

    Attributes
    ----------
    axis_angle : from the first axis, in the plane of both axes (rad); a closed form, not interpolated.
    exponent : e_r of the L2 fit (19).
    scale_l2 : p_r of the L2 fit.
    scale_energy : the scale that makes the lobe's integral equal to that of the product.
    integral : G(e1, e2, alpha); 0 beyond the sampled angles.
    """

    axis_angle: NDArray
    exponent: NDArray
    scale_l2: NDArray
    scale_energy: NDArray
    integral: NDArray


@dataclass(frozen=True)
class ProductTable:
    """Residuals over the nodes.

    Attributes
    ----------
    values : float32 [EXPONENTS * (EXPONENTS + 1) / 2, ANGLES, 3]
        log e_r, log p_r (L2) and log G relative to their closed forms, for pairs i <= j in row order.
    """

    values: NDArray

    def lookup(self, e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> Product:
        """Interpolate; exponents above the range use the last residuals with their own closed forms."""
        e1, e2, alpha = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (e1, e2, alpha)))
        last = exponent_coordinate(MAX_EXPONENT)
        x1, x2 = (np.clip(exponent_coordinate(e) / last, 0, 1) * (EXPONENTS - 1) for e in (e1, e2))
        position = alpha / largest_angle(e1, e2) * (ANGLES - 1)
        residual = multilinear(self._square(), (x1, x2, position))
        base = _closed_forms(e1, e2, alpha)
        log_er, log_scale, log_g = (residual[..., k] + base[..., k] for k in range(3))
        beyond = (alpha > largest_angle(e1, e2)) | (alpha >= np.pi)
        exponent = np.exp(log_er) - _SHIFT
        integral = np.where(beyond, 0.0, np.exp(log_g))
        scale_l2 = np.where(beyond, 0.0, np.exp(log_scale))
        scale_energy = integral * (exponent + 1) / (2 * np.pi)
        return Product(lobe.peak_angle(e1, e2, alpha), exponent, scale_l2, scale_energy, integral)

    def _square(self) -> NDArray:
        i, j = np.tril_indices(EXPONENTS)
        square = np.empty((EXPONENTS, EXPONENTS, *self.values.shape[1:]))
        square[j, i] = self.values
        square[i, j] = self.values
        return square


_SHIFT = 0.5  # e_r + 1/2 stays positive where both exponents are 0


def largest_angle(e1: ArrayLike, e2: ArrayLike) -> NDArray:
    """Last sampled angle of a pair: REACH joint widths sqrt(1/(e1+1) + 1/(e2+1)), at most pi."""
    e1, e2 = np.asarray(e1, np.float64), np.asarray(e2, np.float64)
    return np.minimum(REACH * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1)), np.pi)


def build() -> ProductTable:
    """Fit every node; about 100,000 exact products."""
    nodes = exponent_nodes(EXPONENTS)
    i, j = np.tril_indices(EXPONENTS)
    e1, e2 = nodes[j][:, None], nodes[i][:, None]
    fraction = np.linspace(0, 1, ANGLES)
    # The residuals have a limit at alpha = pi, but not the functions themselves.
    alpha = np.minimum(fraction * largest_angle(e1, e2), np.pi * (1 - 1e-6))
    e1, e2, alpha = (x.ravel() for x in np.broadcast_arrays(e1, e2, alpha))
    parts = []
    for k in range(0, len(alpha), 8192):  # bounds the memory of the quadrature
        part = slice(k, k + 8192)
        fit = lobe.product_l2(e1[part], e2[part], alpha[part])
        exact = lobe.log_product_integral(e1[part], e2[part], alpha[part])
        with np.errstate(divide="ignore"):
            exact_values = np.stack([np.log(fit.exponent + _SHIFT), np.log(fit.scale), exact], axis=-1)
        residual = exact_values - _closed_forms(e1[part], e2[part], alpha[part])
        parts.append(np.where(np.isfinite(residual), residual, 0.0))  # scale underflows: 0 either way
    values = np.concatenate(parts).reshape(len(i), ANGLES, 3).astype(np.float32)
    return ProductTable(values)


def _closed_forms(e1: NDArray, e2: NDArray, alpha: NDArray) -> NDArray:
    """What residuals are relative to: log(e_r + 1/2), log p_r and log G from the peak's curvature [..., 3].

    The peak is that of slightly larger exponents: an exponent near 0 would put it on the edge of the other
    lobe's hemisphere, with a curvature that says nothing about the product. In G the width of the hemisphere
    that both lobes share, pi - alpha, bounds the peak's width.
    """
    t = lobe.peak_angle(e1 + _SHIFT, e2 + _SHIFT, alpha)
    cos1, cos2 = np.cos(t), np.cos(alpha - t)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_peak = e1 * np.log(cos1) + e2 * np.log(cos2)
        k = e1 / cos1**2 + e2 / cos2**2
        log_er = np.log(np.sqrt((e1 + e2) * k) + _SHIFT)
        width = 1 / np.sqrt(k / (2 * np.pi) + 1 / np.maximum(np.pi - alpha, 1e-300) ** 2)
        log_g = betaln((e1 + e2 + 2) / 2, 0.5) + log_peak + np.log(width)
    return np.stack([log_er, log_peak, log_g], axis=-1)
