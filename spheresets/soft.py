"""What the soft unions of points and of lines share: the odds of one sphere, and their constants.

Host side of `kernels/soft.cl`. Lengths are in unit coordinates.
"""

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device

CUTOFF, FARTHEST = 8.0, 30.0  # in tau: spheres farther than `cutoff`, between these, do not count
DEEPEST = 30.0  # in tau: deeper counts as this deep

Array = NDArray[np.float64]


def cutoff(tau: float, reach: float) -> float:
    """How far from a sphere it still counts, in tau; `reach` is that distance as a length."""
    return float(np.clip(reach / tau, CUTOFF, FARTHEST))


def odds(distances: Array, radii: Array, tau: float, reach: float = 0.0) -> Array:
    """e_i = exp((r_i - d) / tau) at distance d from the center; 0 beyond the cutoff from the sphere."""
    z = (radii - distances) / tau
    return np.where(z > -cutoff(tau, reach), np.exp(np.minimum(z, DEEPEST)), 0.0)


def defines(device: Device, reach: float = 0.0) -> dict[str, int | float]:
    """Constants of `soft.cl` on a device."""
    limits = {"REACH": reach, "CUTOFF": CUTOFF, "FARTHEST": FARTHEST, "DEEPEST": DEEPEST}
    return {"WIDTH": device.info.vector_width, **limits}
