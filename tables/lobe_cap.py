"""The lobe-over-cap table: a lobe integrated over a cap, and the mean direction of what it collects.

For the lobe max(r.v, 0)^e, a cap of half-angle alpha around a, and theta the angle between r and a:

    T = integral over the cap of (r.v)^e dv
    m = integral over the cap of (r.v)^e v dv = T (X r + V (a - r cos theta))

so that the integral with a cosine, of (r.v)^e (n.v), is n.m without any approximation of the cosine. X is the
mean of r.v and V measures the pull towards the cap's axis; both lie in [0, 1] up to rounding and are smooth.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coslobe.tables.grid import (
    MAX_EXPONENT,
    cubic_weights,
    exponent_coordinate,
    exponent_nodes,
    in_parts,
)
from coslobe.tables.quadrature import double_exponential

EXPONENTS = 36
CAPS = 72
ANGLES = 48
LARGEST_CAP = 1.2  # rad; wider lights are integrated cell by cell
SMALLEST_CAP = 0.03  # lobe widths; a smaller cap collects the lobe's value at its centre
INNER, OUTER = 6.0, 7.0  # lobe widths inside and outside the cap's edge between which T changes
_SOFTNESS = 4.0  # power of the smooth minimum below


class Moments(NamedTuple):
    """Integrals of one lobe over one cap, arrays of the broadcast shape.

    Attributes
    ----------
    integral : T in sr.
    along_lobe : X, the mean of r.v over what is collected.
    towards_cap : V; the mean direction is X r + V (a - r cos theta).
    """

    integral: NDArray
    along_lobe: NDArray
    towards_cap: NDArray


def exact(exponent: ArrayLike, theta: ArrayLike, alpha: ArrayLike) -> Moments:
    """The three moments by one-dimensional quadrature over rings around the lobe's axis.

    theta in [0, pi], alpha in (0, pi / 2]. The ring at angle g from r lies in the cap over an arc of
    half-angle psi, tan^2(psi / 2) = (cos(g - theta) - cos alpha) / (cos alpha - cos(g + theta)), which is
    evaluated as products of sines so that tiny caps lose no digits.
    """
    arrays = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (exponent, theta, alpha)))
    shape = arrays[0].shape
    e, theta, alpha = (x.ravel() for x in arrays)
    theta = np.maximum(theta, 1e-7 * alpha)  # V has a limit at theta = 0 that the formula divides by 0
    inside = alpha > theta
    g0 = np.abs(alpha - theta)  # rings up to here are whole where the lobe's axis lies in the cap
    room = np.minimum(2 * np.minimum(theta, alpha), np.pi / 2 - g0)
    visible = room > 0
    room = np.where(visible, room, 0.0)
    with np.errstate(divide="ignore"):
        decay = 45 / np.maximum(e, 1e-300)  # beyond cos g / cos g0 = exp(-decay) nothing is left
    farthest = np.arccos(np.clip(np.cos(g0) * np.exp(-decay), 0, 1))
    length = np.minimum(room, np.maximum(farthest - g0, 0))

    x, complement, weight = double_exponential()
    d = length * x
    rest = 2 * np.minimum(theta, alpha) - length + length * complement  # distance of g to theta + alpha
    near, far = np.where(inside, 2 * g0 + d, d), np.where(inside, d, 2 * g0 + d)
    sine = np.sin
    numerator = sine(near / 2) * sine(rest / 2)
    denominator = sine((2 * np.maximum(alpha, theta) + d) / 2) * sine(far / 2)
    psi = 2 * np.arctan2(np.sqrt(np.maximum(numerator, 0)), np.sqrt(np.maximum(denominator, 0)))
    g = g0 + d
    cos_g = np.sin(np.maximum(np.pi / 2 - g0 - length, 0) + length * complement)
    measure = weight * length * np.sin(g)
    log_lobe = e * np.log(np.maximum(cos_g, 1e-300))
    top = np.where(inside, 0.0, e * np.log(np.maximum(np.cos(g0), 1e-300)))  # the largest value, factored out
    value = np.exp(log_lobe - top)
    t = (measure * value * 2 * psi).sum(axis=0)
    along = (measure * value * cos_g * 2 * psi).sum(axis=0)
    across = (measure * value * np.sin(g) * 2 * np.sin(psi)).sum(axis=0)

    log_edge = np.log(np.maximum(np.cos(g0), 1e-300))
    whole = np.where(inside, -2 * np.pi * np.expm1((e + 1) * log_edge) / (e + 1), 0.0)
    whole_along = np.where(inside, -2 * np.pi * np.expm1((e + 2) * log_edge) / (e + 2), 0.0)
    t, along = t + whole, along + whole_along
    with np.errstate(divide="ignore", invalid="ignore"):
        mean_along = np.where(t > 0, along / t, np.cos(theta))
        towards = np.where(t > 0, across / (t * np.sin(theta)), 1.0)
    integral = np.where(visible | inside, t * np.exp(top), 0.0)
    return Moments(integral.reshape(shape), mean_along.reshape(shape), towards.reshape(shape))


def width(exponent: ArrayLike) -> NDArray:
    """The lobe's width sqrt(1 / (e + 1)) in rad, the unit in which caps and angles are sampled."""
    return 1 / np.sqrt(np.asarray(exponent, np.float64) + 1)


