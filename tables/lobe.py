"""Cosine lobes c(v) = s max(a.v, 0)^e in float64: the truth that tables and kernels are tested against.

Equation numbers are those of Meunier et al. 2009. Exponents e >= 0, angles in radians, solid angles in sr.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import betaln, digamma, polygamma, xlogy

from coslobe.tables.quadrature import double_exponential


class ProductLobe(NamedTuple):
    """A lobe that stands for the product of two lobes of amplitude 1 (15).

    Attributes
    ----------
    axis_angle : float64 [...]
        Angle from the first lobe's axis, in the plane of both axes.
    exponent : float64 [...]
        e_r.
    scale : float64 [...]
        Partial scale p_r.
    """

    axis_angle: NDArray
    exponent: NDArray
    scale: NDArray


def evaluate(q: ArrayLike, exponent: ArrayLike) -> NDArray:
    """Value max(a.v, 0)^e from q = |a - v|^2 / 2 = 1 - a.v, which does not cancel near the axis."""
    q = np.asarray(q, np.float64)
    front = q < 1
    return np.where(front, np.exp(exponent * np.log1p(-np.where(front, q, 0.0))), 0.0)


def integral(exponent: ArrayLike) -> NDArray:
    """Integral of a lobe of amplitude 1 over the sphere, 2 pi / (e + 1) (20)."""
    return 2 * np.pi / (np.asarray(exponent, np.float64) + 1)


def peak_angle(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> NDArray:
    """Angle t from the first axis where the product of two lobes is largest (18).

    The root of e1 tan t = e2 tan(alpha - t), written without cancellation for all alpha in [0, pi];
    alpha / 2 where both exponents are 0 and every direction is as good.
    """
    e1, e2, alpha = _without_traces(e1), _without_traces(e2), np.asarray(alpha, np.float64)
    c, s, total = np.cos(alpha), np.sin(alpha), e1 + e2
    root = np.hypot(total * c, 2 * np.sqrt(e1 * e2) * s)
    t = np.where(c >= 0, np.arctan2(2 * e2 * s, total * c + root), np.arctan2(root - total * c, 2 * e1 * s))
    return np.where(total == 0, alpha / 2, t)


def _without_traces(e: ArrayLike) -> NDArray:
    """Exponents, with 0 for those that change no digit but would put a peak on the edge of a hemisphere."""
    e = np.asarray(e, np.float64)
    return np.where(e < 1e-14, 0.0, e)


def _opening(alpha: NDArray) -> NDArray:
    """Width pi - alpha of the lune that both hemispheres share, with the digits of pi that float64 lacks."""
    return np.where(alpha < np.pi, np.pi - alpha + 1.2246467991473532e-16, 0.0)


def log_product_integral(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> NDArray:
    """log of G(e1, e2, alpha), the integral of the product of two lobes; -inf at alpha = pi.

    With both axes in the plane psi = 0 the integral separates into a Beta function and one integral over
    phi (theory, section 2):  G = B((e1 + e2 + 2) / 2, 1 / 2) * J,
    J = integral of cos^e1(phi) cos^e2(phi - alpha) over [alpha - pi / 2, pi / 2].
    """
    e1, e2, alpha = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (e1, e2, alpha)))
    nodes = _quadrature(e1.ravel(), e2.ravel(), alpha.ravel())
    with np.errstate(divide="ignore"):  # at alpha = pi nothing is left
        log_j = nodes.log_peak + np.log(nodes.weights.sum(axis=0))
    return (betaln((e1 + e2 + 2) / 2, 0.5).ravel() + log_j).reshape(e1.shape)


def product_integral(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> NDArray:
    """G(e1, e2, alpha); see `log_product_integral`."""
    return np.exp(log_product_integral(e1, e2, alpha))


def product_l2(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> ProductLobe:
    """The paper's two steps: axis at the peak (18), then p_r and e_r that minimise the L2 distance (19).

    For a given e_r the best p_r is <c1 c2, psi_r> / <psi_r, psi_r>, so one unknown is left. Its equation is
    solved by Newton steps in log(e_r + 1/2), halved towards the bracket where they leave it.
    """
    e1, e2, alpha = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (e1, e2, alpha)))
    shape = e1.shape
    f1, f2, fa = e1.ravel(), e2.ravel(), alpha.ravel()
    nodes = _quadrature(f1, f2, fa)
    total = f1 + f2
    y = np.log(curvature_exponent(f1, f2, fa) + 0.5)
    low, high = np.full_like(y, np.log(0.5) - 1e-9), y + np.log(64.0)
    for _ in range(60):
        slope, curvature = _overlap_slopes(nodes, total, y)
        low, high = np.where(slope > 0, y, low), np.where(slope > 0, high, y)
        with np.errstate(divide="ignore", invalid="ignore"):
            step = -slope / curvature
        newton = y + step
        usable = (curvature < 0) & (newton > low) & (newton < high)
        following = np.where(usable, newton, (low + high) / 2)
        converged = np.max(np.abs(following - y), initial=0.0) < 1e-12
        y = following
        if converged:
            break
    er = np.maximum(np.exp(y) - 0.5, 0.0)
    overlap = betaln((total + er + 2) / 2, 0.5) + nodes.log_peak
    overlap = overlap + np.log((nodes.weights * np.exp(er * nodes.log_cosine)).sum(axis=0))
    scale = np.exp(overlap + np.log((2 * er + 1) / (2 * np.pi)))
    return ProductLobe(nodes.peak.reshape(shape), er.reshape(shape), scale.reshape(shape))


def _overlap_slopes(nodes: "_Nodes", total: NDArray, y: NDArray) -> tuple[NDArray, NDArray]:
    """First and second derivative in y = log(e_r + 1/2) of log(<c1 c2, psi_r>^2 / <psi_r, psi_r>)."""
    m = np.exp(y)  # e_r + 1/2
    er = m - 0.5
    weighted = nodes.weights * np.exp(er * nodes.log_cosine)
    h0 = weighted.sum(axis=0)
    h1 = (weighted * nodes.log_cosine).sum(axis=0) / h0
    h2 = (weighted * nodes.log_cosine**2).sum(axis=0) / h0 - h1**2
    z = (total + er + 2) / 2
    first = 2 * h1 + (digamma(z) - digamma(z + 0.5)) + 1 / m
    beta2 = (polygamma(1, z) - polygamma(1, z + 0.5)) / 2
    second = 2 * h2 + beta2 - 1 / m**2
    return first * m, second * m**2 + first * m


def product_energy(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> ProductLobe:
    """The L2 fit's axis and exponent with the scale that makes the lobe's integral equal to G."""
    fit = product_l2(e1, e2, alpha)
    scale = product_integral(e1, e2, alpha) * (fit.exponent + 1) / (2 * np.pi)
    return fit._replace(scale=scale)


def product_curvature(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> ProductLobe:
    """The closed form without a table: peak value, and the geometric mean of the curvatures at the peak."""
    e1, e2, alpha = np.broadcast_arrays(*(np.asarray(x, np.float64) for x in (e1, e2, alpha)))
    t = peak_angle(e1, e2, alpha)
    return ProductLobe(t, curvature_exponent(e1, e2, alpha), np.exp(log_peak(e1, e2, alpha)))


def log_peak(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> NDArray:
    """log of the product's largest value."""
    e1, e2, alpha = (np.asarray(x, np.float64) for x in (e1, e2, alpha))
    t = peak_angle(e1, e2, alpha)
    return _log_integrand(e1, e2, np.pi / 2 - t, np.pi / 2 - (alpha - t))


