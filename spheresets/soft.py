"""What the soft unions of points and of lines share: the odds of one sphere, and their constants.

Host side of `kernels/soft.cl`. Lengths are in unit coordinates.
"""

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device

CUTOFF = 8.0  # in tau: spheres farther than this do not count
DEEPEST = 30.0  # in tau: deeper counts as this deep

Array = NDArray[np.float64]


def odds(distances: Array, radii: Array, tau: float) -> Array:
    """e_i = exp((r_i - d) / tau) at distance d from the center; 0 beyond CUTOFF tau from the sphere."""
    z = (radii - distances) / tau
    return np.where(z > -CUTOFF, np.exp(np.minimum(z, DEEPEST)), 0.0)


def defines(device: Device) -> dict[str, int | float]:
    """Constants of `soft.cl` on a device."""
    return {"WIDTH": device.info.vector_width, "CUTOFF": CUTOFF, "DEEPEST": DEEPEST}
