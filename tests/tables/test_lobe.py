"""Lobe mathematics against closed forms and arbitrary precision."""

from itertools import pairwise

import mpmath as mp
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.optimize import minimize

from coslobe.tables import lobe

exponents = st.one_of(st.just(0.0), st.floats(0, 1), st.floats(1, 100), st.floats(100, 1e5))


@pytest.mark.parametrize("e", [0.0, 0.3, 1.0, 7.5, 1e3, 1e5])
def test_integral_of_a_lobe(e):
    numeric, _ = quad(
        lambda g: np.cos(g) ** e * np.sin(g), 0, np.pi / 2, points=[min(3 / (e + 1) ** 0.5, 1)], limit=200
    )
    assert lobe.integral(e) == pytest.approx(2 * np.pi * numeric, rel=1e-8)


@pytest.mark.parametrize("e", [0.0, 1.0, 50.0, 9e4])
def test_value_of_a_lobe_near_its_axis(e):
    """The q form keeps full relative precision where a rounded dot product has lost it."""
    angle = 1e-4
    q = 2 * np.sin(angle / 2) ** 2
    with mp.workdps(40):
        exact = float(mp.cos(mp.mpf(angle)) ** e)
    assert lobe.evaluate(q, e) == pytest.approx(exact, rel=1e-12)
    assert lobe.evaluate(1.0, e) == 0
    assert lobe.evaluate(1.7, e) == 0


@pytest.mark.parametrize("seed", range(10))
@pytest.mark.filterwarnings("error")
def test_product_integral_against_arbitrary_precision(seed):
    rng = np.random.default_rng(seed)
    tiny, middle, high = 10 ** rng.uniform((-16, 0, 2), (0, 2, 5))
    kinds = [0.0, tiny, rng.uniform(0, 1), middle, high]
    e1, e2 = rng.choice(kinds, 2)
    widths = np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1))
    alpha = rng.choice(
        [rng.uniform(0, np.pi), min(rng.uniform(0, 6) * widths, 3.1), np.pi - 10 ** rng.uniform(-8, 0)]
    )
    found = float(lobe.log_product_integral(e1, e2, alpha))
    exact, error = _mpmath_log_product(e1, e2, alpha)
    assert error < 1e-12
    assert abs(found - exact) <= 1e-10 * max(1, abs(exact))


def _mpmath_log_product(e1, e2, alpha):
    """log G and the relative error of the quadrature, cut at every scale on both sides of the peak.

    With u = pi / 2 - phi and L = pi - alpha the integrand is sin^e1(u) sin^e2(L - u) on [0, L].
    """
    with mp.workdps(40):
        a, b = mp.mpf(e1), mp.mpf(e2)
        L = mp.pi - mp.mpf(alpha)
        along, across = (a + b) * mp.cos(L), 2 * mp.sqrt(a * b) * mp.sin(L)
        peak = mp.atan2(2 * a * mp.sin(L), along + mp.sqrt(along**2 + across**2)) if a + b > 0 else L / 2
        scales = [L * mp.mpf(2) ** -k for k in range(70)]
        cuts = {mp.mpf(0), peak, L, *(peak + s for s in scales), *(peak - s for s in scales)}
        cuts |= {*scales, *(L - s for s in scales)}
        curvature = sum(
            e / max(mp.sin(d), mp.mpf("1e-12")) ** 2 for e, d in ((a, peak), (b, L - peak)) if e > 0
        )
        widths = [k / mp.sqrt(curvature + 1 / L**2) for k in (1, 2, 3, 4, 5, 6, 8, 10, 12, 14, 18, 24)]
        cuts |= {*(peak + w for w in widths), *(peak - w for w in widths)}
        points = sorted(p for p in cuts if 0 <= p <= L)

        top = mp.mpf(0)  # mpmath stops at an absolute error, so the integrand has a peak of 1
        for exponent, distance in ((a, peak), (b, L - peak)):
            top += exponent * mp.log(mp.sin(distance)) if exponent > 0 else 0

        def integrand(u):
            return mp.sin(u) ** a * mp.sin(L - u) ** b / mp.exp(top)

        total, error = mp.mpf(0), mp.mpf(0)
        for low, high in pairwise(points):
            largest = max(integrand(low), integrand(high), integrand(min(max(peak, low), high)))
            if high - low < L * mp.mpf(10) ** -30 or largest * L < mp.mpf(10) ** -25 * total:
                continue
            part, uncertainty = mp.quad(integrand, [low, high], error=True, maxdegree=8)
            total, error = total + part, error + abs(uncertainty)
        factor = mp.beta((a + b + 2) / 2, mp.mpf(1) / 2)
        return float(mp.log(total) + top + mp.log(factor)), float(error / total)