def curvature_exponent(e1: ArrayLike, e2: ArrayLike, alpha: ArrayLike) -> NDArray:
    """sqrt((e1 + e2) k): geometric mean of the product's curvatures across and in the plane of the axes."""
    e1, e2, alpha = (np.asarray(x, np.float64) for x in (e1, e2, alpha))
    return np.sqrt((e1 + e2) * _peak_curvature(e1, e2, alpha, peak_angle(e1, e2, alpha)))


def _peak_curvature(e1: NDArray, e2: NDArray, alpha: NDArray, t: NDArray) -> NDArray:
    """In the plane of the axes, e1 sec^2 t + e2 sec^2(alpha - t); exponent 0 has none, even on its edge."""
    with np.errstate(divide="ignore", invalid="ignore"):
        first = np.where(e1 > 0, e1 / np.cos(t) ** 2, 0.0)
        second = np.where(e2 > 0, e2 / np.cos(alpha - t) ** 2, 0.0)
    return first + second


class _Nodes(NamedTuple):
    """Quadrature of cos^e1(phi) cos^e2(phi - alpha) dphi around its peak, arrays [nodes, n] or [n].

    `weights` hold the integrand divided by its peak value exp(log_peak); `log_cosine` is log cos(phi - peak).
    """

    weights: NDArray
    log_cosine: NDArray
    peak: NDArray
    log_peak: NDArray