def angle_range(exponent: ArrayLike, alpha: ArrayLike) -> tuple[NDArray, NDArray]:
    """First and last sampled theta: before the first T keeps its value, beyond the last it is 0.

    Smooth minima join the narrow-lobe and the narrow-cap regime, because a kink here would be a kink in
    what is interpolated.
    """
    w = width(exponent)
    alpha = np.maximum(alpha, SMALLEST_CAP * w)  # smaller caps share the smallest one's samples
    first = alpha - _smooth_minimum(alpha, INNER * w)
    last = alpha + _smooth_minimum(np.pi / 2, OUTER * w)
    return first, last


def _smooth_minimum(a: ArrayLike, b: ArrayLike) -> NDArray:
    a, b = np.asarray(a, np.float64), np.asarray(b, np.float64)
    return a * (1 + (a / b) ** _SOFTNESS) ** (-1 / _SOFTNESS)


def scale(exponent: ArrayLike, alpha: ArrayLike) -> NDArray:
    """What T is relative to: the smaller of the cap's solid angle and the lobe's integral, smoothly."""
    cap = 4 * np.pi * np.sin(np.asarray(alpha, np.float64) / 2) ** 2
    whole = 2 * np.pi / (np.asarray(exponent, np.float64) + 1)
    return cap * whole / (cap + whole)


def cap_coordinate(exponent: ArrayLike, alpha: ArrayLike) -> NDArray:
    """Fractional index of a cap: the logarithm of its half-angle in lobe widths."""
    s = np.asarray(alpha, np.float64) / width(exponent)
    return np.log(np.maximum(s / SMALLEST_CAP, 1.0)) * CAPS_PER_LOG


CAPS_PER_LOG = (CAPS - 1) / np.log(LARGEST_CAP / (SMALLEST_CAP * width(MAX_EXPONENT)))


@dataclass(frozen=True)
class LobeCapTable:
    """Samples of the moments.

    Attributes
    ----------
    values : float32 [EXPONENTS, CAPS, ANGLES, 4]
        log(T / scale), its derivative per angle step, X and V.
    """

    values: NDArray

    def slice(self, exponents: ArrayLike) -> NDArray:
        """The table at given exponents [k], cubic along the exponent: float32 [k, CAPS, ANGLES, 4].

        Materials have few exponents, so the kernel interpolates in slices of two dimensions.
        """
        x = exponent_coordinate(np.minimum(exponents, MAX_EXPONENT))
        i, weights = cubic_weights(x / exponent_coordinate(MAX_EXPONENT) * (EXPONENTS - 1), EXPONENTS)
        taps = sum(weights[..., k, None, None, None] * self.values[i[..., k]] for k in range(4))
        return np.asarray(taps, np.float32)

    def lookup(self, exponent: ArrayLike, theta: ArrayLike, alpha: ArrayLike) -> Moments:
        """Interpolate at broadcast arguments; see `slice` and `lookup_slice`.

        Beyond the range: exponents above MAX_EXPONENT keep the last residuals at the same cap and angle in
        lobe widths; caps above LARGEST_CAP, up to a hemisphere, are integrated exactly.
        """
        arrays = (np.asarray(x, np.float64) for x in (exponent, theta, alpha))
        e, theta, alpha = np.broadcast_arrays(*arrays)
        distinct, index = np.unique(e, return_inverse=True)
        parts = [np.empty(e.shape) for _ in range(3)]
        for start in range(0, len(distinct), 256):  # bounds the memory of the slices
            chosen = (index >= start) & (index < start + 256)
            slices = self.slice(distinct[start : start + 256])
            which = index[chosen] - start
            moments = lookup_slice(slices, which, e[chosen], theta[chosen], alpha[chosen])
            for part, moment in zip(parts, moments, strict=True):
                part[chosen] = moment
        wide = alpha > LARGEST_CAP
        if wide.any():
            for part, moment in zip(parts, exact(e[wide], theta[wide], alpha[wide]), strict=True):
                part[wide] = moment
        return Moments(*parts)


