"""The soft union of spheres and its cross-entropy against a solid, on an OpenCL device.

The functions of this module are the float64 twins of the kernels in `kernels/soft_union.cl`: what the kernels
compute, without culling by chunks. `SoftUnion` runs the kernels. Lengths are in unit coordinates.

Occupancy odds of a point p: S = B + sum_i e_i, e_i = exp((r_i - |p - c_i|) / tau), so that log S is the
log-sum-exp soft union. Loss: binary cross-entropy of S / (1 + S) with "p is inside the solid".
B = exp(-cutoff) keeps it finite where nothing covers p. Exchanges look farther than descent: to them it
matters how far away a part was left behind, but descent must not draw spheres out of the solid towards it.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.spheresets.descent import Target
from coslobe.spheresets.programs import kernels
from coslobe.spheresets.soft import cutoff, defines, odds

REACH = 0.1  # how far beyond its surface a sphere counts in exchanges, as far as FARTHEST allows
CHUNK = 128  # points per work-item
SCRATCH_ENTRIES = 1 << 23  # of 4 bytes, per scratch buffer

Array = NDArray[np.float64]
Odds = tuple[NDArray[np.float32], NDArray[np.float32]]


class SoftUnion:
    """The kernels over one set of labelled points.

    Parameters
    ----------
    device : Device
    batches : float32 [k, 4, n]
        Points in k batches of n (a multiple of CHUNK): rows x, y, z, inside (1 or 0). Neighbours in a batch
        should be neighbours in space.
    judged : float32 [4, m]
        Points (m a multiple of CHUNK) over which exchanges are judged.
    """

    def __init__(self, device: Device, batches: NDArray[np.float32], judged: NDArray[np.float32]) -> None:
        self._device = device
        self._batches = [device.upload(batch) for batch in batches]
        self._batch_size = batches.shape[2]
        self._judged = device.upload(judged)
        self._n_judged = judged.shape[1]
        self.rows = self._batch_size // CHUNK
        units = ("soft.cl", "soft_union.cl")
        near, far = ({**defines(device, reach), "CHUNK": CHUNK} for reach in (0.0, REACH))
        self._kernels = kernels(device, units, ("gradient",), near)
        self._kernels |= kernels(device, units, ("total_odds", "exchange"), far)

    def gradient(
        self, step: int, spheres: Any, n: int, tau: float, weight: float, target: Target, row: int
    ) -> None:
        """See `descent.Loss`."""
        self._device.launch(
            self._kernels["gradient"], self.rows, 1,
            self._batches[step % len(self._batches)], np.int32(self._batch_size), spheres, np.int32(n),
            np.float32(tau), np.float32(weight / self._batch_size), np.int32(row), *target,
        )  # fmt: skip

    def odds(self, spheres: NDArray[np.floating], tau: float) -> Odds:
        """S at the judged points, and S without its largest term, [m] each."""
        device, n, m = self._device, len(spheres), self._n_judged
        on_device = device.upload(spheres.astype(np.float32))
        total, rest = device.allocate(4 * m), device.allocate(4 * m)
        near = device.allocate(4 * self._rows(n) * n)
        for first, rows in self._blocks(n):
            device.launch(
                self._kernels["total_odds"], rows, 1,
                self._judged, np.int32(m), np.int32(first), on_device, np.int32(n), np.float32(tau),
                near, total, rest,
            )  # fmt: skip
        return device.download(total, (m,), np.float32), device.download(rest, (m,), np.float32)

    def exchange(self, odds: Odds, spheres: NDArray[np.floating], tau: float, *, removing: bool) -> Array:
        """Change of the loss, summed over the judged points, as each sphere is taken out or put in, [n]."""
        device, n, m = self._device, len(spheres), self._n_judged
        on_device = device.upload(spheres.astype(np.float32))
        total, rest = (device.upload(values) for values in odds)
        near, partial = (device.allocate(4 * self._rows(n) * n) for _ in range(2))
        change = np.zeros(n)
        for first, rows in self._blocks(n):
            device.launch(
                self._kernels["exchange"], rows, 1,
                self._judged, np.int32(m), np.int32(first), total, rest, on_device, np.int32(n),
                np.float32(tau), np.int32(removing), near, partial,
            )  # fmt: skip
            change += device.download(partial, (rows, n), np.float32).sum(0, dtype=np.float64)
        return change

    def _rows(self, n: int) -> int:
        """Judged chunks per launch, so that scratch memory stays bounded."""
        return int(np.clip(SCRATCH_ENTRIES // n, 1, self._n_judged // CHUNK))

    def _blocks(self, n: int) -> Iterator[tuple[int, int]]:
        chunks, rows = self._n_judged // CHUNK, self._rows(n)
        return ((first, min(rows, chunks - first)) for first in range(0, chunks, rows))


def sphere_odds(points: Array, spheres: Array, tau: float, reach: float = 0.0) -> Array:
    """e_i [m, n] of points [m, 3] and spheres [n, 4]; 0 beyond the cutoff."""
    d = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2)
    return odds(d, spheres[:, 3], tau, reach)


def background(tau: float, reach: float = 0.0) -> float:
    """B: the odds where no sphere is near."""
    return float(np.exp(-cutoff(tau, reach)))


def cross_entropy(S: Array, inside: Array) -> Array:
    """Binary cross-entropy of odds S."""
    return np.log1p(S) - inside * np.log(S)


def loss_and_gradient(points: Array, inside: Array, spheres: Array, tau: float) -> tuple[Array, Array]:
    """Loss [m] per point and gradient [n, 4] of its mean with respect to centers and radii."""
    e = sphere_odds(points, spheres, tau)
    S = background(tau) + e.sum(1)
    slope = 1 / (1 + S) - inside / S
    offset = points[:, None] - spheres[:, :3]
    unit = offset / np.maximum(np.linalg.norm(offset, axis=2, keepdims=True), 1e-10)
    g = slope[:, None] * e / tau
    gradient = np.concatenate([np.einsum("mn,mnd->nd", g, unit), g.sum(0)[:, None]], axis=1) / len(points)
    return cross_entropy(S, inside), gradient


def total_odds(points: Array, spheres: Array, tau: float) -> tuple[Array, Array]:
    """S [m], and S without its largest term."""
    e = sphere_odds(points, spheres, tau, REACH)
    total = background(tau, REACH) + e.sum(1)
    return total, total - e.max(1)


def exchange(
    points: Array, inside: Array, spheres: Array, others: Array, tau: float, *, removing: bool
) -> Array:
    """Change of the summed loss as each of `spheres` is taken out of the union of `others` or put into it."""
    total, _ = total_odds(points, others, tau)
    e = sphere_odds(points, spheres, tau, REACH)
    after = np.maximum(total[:, None] - e, background(tau, REACH)) if removing else total[:, None] + e
    change = cross_entropy(after, inside[:, None]) - cross_entropy(total, inside)[:, None]
    return np.where(e > 0, change, 0).sum(0)
