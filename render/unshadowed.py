"""Closed forms of unshadowed light in float64: the truth behind the kernel's functions."""

import numpy as np
from numpy.typing import ArrayLike, NDArray


def lambert_sphere(cosine: ArrayLike, sine2: ArrayLike) -> NDArray:
    """Irradiance over radiance of a uniform sphere light, cut by the horizon.

    Snyder 1996; Lagarde and de Rousiers 2014. `cosine` is that of the angle between the normal and the
    light's centre, `sine2` = (r / d)^2 in (0, 1]; at 1 and beyond the point is inside the light: pi.
    """
    c, q = np.broadcast_arrays(np.asarray(cosine, np.float64), np.asarray(sine2, np.float64))
    q = np.minimum(q, 1.0)
    with np.errstate(divide="ignore", invalid="ignore"):
        st = np.sqrt(np.maximum(1 - c * c, 1e-300))
        x = np.sqrt(np.maximum(1 / q - 1, 0))
        y = np.clip(-x * c / st, -1, 1)
        z = st * np.sqrt(1 - y * y)
        cut = (c * np.arccos(y) - x * z) * q + np.arctan2(z, x)
    whole = np.pi * q * np.maximum(c, 0)
    return np.where(np.asarray(sine2) >= 1, np.pi, np.where(c * c > q, whole, np.maximum(cut, 0)))
