"""How large a receiver's own spheres are to it: float64 twin of the kernel's rule."""

import numpy as np
from numpy.typing import NDArray


def own_radius(radius: NDArray, outside: NDArray, height: NDArray, distance: NDArray) -> NDArray:
    """The radius at which a sphere of the receiver's own object blocks it; 0 where it does not.

    Spheres bulge by up to `outside` above the surface that they stand for. `height` is that of the centre
    above the receiver's tangent plane, `distance` that of the centre from the receiver (docs/theory.md,
    section 6).
    """
    bulge = outside * np.clip(0.25 - height / radius, 0, 1)
    near = np.clip((radius + 2 * outside - distance) / np.maximum(outside, 1e-30), 0, 1)
    return np.where(
        (height <= -radius) | (distance < radius + bulge), 0.0, np.maximum(radius - bulge * near, 0)
    )