def lookup_slice(
    slices: NDArray, index: NDArray, exponent: NDArray, theta: NDArray, alpha: NDArray
) -> Moments:
    """Interpolate in slices [k, CAPS, ANGLES, 4]: cubic along the cap, cubic Hermite along the angle.

    The kernel's twin. `index` says which slice; `exponent` is that slice's exponent. alpha must not exceed
    LARGEST_CAP.
    """
    first, last = angle_range(exponent, alpha)
    j, weights = cubic_weights(cap_coordinate(exponent, alpha), CAPS)
    z = np.clip((theta - first) / (last - first) * (ANGLES - 1), 0, ANGLES - 1)
    k = np.minimum(z.astype(np.int64), ANGLES - 2)
    f = z - k
    h00, h10 = (1 + 2 * f) * (1 - f) ** 2, f * (1 - f) ** 2
    h01, h11 = f**2 * (3 - 2 * f), f**2 * (f - 1)
    log_t = along = towards = np.zeros(np.shape(z))
    for tap in range(4):
        a, b = slices[index, j[..., tap], k], slices[index, j[..., tap], k + 1]
        w = weights[..., tap]
        log_t = log_t + w * (h00 * a[..., 0] + h10 * a[..., 1] + h01 * b[..., 0] + h11 * b[..., 1])
        along = along + w * ((1 - f) * a[..., 2] + f * b[..., 2])
        towards = towards + w * ((1 - f) * a[..., 3] + f * b[..., 3])
    integral = np.where(theta > last, 0.0, np.exp(log_t) * scale(exponent, alpha))
    return Moments(integral, along, towards)


def build() -> LobeCapTable:
    """Sample the exact moments; about 125,000 nodes."""
    e = np.repeat(exponent_nodes(EXPONENTS), CAPS)
    # Low exponents reach the largest cap before the last node; what lies beyond is never read.
    alpha = SMALLEST_CAP * width(e) * np.tile(np.exp(np.arange(CAPS) / CAPS_PER_LOG), EXPONENTS)
    values = in_parts(_samples, e[:, None], np.minimum(alpha, np.pi / 2)[:, None], size=CAPS)
    return LobeCapTable(values.reshape(EXPONENTS, CAPS, ANGLES, 4))


def _samples(e: NDArray, alpha: NDArray) -> NDArray:
    """Samples over the angle, float32 [n, ANGLES, 4], for exponents and caps [n, 1]."""
    first, last = angle_range(e, alpha)
    u = np.linspace(0, 1, ANGLES)
    du = 1e-4 / (ANGLES - 1)

    def log_t(position: NDArray) -> NDArray:
        t = exact(e, first + position * (last - first), alpha).integral
        return np.log(np.maximum(t, 1e-300) / scale(e, alpha))

    before, after = np.maximum(u - du, 0), np.minimum(u + du, 1)
    moments = exact(e, first + u * (last - first), alpha)
    logs = np.log(np.maximum(moments.integral, 1e-300) / scale(e, alpha))
    slope = (log_t(after) - log_t(before)) / ((after - before) * (ANGLES - 1))
    return np.stack([logs, slope, moments.along_lobe, moments.towards_cap], axis=-1).astype(np.float32)
