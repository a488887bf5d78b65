"""The paper's own method, and the order of the interpolation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import least_squares, minimize

from coslobe.tables import grid, lobe, product, store

exponents = st.one_of(st.floats(0, 1), st.floats(1, 100), st.floats(100, 1e5))


@pytest.fixture(scope="module")
def table():
    return store.cached().product


def test_the_papers_method_agrees_with_the_fast_path():
    """Nelder-Mead for the axis (18), Levenberg-Marquardt for p_r and e_r (19), started as in Sec. 4.1.

    300 triples of products that are not negligible. The residuals of (19) are weighted values on a grid of
    directions around the product's peak.
    """
    rng = np.random.default_rng(0)
    e1, e2 = 10 ** rng.uniform(0, 4, (2, 300))
    alpha = rng.uniform(0, 2, 300) * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1))
    fast = lobe.product_l2(e1, e2, alpha)
    x, weight = np.polynomial.legendre.leggauss(40)
    for i in range(300):
        a, b, angle = e1[i], e2[i], alpha[i]
        width = 1 / np.sqrt(max(a, b) + 1)

        def minus_log_product(v, a=a, b=b, angle=angle, width=width):
            psi, phi = v * width
            cosines = np.cos(psi) * np.cos(phi), np.cos(psi) * np.cos(phi - angle)
            return np.inf if min(cosines) <= 0 else -(a * np.log(cosines[0]) + b * np.log(cosines[1]))

        start = np.array([0.1, angle / 2 / width])
        found = minimize(
            minus_log_product, start, method="Nelder-Mead", options={"xatol": 1e-7, "fatol": 1e-14}
        )
        psi_r, t = found.x * width
        assert abs(psi_r) < 1e-5 * width + 1e-7
        assert abs(t - fast.axis_angle[i]) < 1e-5 * width + 1e-7

        reach = min(7 / np.sqrt(a + b), np.pi / 2)  # the product is below exp(-24) of its peak beyond
        psi, phi = reach * x[:, None], t + reach * x[None, :]
        root = np.sqrt(weight[:, None] * weight[None, :] * np.cos(psi))
        value = np.cos(psi) * np.maximum(np.cos(phi), 0), np.cos(psi) * np.maximum(np.cos(phi - angle), 0)
        peak = np.exp(lobe.log_peak(a, b, angle))
        target = value[0] ** a * value[1] ** b / peak
        along = np.cos(psi) * np.maximum(np.cos(phi - t), 0)

        def residual(p, target=target, along=along, root=root, total=a + b):
            return (root * (target - p[0] * along ** (total * np.exp(p[1])))).ravel()

        fit = least_squares(residual, [1.0, 0.0], method="lm", xtol=1e-10, ftol=1e-10)
        # The cut and the corners of hemispheres leave 0.2 % in the grid.
        assert (a + b) * np.exp(fit.x[1]) == pytest.approx(fast.exponent[i], rel=2e-3)
        assert fit.x[0] * peak == pytest.approx(fast.scale[i], rel=2e-3)


def test_interpolation_has_the_declared_order(table):
    """Linear in log residuals: every halving of the spacing divides the error by 4, slope 2 +- 0.25."""
    rng = np.random.default_rng(1)
    e1, e2 = 10 ** rng.uniform(0, 4.5, (2, 4000))
    alpha = rng.uniform(0, 2.5, 4000) * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1))
    alpha = np.minimum(alpha, 1.4)
    exact = lobe.log_product_integral(e1, e2, alpha)
    errors = []
    sizes = ((10, 8), (19, 15), (37, 29))
    for exponents_n, angles_n in sizes:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(product, "EXPONENTS", exponents_n)
            patch.setattr(product, "ANGLES", angles_n)
            patch.setattr(lobe, "product_l2", lobe.product_curvature)  # only the integral is looked at
            found = product.build().lookup(e1, e2, alpha)
        errors.append(np.mean(np.abs(np.log(found.integral) - exact)))
    slope = np.polyfit(np.log([1 / (n - 1) for n, _ in sizes]), np.log(errors), 1)[0]
    assert slope == pytest.approx(2, abs=0.25)


@given(exponents, exponents, st.floats(0, np.pi))
@settings(max_examples=200, deadline=None)
def test_products_keep_their_invariants(table, e1, e2, alpha):
    one, two = table.lookup(e1, e2, alpha), table.lookup(e2, e1, alpha)
    np.testing.assert_allclose(one[1:], two[1:], rtol=1e-9, atol=1e-300)
    assert all(np.isfinite(value) for value in one)
    assert 0 <= one.axis_angle <= alpha + 1e-12
    assert one.exponent >= max(e1, e2) * (1 - 2e-3) - 1e-3  # interpolated
    assert one.integral <= 2 * np.pi / (e1 + e2 + 1) * 1.01
    assert one.scale_energy * lobe.integral(one.exponent) == pytest.approx(float(one.integral), rel=1e-12)


@given(exponents, exponents, st.floats(0, 1), st.floats(0, 1))
@settings(max_examples=100, deadline=None)
def test_products_fall_with_the_angle(table, e1, e2, x, y):
    near, far = sorted(np.array([x, y]) * product.largest_angle(e1, e2))
    coaxial = 2 * np.pi / (e1 + e2 + 1)
    assert table.lookup(e1, e2, far).integral <= table.lookup(e1, e2, near).integral + 5e-3 * coaxial


@given(st.floats(0, 1e5))
def test_exponent_coordinates_invert(e):
    assert grid.exponent_of(grid.exponent_coordinate(e)) == pytest.approx(e, rel=1e-12, abs=1e-12)


def test_parts_do_not_change_results():
    rng = np.random.default_rng(0)
    values = rng.random(1000)
    np.testing.assert_array_equal(grid.in_parts(np.sqrt, values, size=7), np.sqrt(values))
