"""The soft silhouette of spheres and its squared error against a solid, on an OpenCL device.

The functions of this module are the float64 twins of the kernel in `kernels/soft_lines.cl`. `SoftLines` runs
it. Lengths are in unit coordinates.

Odds that a line is blocked: S = sum_i e_i, e_i = exp((r_i - d_i) / tau), d_i the line's distance from c_i;
u = S / (1 + S). Loss of a bundle of lines: half the squared errors of its u, and half the squared error of
their mean, counted once per line. The mean is what a receiver sees of a light: a soft shadow.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.spheresets.descent import Target
from coslobe.spheresets.programs import kernels
from coslobe.spheresets.soft import defines, odds

BUNDLE = 16  # lines
BUNDLES = 8  # per work-item

Array = NDArray[np.float64]


class SoftLines:
    """The kernel over one set of labelled lines.

    Parameters
    ----------
    device : Device
    batches : float32 [k, 7, n]
        Lines in k batches of n (a multiple of BUNDLE * BUNDLES): rows of origin (3), unit direction (3), hit
        (1 or 0). Each BUNDLE lines in a row are a bundle: close to one another within the box.
    """

    def __init__(self, device: Device, batches: NDArray[np.float32]) -> None:
        self._device = device
        self._batches = [device.upload(batch) for batch in batches]
        self._batch_size = batches.shape[2]
        self.rows = self._batch_size // (BUNDLE * BUNDLES)
        constants = {**defines(device), "BUNDLE": BUNDLE, "BUNDLES": BUNDLES}
        units = ("soft.cl", "soft_lines.cl")
        self._kernel = kernels(device, units, ("line_gradient",), constants)["line_gradient"]

    def gradient(
        self, step: int, spheres: Any, n: int, tau: float, weight: float, target: Target, row: int
    ) -> None:
        """See `descent.Loss`."""
        self._device.launch(
            self._kernel, self.rows, 1,
            self._batches[step % len(self._batches)], np.int32(self._batch_size), spheres, np.int32(n),
            np.float32(tau), np.float32(weight / self._batch_size), np.int32(row), *target,
        )  # fmt: skip


def line_odds(origins: Array, directions: Array, spheres: Array, tau: float) -> Array:
    """e_i [m, n] of lines [m, 3] and spheres [n, 4]; 0 beyond the cutoff."""
    q = _perpendicular(origins, directions, spheres)
    return odds(np.linalg.norm(q, axis=2), spheres[:, 3], tau)


def loss_and_gradient(
    origins: Array, directions: Array, hit: Array, spheres: Array, tau: float
) -> tuple[float, Array]:
    """Mean loss per line, and its gradient [n, 4] with respect to centers and radii."""
    e = line_odds(origins, directions, spheres, tau)
    S = e.sum(1)
    error = S / (1 + S) - hit
    mean = np.repeat(error.reshape(-1, BUNDLE).mean(1), BUNDLE)
    slope = (error + mean) / (1 + S) ** 2
    q = _perpendicular(origins, directions, spheres)
    unit = q / np.maximum(np.linalg.norm(q, axis=2, keepdims=True), 1e-10)
    g = slope[:, None] * e / tau
    gradient = np.concatenate([np.einsum("mn,mnd->nd", g, unit), g.sum(0)[:, None]], axis=1) / len(hit)
    return float((error**2 + mean**2).mean() / 2), gradient


def _perpendicular(origins: Array, directions: Array, spheres: Array) -> Array:
    """From each sphere's center to the nearest point of each line, [m, n, 3]."""
    offset = origins[:, None] - spheres[:, :3]
    return offset - (offset * directions[:, None]).sum(-1, keepdims=True) * directions[:, None]