@pytest.mark.parametrize(("e1", "e2", "alpha"), [(0.3, 2.0, 2.9), (7.5, 40.0, 1.1), (0.0, 12.0, 1.6)])
def test_product_integral_is_a_hypergeometric_function(e1, e2, alpha):
    """A second reference: a Beta function times 2F1(e1 + 1, e2 + 1; (e1 + e2 + 3) / 2; cos^2(alpha / 2))."""
    with mp.workdps(40):
        a, b, x = mp.mpf(e1), mp.mpf(e2), mp.mpf(alpha)
        j = mp.sin(x) ** (a + b + 1) * mp.beta(a + 1, b + 1)
        j *= mp.hyp2f1(a + 1, b + 1, (a + b + 3) / 2, mp.cos(x / 2) ** 2)
        exact = float(mp.log(j * mp.beta((a + b + 2) / 2, mp.mpf(1) / 2)))
    assert float(lobe.log_product_integral(e1, e2, alpha)) == pytest.approx(exact, rel=1e-12)


@given(exponents, exponents)
@settings(max_examples=50, deadline=None)
def test_coaxial_product(e1, e2):
    assert float(lobe.product_integral(e1, e2, 0.0)) == pytest.approx(2 * np.pi / (e1 + e2 + 1), rel=1e-9)
    fit = lobe.product_l2(e1, e2, 0.0)
    assert float(fit.exponent) == pytest.approx(e1 + e2, rel=1e-6, abs=1e-6)
    assert float(fit.scale) == pytest.approx(1, rel=1e-6)


@given(exponents, exponents, st.floats(0, np.pi))
@settings(max_examples=50, deadline=None)
def test_products_are_symmetric(e1, e2, alpha):
    one, two = lobe.log_product_integral(e1, e2, alpha), lobe.log_product_integral(e2, e1, alpha)
    assert one == two or abs(one - two) <= 1e-9 * max(1, abs(one))
    t = lobe.peak_angle(e1, e2, alpha)
    assert 0 <= t <= alpha + 1e-12
    assert t + lobe.peak_angle(e2, e1, alpha) == pytest.approx(alpha, abs=1e-9)


def test_two_hemispheres():
    """Two lobes of exponent 0 overlap in a lune of angle pi - alpha, whose solid angle is 2 (pi - alpha)."""
    alpha = np.linspace(0, 3.1, 20)
    np.testing.assert_allclose(lobe.product_integral(0, 0, alpha), 2 * (np.pi - alpha), rtol=1e-12)


def test_peak_is_the_stationary_point():
    rng = np.random.default_rng(3)
    e1, e2 = 10 ** rng.uniform(-1, 4, (2, 200))
    alpha = rng.uniform(0.01, 3.1, 200)
    t = lobe.peak_angle(e1, e2, alpha)
    np.testing.assert_allclose(e1 * np.tan(t), e2 * np.tan(alpha - t), rtol=1e-8)


def test_l2_fit_is_the_minimum():
    """Moving e_r or p_r away from the fit raises the L2 distance, computed by brute force over the sphere."""
    for e1, e2, alpha in ((3.0, 12.0, 0.7), (40.0, 40.0, 0.3), (0.5, 1.5, 1.6)):
        fit = lobe.product_l2(e1, e2, alpha)
        found = minimize(
            lambda x, args=(e1, e2, alpha, float(fit.axis_angle)): _l2_distance(
                np.exp(x[0]), np.exp(x[1]), *args
            ),
            [np.log(fit.exponent) + 0.1, np.log(fit.scale) - 0.1],
            method="Nelder-Mead",
            options={"xatol": 1e-7, "fatol": 1e-16},
        )
        assert np.exp(found.x[0]) == pytest.approx(float(fit.exponent), rel=1e-3)  # the grid's own error
        assert np.exp(found.x[1]) == pytest.approx(float(fit.scale), rel=1e-3)


def _l2_distance(er, scale, e1, e2, alpha, t):
    psi = (np.arange(200) + 0.5) / 200 * np.pi - np.pi / 2
    phi = (np.arange(400) + 0.5) / 400 * 2 * np.pi - np.pi
    p, f = np.meshgrid(psi, phi, indexing="ij")

    def value(angle, exponent):
        return np.maximum(np.cos(p) * np.cos(f - angle), 0) ** exponent

    difference = value(0, e1) * value(alpha, e2) - scale * value(t, er)
    return (difference**2 * np.cos(p)).sum() * (np.pi / 200) * (2 * np.pi / 400)


def test_energy_conserving_scale_gives_the_exact_integral():
    e1, e2, alpha = np.meshgrid([0.2, 5.0, 900.0], [1.0, 60.0, 4e4], [0.0, 0.05, 0.6])
    fit = lobe.product_energy(e1, e2, alpha)
    found = fit.scale * lobe.integral(fit.exponent)
    np.testing.assert_allclose(found, lobe.product_integral(e1, e2, alpha), rtol=1e-12)


def test_curvature_form_is_close_for_sharp_lobes():
    """The closed form needs no table; it misses by a few per cent at most (theory, section 2)."""
    e1, e2 = np.meshgrid(np.geomspace(20, 1e4, 6), np.geomspace(20, 1e4, 6))
    alpha = 2 * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1))
    form = lobe.product_curvature(e1, e2, alpha)
    np.testing.assert_allclose(
        form.scale * lobe.integral(form.exponent), lobe.product_integral(e1, e2, alpha), rtol=0.04
    )