def _log_integrand(e1: NDArray, e2: NDArray, from_end: NDArray, from_start: NDArray) -> NDArray:
    """log of cos^e1(phi) cos^e2(phi - alpha) from the distances of phi to pi / 2 and to alpha - pi / 2."""
    return xlogy(e1, np.sin(np.maximum(from_end, 0))) + xlogy(e2, np.sin(np.maximum(from_start, 0)))


def _quadrature(e1: NDArray, e2: NDArray, alpha: NDArray) -> _Nodes:
    e1, e2 = _without_traces(e1), _without_traces(e2)
    t = peak_angle(e1, e2, alpha)
    # Distances from the peak to both ends of the lune, pi/2 - t and pi/2 - (alpha - t). They obey the peak's
    # equation with the exponents exchanged; phi is never formed, so that nothing cancels near the ends.
    opening = _opening(alpha)
    to_end, to_start = peak_angle(e2, e1, opening), peak_angle(e1, e2, opening)
    log_peak = _log_integrand(e1, e2, to_end, to_start)

    def drop(d: NDArray, sign: int) -> NDArray:
        return _log_integrand(e1, e2, to_end - sign * d, to_start + sign * d) - log_peak

    near, far, step = double_exponential()
    weights, log_cosine = [], []
    for sign, room in ((1, to_end), (-1, to_start)):
        reach = _reach(lambda d, sign=sign: drop(d, sign), room)
        rest = room - reach
        d = reach * near
        ahead = rest + reach * far  # distance left to the end on this side
        behind = (to_start if sign > 0 else to_end) + d
        pair = (ahead, behind) if sign > 0 else (behind, ahead)
        with np.errstate(divide="ignore", invalid="ignore"):
            value = np.exp(_log_integrand(e1, e2, *pair) - log_peak)
        weights.append(np.where(np.isfinite(value), value, 0.0) * step * reach)
        log_cosine.append(np.log(np.maximum(np.cos(d), 1e-300)))
    return _Nodes(np.concatenate(weights), np.concatenate(log_cosine), t, log_peak)


def _reach(drop: Callable[[NDArray], NDArray], room: NDArray) -> NDArray:
    """How far from the peak the integrand exceeds exp(-50) of it, by bisection; at most `room`."""
    low, high = np.zeros_like(room), room.copy()
    with np.errstate(divide="ignore", invalid="ignore"):
        whole = drop(room * (1 - 1e-12)) > -50
        for _ in range(40):
            middle = (low + high) / 2
            inside = drop(middle) > -50
            low, high = np.where(inside, middle, low), np.where(inside, high, middle)
    return np.where(whole, room, high)
