"""The volume that a ball has outside a solid, exactly, with its gradient (Wang et al. 2006).

The volume of ball and solid together is a signed sum over the cones from the ball's center c to the
triangles: each cone ends on the sphere or on its triangle T, whichever is nearer. With D the disc in which
the triangle's plane cuts the ball, h the plane's signed distance from c, A the area and Omega the solid angle
of T and D,

    overlap = w 4/3 pi r^3 + sum over T of (h A - r^3 Omega) / 3,

w being the winding number of c (Wang et al. sum whole cones; their parts on the sphere add up to w). Its
derivatives are the area of the sphere inside the solid, 4 pi r^2 w - r^2 sum of Omega, with respect to r,
and, by the divergence theorem, -sum of A n with respect to c, n being the triangles' outward normals.

A and Omega are sums over the edges: seen from the foot of the perpendicular from c, an edge and the circle
around D bound triangles and sectors, whose areas and solid angles are elementary.
"""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.spheresets.programs import kernels

Array = NDArray[np.float64]

BLOCK = 32  # triangles that are skipped together
UNCLEAR = 1e-3  # solid angle: the ball does not meet the surface, or hardly


class OutsideVolume:
    """Outside volumes of many balls against one closed surface, on a device.

    Parameters
    ----------
    device : Device
    corners : float64 [m, 3, 3]
        Triangles of a closed surface, normals outwards.
    inside : callable
        Says which points [n, 3] the surface has inside; asked about centers of balls that it does not meet.
    """

    def __init__(self, device: Device, corners: Array, inside: Callable[[Array], NDArray[np.bool_]]) -> None:
        from scipy.spatial import KDTree

        self._device, self._inside = device, inside
        # In the order of the tree's leaves: neighbours in a block are neighbours in space.
        corners = corners[KDTree(corners.mean(1), leafsize=BLOCK).indices]
        # Whole blocks, filled with triangles that are points: they have no area.
        filled = np.concatenate([corners, np.tile(corners[-1, 0], (-len(corners) % BLOCK, 3, 1))])
        blocks = filled.reshape(-1, BLOCK * 3, 3)
        boxes = np.zeros((len(blocks), 2, 4), np.float32)
        boxes[:, 0, :3], boxes[:, 1, :3] = blocks.min(1), blocks.max(1)
        self._count = len(filled)
        self._corners = device.upload(filled.reshape(-1, 9).T.astype(np.float32))
        self._boxes = device.upload(boxes)
        defines = {"WIDTH": device.info.vector_width, "BLOCK": BLOCK}
        self._kernel = kernels(device, ["outside_volume.cl"], ["overlaps"], defines)["overlaps"]

    def __call__(self, balls: Array) -> tuple[Array, Array]:
        """Outside volume [n] of balls [n, 4] (center, radius) and its gradient [n, 4]."""
        device, n = self._device, len(balls)
        result = device.allocate(32 * n)
        device.launch(
            self._kernel, n, None, self._corners, np.int32(self._count), self._boxes,
            device.upload(balls.astype(np.float32)), result,
        )  # fmt: skip
        sums = device.download(result, (n, 8), np.float32).astype(np.float64)
        return outside(balls, sums, self._inside)

    def total(self, balls: Array) -> float:
        """Sum of the outside volumes."""
        return float(self(balls)[0].sum())


def outside(balls: Array, sums: Array, inside: Callable[[Array], NDArray[np.bool_]]) -> tuple[Array, Array]:
    """Outside volume [n] and gradient [n, 4] from the sums [n, >= 5] of `overlaps`.

    Whether a center is inside shows in Omega: the share of the sphere that is outside is 1 - w + Omega / 4 pi
    and lies between 0 and 1. Only where Omega vanishes the center must be looked at.
    """
    r, omega = balls[:, 3], sums[:, 1]
    within = omega > 0
    unclear = np.abs(omega) < UNCLEAR
    within[unclear] = inside(balls[unclear, :3])
    ball = 4 / 3 * np.pi * r**3
    volume = np.clip(ball * ~within - sums[:, 0], 0, ball)  # sums of many triangles round
    area = r**2 * np.clip(4 * np.pi * ~within + omega, 0, 4 * np.pi)
    return volume, np.column_stack([sums[:, 2:5], area])


def overlaps(corners: Array, balls: Array) -> Array:
    """Twin of the kernel: sums [n, 5] over triangles [m, 3, 3] of (h A - r^3 Omega) / 3, Omega and A n."""
    p = corners - balls[:, None, None, :3]  # [n, m, 3, 3]
    r = balls[:, None, 3]
    n = np.cross(p[:, :, 1] - p[:, :, 0], p[:, :, 2] - p[:, :, 0])
    n = _unit(n)
    h = (n * p[:, :, 0]).sum(-1)
    H, a2 = np.abs(h), np.maximum(r**2 - h**2, 0)
    area, omega = np.zeros_like(h), np.zeros_like(h)
    for k in range(3):
        start, end = p[:, :, k], p[:, :, (k + 1) % 3]
        along = _unit(end - start)
        m = -(np.cross(n, along) * start).sum(-1)
        mu = np.abs(m)
        t0, t1 = (along * start).sum(-1), (along * end).sum(-1)
        chord = np.sqrt(np.maximum(a2 - m**2, 0))
        u0, u1 = np.clip(t0, -chord, chord), np.clip(t1, -chord, chord)
        seen, seen_in = (np.arctan2(b, mu) - np.arctan2(a, mu) for a, b in ((t0, t1), (u0, u1)))
        d0, d1 = (np.sqrt(H**2 + m**2 + u**2) for u in (u0, u1))
        lost = np.arctan2(H * u1, mu * d1) - np.arctan2(H * u0, mu * d0)
        side = np.sign(m)
        area += side / 2 * (mu * (u1 - u0) + a2 * (seen - seen_in))
        omega += side * (seen * (1 - H / r) + seen_in * H / r - lost)
    meets = a2 > 0
    area *= meets
    omega *= meets * np.where(h >= 0, 1, -1)
    return np.column_stack(
        [(h * area - r**3 * omega).sum(1) / 3, omega.sum(1), np.einsum("nm,nmd->nd", area, n)]
    )


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v), where=length > 1e-15)
