"""Exact queries against a union of spheres on an OpenCL device, each beside its float64 twin."""

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.spheresets.programs import kernels

Array = NDArray[np.float64]

NEAR_ENTRIES = 1 << 24  # in the kernels' lists of near spheres: 64 MiB


class Union:
    """Spheres on a device: `spheres` [n, 4], center and radius."""

    def __init__(self, device: Device, spheres: Array) -> None:
        self._device = device
        self._kernels = kernels(device, ("union.cl",), ("points", "lines", "caps"), {})
        self._spheres = device.upload(spheres.astype(np.float32))
        self._n = len(spheres)

    def points(self, points: Array) -> tuple[Array, NDArray[np.int32]]:
        """See `points`."""
        device, m = self._device, len(points)
        clearance, containing = device.allocate(4 * m), device.allocate(4 * m)
        device.launch(
            self._kernels["points"], m, None,
            device.upload(_float4(points)), self._spheres, np.int32(self._n), clearance, containing,
        )  # fmt: skip
        distances = device.download(clearance, (m,), np.float32).astype(np.float64)
        return distances, device.download(containing, (m,), np.int32)

    def lines(self, origins: Array, directions: Array) -> Array:
        """See `lines`."""
        device, m = self._device, len(origins)
        clearance = device.allocate(4 * m)
        device.launch(
            self._kernels["lines"], m, None,
            device.upload(_float4(origins)), device.upload(_float4(directions)),
            self._spheres, np.int32(self._n), clearance,
        )  # fmt: skip
        return device.download(clearance, (m,), np.float32).astype(np.float64)

    def caps(self, receivers: Array, axes: Array, directions: Array, light: Array) -> NDArray[np.bool_]:
        """See `caps`."""
        device, (m, k) = self._device, directions.shape[:2]
        blocked = np.empty((m, k), np.uint8)
        block = max(1, NEAR_ENTRIES // self._n)
        near = device.allocate(4 * min(block, m) * self._n)
        for start in range(0, m, block):
            part = slice(start, min(start + block, m))
            size = part.stop - part.start
            result = device.allocate(size * k)
            device.launch(
                self._kernels["caps"], size, None,
                device.upload(_float4(receivers[part])), device.upload(axes[part].astype(np.float32)),
                device.upload(_float4(directions[part].reshape(-1, 3))), np.int32(k),
                light.astype(np.float32), self._spheres, np.int32(self._n), near, result,
            )  # fmt: skip
            blocked[part] = device.download(result, (size, k), np.uint8)
        return blocked.astype(bool)


def _float4(vectors: Array) -> NDArray[np.float32]:
    return np.column_stack([vectors, np.zeros(len(vectors))]).astype(np.float32)


def points(points: Array, spheres: Array) -> tuple[Array, NDArray[np.int32]]:
    """Distance [m] of points [m, 3] from the union, and in how many spheres each lies.

    Inside the union the distance is negative and only a bound: the largest depth in one sphere.
    """
    gap = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]
    return gap.min(1), (gap < 0).sum(1, dtype=np.int32)


def lines(origins: Array, directions: Array, spheres: Array) -> Array:
    """How far [m] each line (origin, unit direction) passes from the union; negative where it hits."""
    offset = spheres[:, :3] - origins[:, None]
    return (np.linalg.norm(np.cross(offset, directions[:, None]), axis=2) - spheres[:, 3]).min(1)


def caps(receivers: Array, axes: Array, directions: Array, light: Array, spheres: Array) -> NDArray[np.bool_]:
    """Which directions [m, k, 3] of receivers [m, 3] are blocked before they enter the light [4], [m, k].

    `axes` [m, 4] hold the middle of each receiver's cap of directions and the cosine of its half-angle: all
    its directions lie within. Receivers are outside the light. A direction that starts inside a sphere is
    blocked where it points towards the sphere's center, the limit of touching it from outside.
    """
    del axes  # only lets the kernel leave out spheres that no direction can meet
    o = (spheres[:, :3] - receivers[:, None])[:, None]
    b = (o * directions[:, :, None]).sum(-1)
    q = np.maximum((o**2).sum(-1) - spheres[:, 3] ** 2, 0)
    to_light = (light[:3] - receivers)[:, None]
    tl = (to_light * directions).sum(-1)
    enter_light = tl - np.sqrt(np.maximum(tl**2 - (to_light**2).sum(-1) + light[3] ** 2, 0))
    entry = b - np.sqrt(np.maximum(b * b - q, 0))
    return ((b > 0) & (b * b >= q) & (entry < enter_light[:, :, None])).any(-1)
