"""The tables: interpolation error, exact cases, files that refuse to be wrong."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import dblquad

from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.tables import cap, errors, figures, integral, lobe, lobe_cap, product, store


@pytest.fixture(scope="module")
def tables():
    return store.cached()


def test_products_in_the_stated_sampling(tables):
    report = errors.report(tables)
    energy = report["product_error"]["energy"]
    assert energy["mean"] <= 1e-5
    assert energy["variance"] <= 1e-9
    assert report["integral_error"]["mean"] <= 1e-4
    assert report["cap_error"]["max"] <= 1e-6
    assert report["lobe_cap_error"]["mean"] <= 1e-4


def test_relative_error_and_shape_of_products(tables):
    """p99 of the relative error, and the L2 scale against what the exact L2 fit itself misses."""
    e1, e2, alpha = errors.contract_triples(np.random.default_rng(0), 20_000)
    exact = lobe.product_integral(e1, e2, alpha)
    found, fit = tables.product.lookup(e1, e2, alpha), lobe.product_l2(e1, e2, alpha)
    large = exact > 1e-8
    assert np.quantile(np.abs(found.integral - exact)[large] / exact[large], 0.99) <= 1e-3
    own = np.mean(np.abs(fit.scale * lobe.integral(fit.exponent) - exact))
    assert np.mean(np.abs(found.scale_l2 * lobe.integral(found.exponent) - exact)) == pytest.approx(
        own, rel=0.05
    )


def test_products_of_low_exponents_near_right_angles(tables):
    """Where the paper reports 50 % error: the energy-conserving product stays within 5 %."""
    rng = np.random.default_rng(0)
    e1, e2 = rng.uniform(0, 1, (2, 2000))
    alpha = rng.uniform(1.2, 1.9, 2000)
    exact = lobe.product_integral(e1, e2, alpha)
    np.testing.assert_allclose(tables.product.lookup(e1, e2, alpha).integral, exact, rtol=0.05)


def test_products_beyond_the_range(tables):
    far = tables.product.lookup(1e3, 1e3, 2.5)
    assert far.integral == far.scale_energy == far.scale_l2 == 0
    assert far.exponent == 2e3
    assert tables.product.lookup(0.0, 0.0, np.pi).integral == 0
    sharp = tables.product.lookup(1e6, 10.0, 0.0005)
    assert float(sharp.integral) == pytest.approx(float(lobe.product_integral(1e6, 10.0, 0.0005)), rel=1e-2)


def test_angles_beyond_the_last_sample_are_negligible():
    """Below the stated share of the coaxial product, so that 0 is the right answer."""
    e1, e2 = np.meshgrid(np.geomspace(30, 1e5, 30), np.geomspace(30, 1e5, 30))
    last = product.largest_angle(e1, e2)
    assert (last < np.pi).any()
    ratio = lobe.log_product_integral(e1, e2, last) - np.log(lobe.integral(e1 + e2))
    assert ratio[last < np.pi].max() < np.log(product.NEGLIGIBLE)


def test_exponents_beyond_the_range(tables):
    """Lobes are self-similar there: last residuals with their own closed forms stay within 2 %."""
    e1, e2 = np.meshgrid([2e5, 1e6], [0.5, 30.0, 1e4, 1e6])
    for widths in (0.0, 1.0, 3.0):
        alpha = widths * np.sqrt(1 / (e1 + 1) + 1 / (e2 + 1))
        found = tables.product.lookup(e1, e2, alpha)
        np.testing.assert_allclose(found.integral, lobe.product_integral(e1, e2, alpha), rtol=0.02)
    alpha, theta = np.meshgrid([1e-4, 0.01, 0.5, 1.1], [0.0, 2e-3])
    moments, exact = tables.lobe_cap.lookup(1e6, theta, alpha), lobe_cap.exact(1e6, theta, alpha)
    peak = lobe_cap.exact(1e6, 0.0, alpha).integral
    np.testing.assert_allclose(moments.integral / peak, exact.integral / peak, atol=5e-3)


def test_caps_beyond_the_range(tables):
    wide = tables.lobe_cap.lookup(5.0, 0.3, np.array([1.21, np.pi / 2]))
    np.testing.assert_array_equal(
        wide.integral, lobe_cap.exact(5.0, 0.3, np.array([1.21, np.pi / 2])).integral
    )
    assert tables.cap.exponent(1.5) == tables.cap.exponent(1.0) == 0
    assert tables.cap.energy_amplitude(2.0) == 1
    none = tables.cap.exponent(np.array([0.0, -1.0]))
    assert np.all(np.isfinite(none))
    assert np.all(none == tables.cap.exponent(cap.SMALLEST_DEPTH))


def test_integral_table_follows_the_paper(tables):
    assert len(tables.integral.exponents) == 6 * 127 + 1
    np.testing.assert_allclose(tables.integral.values, lobe.integral(tables.integral.exponents), rtol=1e-10)
    assert tables.integral.lookup(2e5) == pytest.approx(2 * np.pi / (2e5 + 1))


@pytest.mark.parametrize("depth", [1e-8, 1e-3, 0.13, 0.5, 0.95])
def test_cap_exponent_minimises_the_l2_distance(tables, depth):
    best = float(tables.cap.exponent(depth))
    for factor in (0.98, 1.02):
        assert cap.l2_distance(depth, best) < cap.l2_distance(depth, best * factor)


def test_cap_energy(tables):
    """The scaled lobe has the cap's solid angle 2 pi (1 - c); small caps' own amplitude is 4 % too much."""
    depth = np.array([1e-6, 0.01, 0.3, 0.9])
    e = tables.cap.exponent(depth)
    np.testing.assert_allclose(
        tables.cap.energy_amplitude(depth) * lobe.integral(e), 2 * np.pi * depth, rtol=1e-12
    )
    assert 1 / tables.cap.energy_amplitude(1e-6) == pytest.approx(1.04, abs=0.002)


@pytest.mark.parametrize(
    ("e", "theta", "alpha"),
    [(1, 0.3, 0.2), (50, 0.2, 0.12), (50, 0.0, 0.12), (0.3, 1.9, 0.6), (5, 1.2, 1.1), (400, 0.15, 0.1)],
)
def test_lobe_over_cap_against_two_dimensional_quadrature(e, theta, alpha):
    def moment(weight):
        def integrand(phi, beta):
            along = np.cos(theta) * np.cos(beta) + np.sin(theta) * np.sin(beta) * np.cos(phi)
            return max(along, 0.0) ** e * weight(along, np.cos(beta)) * np.sin(beta) * (along > 0)

        return 2 * dblquad(integrand, 0, alpha, 0, np.pi, epsabs=1e-10, epsrel=1e-9)[0]

    found = lobe_cap.exact(e, theta, alpha)
    total = moment(lambda along, cosine: 1.0)
    assert found.integral == pytest.approx(total, rel=1e-5)  # the adaptive rule's error at the lobe's edge
    assert found.along_lobe == pytest.approx(moment(lambda along, cosine: along) / total, rel=1e-5)
    # m.a = T (X cos theta + V sin^2 theta)
    towards_axis = found.along_lobe * np.cos(theta) + found.towards_cap * np.sin(theta) ** 2
    assert towards_axis == pytest.approx(moment(lambda along, cosine: cosine) / total, rel=1e-5)


def test_lobe_over_small_cap_is_the_value_at_its_centre():
    alpha, theta, e = 1e-6, 0.3, 40.0
    found = lobe_cap.exact(e, theta, alpha)
    assert found.integral == pytest.approx(np.pi * alpha**2 * np.cos(theta) ** e, rel=1e-6)
    assert found.along_lobe == pytest.approx(np.cos(theta), rel=1e-9)
    assert found.towards_cap == pytest.approx(1, rel=1e-6)


@pytest.mark.parametrize("e", [1.5, 5.3, 51.0, 1000.0, 2e4])
def test_lobe_over_cap_table_between_nodes(tables, e):
    rng = np.random.default_rng(1)
    alpha = 10 ** rng.uniform(-4, np.log10(1.15), 2000)
    first, last = lobe_cap.angle_range(e, alpha)
    theta = first + rng.uniform(0, 1, 2000) * (last - first)
    exact, found = lobe_cap.exact(e, theta, alpha), tables.lobe_cap.lookup(e, theta, alpha)
    peak = lobe_cap.exact(e, np.zeros(2000), alpha).integral
    bound = 2e-3 if e < 2 else 1e-3  # broad lobes end with a corner at their horizon
    assert np.max(np.abs(found.integral - exact.integral) / peak) <= bound
    along, exact_along = found.integral * found.along_lobe, exact.integral * exact.along_lobe
    assert np.max(np.abs(along - exact_along) / peak) <= bound


def test_building_is_deterministic(tmp_path):
    one, two = integral.build(), integral.build()
    np.testing.assert_array_equal(one.values, two.values)
    part = lobe_cap.exact(*np.meshgrid([0.0, 3.0], [0.1, 0.5], [0.2]))
    again = lobe_cap.exact(*np.meshgrid([0.0, 3.0], [0.1, 0.5], [0.2]))
    np.testing.assert_array_equal(part.integral, again.integral)


def test_file_round_trip_and_same_bytes(tables, tmp_path):
    one, two = tmp_path / "a.npz", tmp_path / "b.npz"
    store.save(one, tables)
    store.save(two, tables)
    assert one.read_bytes() == two.read_bytes()
    assert one.stat().st_size <= 10e6
    np.testing.assert_array_equal(store.load(one).product.values, tables.product.values)


@pytest.mark.parametrize("damage", ["missing", "truncated", "flipped", "foreign"])
def test_damaged_files_are_refused(tables, tmp_path, damage):
    path = tmp_path / "tables.npz"
    store.save(path, tables)
    content = bytearray(path.read_bytes())
    if damage == "missing":
        path.unlink()
    elif damage == "truncated":
        path.write_bytes(content[: len(content) // 2])
    elif damage == "flipped":
        content[len(content) // 3] ^= 0xFF
        path.write_bytes(content)
    else:
        np.savez(path, format=np.array("something else"))
    with pytest.raises(InvalidInput, match="table file"):
        store.load(path)


def test_a_damaged_cache_is_rebuilt_with_a_line(tables, monkeypatch):
    from coslobe.core.progress import Progress

    lines = []

    class Listener(Progress):
        def say(self, text):
            lines.append(text)

    monkeypatch.setattr(store, "build", lambda progress: tables)
    store.cached_path().write_bytes(b"not a table")
    store.cached(Listener())
    assert "building new tables" in lines[0]
    assert store.load(store.cached_path()).cap.values[-1] == 0


def _scaled(array, factor, index=...):
    """A copy with one part multiplied."""
    copy = array.copy()
    copy[index] *= factor
    return copy


def _shifted(tables, channel, shift):
    values = tables.product.values.copy()
    values[..., channel] += shift
    return replace(tables, product=product.ProductTable(values))


WRONG = {
    "coaxial product integrates": lambda t: _shifted(t, 2, np.float32(0.1)),
    "coaxial lobes has exponent": lambda t: _shifted(t, 0, np.float32(0.1)),
    "at least that of either lobe": lambda t: _shifted(t, 0, np.where(np.arange(product.ANGLES) > 40, -3, 0)),
    "falls with the angle": lambda t: _shifted(t, 2, np.where(np.arange(product.ANGLES) == 3, 1, 0)),
    "product is finite": lambda t: _shifted(t, 1, np.float32(np.nan)),
    "a lobe integrates": lambda t: replace(
        t, integral=integral.IntegralTable(t.integral.exponents, _scaled(t.integral.values, 1.001))
    ),
    "small cap": lambda t: replace(t, cap=cap.CapTable(_scaled(t.cap.values, 1.01, 0))),
    "hemisphere": lambda t: replace(t, cap=cap.CapTable(t.cap.values + 1e-6 * (t.cap.values == 0))),
    "coaxial cap": lambda t: replace(t, lobe_cap=lobe_cap.LobeCapTable(t.lobe_cap.values + np.float32(0.1))),
}


@pytest.mark.parametrize("case", WRONG)
def test_tables_that_violate_an_exact_case_are_refused(tables, tmp_path, monkeypatch, case):
    """Neither built nor loaded; the message names the case."""
    spoilt = WRONG[case](tables)
    store.save(tmp_path / "spoilt.npz", spoilt)
    with pytest.raises(CoslobeError, match=case):
        store.load(tmp_path / "spoilt.npz")
    for name in ("product", "integral", "cap", "lobe_cap"):
        monkeypatch.setattr(getattr(store, name), "build", lambda name=name: getattr(spoilt, name))
    with pytest.raises(CoslobeError, match=case):
        store.build()


def test_tables_that_tell_lobes_apart_are_refused(tables, monkeypatch):
    class Lopsided(product.ProductTable):
        def lookup(self, e1, e2, alpha):
            found = super().lookup(e1, e2, alpha)
            return found._replace(scale_l2=found.scale_l2 * (1 + 0.01 * (np.asarray(e1) > e2)))

    with pytest.raises(CoslobeError, match="order of its lobes"):
        store.verify(replace(tables, product=Lopsided(tables.product.values)))


def test_check_reports_all_samplings(tables):
    document = errors.full_report(tables)
    assert set(document["samplings"]) == {"contract", "per_decade", "linear"}
    assert set(document["relative"]) == {"0-10", "0-100", "0-1000"}
    place = document["samplings"]["contract"]["l2"]["max_at"]
    found = tables.product.lookup(place["e1"], place["e2"], place["alpha"])
    error = found.scale_l2 * lobe.integral(found.exponent) - lobe.product_integral(*place.values())
    assert abs(error) == pytest.approx(document["samplings"]["contract"]["l2"]["max"], rel=1e-9)
    assert document["product_error"]["l2"]["max"] == document["samplings"]["contract"]["l2"]["max"]
    assert document["paper"]["mean"] == 7.1379e-4


def test_figures_are_written(tables, tmp_path, monkeypatch):
    monkeypatch.setattr(figures, "PRODUCTS", figures._BLOCK)
    names = [file.name for file in figures.draw(tables, tmp_path)]
    assert [name[:8] for name in names] == [f"figure{n}" for n in ("02", "03", "04", "06", "07", "12")]
    assert all((tmp_path / name).read_bytes().startswith(b"\x89PNG") for name in names)


def test_a_whole_build_repeats_to_the_bit(tables, monkeypatch):
    """A second build, on one core only, has the bits of the cached one."""
    monkeypatch.setattr("os.cpu_count", lambda: 1)
    assert product.build().values.tobytes() == tables.product.values.tobytes()
