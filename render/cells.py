"""Sums over a mask's cells in float64: twins of kernels/cells.cl."""

import numpy as np
from numpy.typing import NDArray

from coslobe.render.mask import directions


def diffuse_sums(lit: NDArray, whole: NDArray, h: float, normal: NDArray) -> tuple[float, float]:
    """Solid angle times cosine to `normal` over the cells of `whole` and of `lit`, per cell area.

    Arguments as in `glossy_sums`.
    """
    along = directions(len(lit), h)
    value = along[..., 2] ** 3 * np.maximum(along @ normal, 0)
    return float(value[whole].sum()), float(value[lit].sum())


def glossy_sums(
    lit: NDArray,
    whole: NDArray,
    h: float,
    normal: NDArray,
    axis: NDArray,
    exponent: float,
    *,
    cosine: bool,
    cut: bool,
) -> tuple[float, float]:
    """A lobe's integrals over the cells of `whole` and of `lit`, with the cosine to `normal`, per cell area.

    Masks are bool [rows, rows], the half-width of their square is `h`; unit vectors are in the mask's frame.
    Without `cosine`, cosines count as 1 above the horizon; where the horizon `cut`s the light, the first
    integral has the cosine to the lobe's own axis instead. No lobe is narrower than half a cell.
    """
    rows = len(lit)
    along = directions(rows, h)
    omega = along[..., 2] ** 3
    q = 0.5 * ((along - axis) ** 2).sum(axis=-1)
    e = min(exponent, rows**2 / h**2)
    lobe = np.where(q < 1, np.exp(e * np.log1p(-np.minimum(q, 1 - 1e-9))), 0.0) * omega
    height = along @ normal
    value = lobe * (np.maximum(height, 0) if cosine else height > 0)
    around = lobe * (1 - q) if cosine else lobe
    return float((around if cut else value)[whole].sum()), float(value[lit].sum())
