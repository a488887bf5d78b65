"""Directions towards a spherical light: uniform in solid angle, two samples in every stratum.

Two independent samples in every stratum keep nearly all the benefit of stratification, and half the squared
difference of such a pair is an unbiased estimate of the variance inside its stratum. One sample per stratum
would leave that variance unknown; independent replicates of a whole pattern would measure it with far fewer
degrees of freedom.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.brdf import Vectors


@dataclass(frozen=True)
class Strata:
    """A grid of rows x columns strata over the unit square, two samples in each."""

    rows: int
    columns: int

    @property
    def samples(self) -> int:
        """Samples in all."""
        return 2 * self.rows * self.columns

    def jittered(self, rng: np.random.Generator, points: int) -> tuple[NDArray, NDArray]:
        """Independent uniform positions in the strata: u and v, float64 [points, samples] in [0, 1).

        Sample k and sample k + samples / 2 share a stratum.
        """
        row, column = np.divmod(np.arange(self.samples) % (self.samples // 2), self.columns)
        u, v = rng.random((2, points, self.samples))
        u += row
        u /= self.rows
        v += column
        v /= self.columns
        return u, v


def strata(samples: int) -> Strata:
    """The smallest grid with at least `samples` samples whose cells are at most twice as long as wide.

    Powers of two from 4 on, and twice any square, are met exactly; other numbers are rounded up by little.
    """
    pairs = max(-(-samples // 2), 1)
    rows = range(int(np.ceil(np.sqrt(pairs / 2))), int(np.ceil(np.sqrt(pairs))) + 1)
    return min((Strata(n, -(-pairs // n)) for n in rows), key=lambda grid: grid.samples)


@dataclass(frozen=True)
class Caps:
    """One spherical cap of directions per point: those that see the light.

    Attributes
    ----------
    axis : float64 [n, 3]
        Unit vectors.
    height : float64 [n]
        1 - cos(half-angle); the solid angle is 2 pi times it.
    """

    axis: NDArray
    height: NDArray


def light_caps(position: NDArray, normal: NDArray, center: NDArray, radius: float) -> Caps:
    """Caps under which points [n, 3] see the sphere (`center`, `radius`).

    From outside, the cap of half-angle asin(R/d) around the light's centre. From inside every direction sees
    the light, and the hemisphere around `normal` holds all that count: light is cut at the geometric horizon.
    """
    offset = center - position
    distance2 = np.einsum("ij,ij->i", offset, offset)
    inside = distance2 <= radius * radius
    q = radius * radius / np.where(inside, 1.0, distance2)
    # 1 - cos a = q / (1 + cos a) does not cancel for small lights.
    height = np.where(inside, 1.0, q / (1 + np.sqrt(np.maximum(1 - q, 0.0))))
    axis = np.where(inside[:, None], normal, offset / np.sqrt(np.where(inside, 1.0, distance2))[:, None])
    return Caps(axis, height)


def light_measure(caps: Caps, to_light: NDArray, radius: float) -> NDArray:
    """What a mean over directions of the caps stands for, [n]: solid angles, or 1 / d^2 for a point light.

    `to_light` [n, 3] reaches from the points to the light's centre.
    """
    if radius > 0:
        return 2 * np.pi * caps.height
    return 1 / np.maximum(np.einsum("ij,ij->i", to_light, to_light), np.finfo(float).tiny)


def square_to_cap(u: NDArray, v: NDArray, caps: Caps) -> Vectors:
    """Directions uniform in each point's cap, from the unit square [n, s]: x, y, z of unit vectors, [n, s].

    Shirley and Chiu's concentric map of the square to the disk, whose cells stay compact, followed by
    Lambert's azimuthal equal-area map of the disk to the cap: at |p| = r, the cosine to the axis is
    1 - r^2 h.
    """
    x, y = square_to_disk(u, v)
    height = caps.height[:, None]
    return _around(caps.axis, x, y, (x * x + y * y) * height, height)


def square_to_lobe(u: NDArray, v: NDArray, axis: NDArray, exponent: NDArray) -> Vectors:
    """Directions around the axis [n, 3], distributed as the lobe: x, y, z of unit vectors, [n, s].

    Their density is (e + 1) / (2 pi) (a.l)^e. As `square_to_cap`; the share (a.l)^(e + 1) of the lobe lies
    farther from the axis than l. The axis need not have unit length.
    """
    x, y = square_to_disk(u, v)
    share = x * x + y * y
    with np.errstate(divide="ignore", invalid="ignore"):  # at the axis, and at the rim
        rise = -np.expm1(np.log1p(-share) / (exponent + 1)[:, None])
        slope = np.where(share > 0, rise / share, 1 / (exponent + 1)[:, None])
    length = np.maximum(np.linalg.norm(axis, axis=1, keepdims=True), np.finfo(float).tiny)
    return _around(axis / length, x, y, rise, slope)


def _around(axis: NDArray, x: NDArray, y: NDArray, rise: NDArray, slope: NDArray) -> Vectors:
    """Unit directions over points (x, y) of the unit disk: x, y, z of [n, s].

    `rise` is 1 - cos(angle to the axis), and `slope` is it over x^2 + y^2.
    """
    stretch = np.sqrt(slope * (2 - rise))
    x, y, z = x * stretch, y * stretch, 1 - rise
    tangent, bitangent = tangent_frame(axis)
    s, t, a = (vectors.T[:, :, None] for vectors in (tangent, bitangent, axis))
    return (
        x * s[0] + y * t[0] + z * a[0],
        x * s[1] + y * t[1] + z * a[1],
        x * s[2] + y * t[2] + z * a[2],
    )


def square_to_disk(u: NDArray, v: NDArray) -> tuple[NDArray, NDArray]:
    """Concentric map of the unit square to the unit disk, preserving area (Shirley and Chiu 1997)."""
    a, b = 2 * u - 1, 2 * v - 1
    wide = np.abs(a) > np.abs(b)
    r = np.where(wide, a, b)
    ratio = np.where(wide, b, a)
    np.divide(ratio, r, out=ratio, where=r != 0)
    sine = np.sin((np.pi / 4) * ratio)
    cosine = np.sqrt(1 - sine * sine)  # the angle is at most 45 degrees: nothing cancels
    sine *= r
    cosine *= r
    return np.where(wide, cosine, sine), np.where(wide, sine, cosine)


def tangent_frame(normal: NDArray) -> tuple[NDArray, NDArray]:
    """Two unit vectors [n, 3] that complete unit normals [n, 3] to right-handed frames (Duff et al. 2017)."""
    x, y, z = normal.T
    sign = np.copysign(1.0, z)
    a = -1 / (sign + z)
    b = x * y * a
    tangent = np.stack([1 + sign * x * x * a, sign * b, -sign * x], axis=-1)
    return tangent, np.stack([b, sign + y * y * a, -y], axis=-1)
