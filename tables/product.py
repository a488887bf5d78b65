"""The product table: the lobe that stands for the product of two lobes (Sec. 4.1), and its exact integral.

Sampled where products live: exponents in log(1 + 2 e), angles as fractions of the range in which the product
is not negligible. What is stored are the logarithms relative to closed forms; they are small and smooth, so
linear interpolation is enough. The table is symmetric in its two lobes and only half of it is kept.

`ProductTable.lookup` has a twin on the device, `product_lobe` in render/kernels/tables.cl, which reads the
same array and takes the constants of `coslobe.tables.layout.defines`.
"""

import itertools
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coslobe.tables import lobe
from coslobe.tables.grid import MAX_EXPONENT, cells, exponent_coordinate, exponent_nodes, in_parts

EXPONENTS = 72
ANGLES = 56
NEGLIGIBLE = 1e-20  # of the coaxial product's integral
REACH = 10.0  # beyond this many joint lobe widths a product is negligible


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
        """Interpolate linearly; alpha in [0, pi].

        Beyond the range: exponents above MAX_EXPONENT keep the last residuals, with their own closed forms
        and their own angles; beyond `largest_angle` the scales and the integral are 0 and the
        exponent is e1 + e2.
        """
        e1, e2, alpha = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (e1, e2, alpha)))
        steps = (EXPONENTS - 1) / exponent_coordinate(MAX_EXPONENT)
        last = largest_angle(e1, e2)
        i, j, k = (
            cells(exponent_coordinate(e1) * steps, EXPONENTS),
            cells(exponent_coordinate(e2) * steps, EXPONENTS),
            cells(alpha / last * (ANGLES - 1), ANGLES),
        )
        residual = np.zeros((*alpha.shape, 3))
        for a, b, c in itertools.product((0, 1), repeat=3):
            weight = i.weight[a] * j.weight[b] * k.weight[c]
            residual += weight[..., None] * self.values[_pair(i.index + a, j.index + b), k.index + c]
        return _product(e1, e2, alpha, residual, beyond=(alpha > last) | (alpha >= np.pi))

    def at_nodes(self) -> tuple[NDArray, NDArray, NDArray, Product]:
        """Both exponents [pairs, 1], the angles [pairs, ANGLES] and the products of all samples."""
        e1, e2, alpha = _nodes()
        e1, e2, alpha = np.broadcast_arrays(e1, e2, alpha)
        beyond = np.zeros(alpha.shape, bool)
        return e1[:, :1], e2[:, :1], alpha, _product(e1, e2, alpha, self.values, beyond=beyond)


def _pair(i: NDArray, j: NDArray) -> NDArray:
    """Row of the pair (i, j) in the lower triangle."""
    high = np.maximum(i, j)
    return high * (high + 1) // 2 + np.minimum(i, j)


def _product(e1: NDArray, e2: NDArray, alpha: NDArray, residual: NDArray, *, beyond: NDArray) -> Product:
    logs = residual + _closed_forms(e1, e2, alpha)
    exponent = np.where(beyond, e1 + e2, np.maximum(np.exp(logs[..., 0]) - SHIFT, 0.0))
    scale, integral = (np.where(beyond, 0.0, np.exp(logs[..., channel])) for channel in (1, 2))
    energy = integral * (exponent + 1) / (2 * np.pi)
    return Product(lobe.peak_angle(e1, e2, alpha), exponent, scale, energy, integral)


SHIFT = 0.5  # e_r + 1/2 stays positive where both exponents are 0


def largest_angle(e1: ArrayLike, e2: ArrayLike) -> NDArray:
    """Last sampled angle of a pair: REACH joint widths sqrt(1/(e1+1) + 1/(e2+1)), at most pi."""
    e1, e2 = np.asarray(e1, np.float64), np.asarray(e2, np.float64)
    return np.minimum(REACH * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1)), np.pi)


def build() -> ProductTable:
    """Fit every node; about 150,000 exact products."""
    e1, e2, alpha = (x.ravel() for x in np.broadcast_arrays(*_nodes()))
    return ProductTable(in_parts(_residuals, e1, e2, alpha).reshape(-1, ANGLES, 3))


def _nodes() -> tuple[NDArray, NDArray, NDArray]:
    """Sampled exponents [pairs, 1] each and angles [pairs, ANGLES]."""
    e = exponent_nodes(EXPONENTS)
    i, j = np.tril_indices(EXPONENTS)
    e1, e2 = e[j][:, None], e[i][:, None]
    # The residuals have a limit at alpha = pi, but not the functions themselves.
    alpha = np.minimum(np.linspace(0, 1, ANGLES) * largest_angle(e1, e2), np.pi * (1 - 1e-6))
    return e1, e2, alpha


def _residuals(e1: NDArray, e2: NDArray, alpha: NDArray) -> NDArray:
    fit = lobe.product_l2(e1, e2, alpha)
    with np.errstate(divide="ignore"):
        logs = [np.log(fit.exponent + SHIFT), np.log(fit.scale), lobe.log_product_integral(e1, e2, alpha)]
    residual = np.stack(logs, axis=-1) - _closed_forms(e1, e2, alpha)
    return np.where(np.isfinite(residual), residual, 0.0).astype(np.float32)  # underflow: 0 either way


def _closed_forms(e1: NDArray, e2: NDArray, alpha: NDArray) -> NDArray:
    """What residuals are relative to: log(e_r + 1/2), log p_r and log G from the peak's curvature [..., 3].

    The peak is that of slightly larger exponents: an exponent near 0 would put it on the edge of the other
    lobe's hemisphere, with a curvature that says nothing about the product. In G the width of the hemisphere
    that both lobes share, pi - alpha, bounds the peak's width; for the Beta function across the plane,
    B(z, 1/2) = sqrt(pi / (z - 1/4 + 1/(32 z))) within 0.3 %, which a float32 evaluates without loss.
    """
    t = lobe.peak_angle(e1 + SHIFT, e2 + SHIFT, alpha)
    cos1, cos2 = np.cos(t), np.cos(alpha - t)
    with np.errstate(divide="ignore", invalid="ignore"):
        log_peak = e1 * np.log(cos1) + e2 * np.log(cos2)
        k = e1 / cos1**2 + e2 / cos2**2
        log_er = np.log(np.sqrt((e1 + e2) * k) + SHIFT)
        width = 1 / np.sqrt(k / (2 * np.pi) + 1 / np.maximum(np.pi - alpha, 1e-300) ** 2)
        z = (e1 + e2 + 2) / 2
        log_g = np.log(np.sqrt(np.pi / (z - 0.25 + 0.03125 / z)) * width) + log_peak
    return np.stack([log_er, log_peak, log_g], axis=-1)
