"""The reference against closed forms, by statistics: it is unbiased, and honest about its noise."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.occlusion import Occluders, light_spheres
from coslobe.evaluate.sampling import strata

Z_BOUND = 4.5  # two-sided p = 7e-6 for one test; seeds are fixed, so a pass stays a pass


def sphere_light_irradiance(cosine: float, q: float) -> float:
    """Irradiance of a unit-radiance sphere light, horizon included (Snyder 1996); q = (R/d)^2."""
    if cosine**2 > q:
        return np.pi * q * max(cosine, 0.0)
    sine = np.sqrt(1 - cosine**2)
    x = np.sqrt(1 / q - 1)
    y = -x * cosine / sine
    z = sine * np.sqrt(1 - y * y)
    return (cosine * np.arccos(y) - x * z) * q + np.arctan(z / x)


@pytest.mark.parametrize("radius", [0.05, 0.8, 1.95])
@pytest.mark.parametrize("elevation", [90, 40, 10, 0, -10])
def test_unoccluded_lambert_under_a_sphere_light(bench, radius, elevation):
    angle = np.radians(elevation)
    center = 2 * np.array([np.cos(angle), np.sin(angle), 0])
    exact = sphere_light_irradiance(np.sin(angle), (radius / 2) ** 2) / np.pi
    estimate = bench.estimate(bench.points(2000), bench.light(center, radius))
    if exact == 0:
        np.testing.assert_array_equal(estimate.radiance, 0)
    else:
        assert abs(bench.z_score(estimate, exact)) < Z_BOUND


@pytest.mark.parametrize("material", ["lambert", "phong"])
def test_inside_a_light_a_surface_returns_its_albedo(bench, material):
    # Uniform radiance L from everywhere: Lambert gives albedo L; Phong seen along its normal (kd + ks) L,
    # because the integral of (n + 2)/(2 pi) cos^n cos over the hemisphere is 1.
    brdf, albedo = {
        "lambert": (bench.lambert(0.7), 0.7),
        "phong": (bench.phong(0.3, 0.4, 20), 0.7),
    }[material]
    estimate = bench.estimate(bench.points(2000), bench.light((0.2, -0.3, 0.1), 1.0, 2.5), brdf, samples=256)
    assert abs(bench.z_score(estimate, 2.5 * albedo)) < Z_BOUND


def test_a_furnace_stays_uniform_whatever_the_normal_and_the_place(bench):
    for normal in [(0, 1, 0), (1, -2, 0.5), (0, 0, -1)]:
        gbuffer = bench.points(1000, position=(0.1, -0.4, 0.3), normal=normal, view=normal)
        estimate = bench.estimate(gbuffer, bench.light((0, 0, 0), 3.0), bench.lambert(1.0))
        assert abs(bench.z_score(estimate, 1.0)) < Z_BOUND


def test_light_is_cut_at_the_geometric_horizon(bench):
    """Inside a light, with the shading normal tilted by a: the wedge between the horizons is lost.

    Of the projected solid angle pi around Ns, half is on the side away from Ng, and there the wedge of the
    angle a hides (1 - cos a) / 2 of the whole: E = pi (1 + cos a) / 2.
    """
    angle = np.radians(50)
    gbuffer = bench.points(4000)
    tilted = np.tile([np.sin(angle), np.cos(angle), 0], (4000, 1))
    estimate = bench.estimate(replace(gbuffer, shading_normal=tilted), bench.light((0, 0, 0), 1.0))
    assert abs(bench.z_score(estimate, (1 + np.cos(angle)) / 2)) < Z_BOUND


def test_a_lobe_of_exponent_0_is_a_hemisphere(bench):
    """Around a mirror direction at the angle a to the normal it loses the same wedge: ks (1 + cos a) / 2.

    (n + 2) / (2 pi) is 1 / pi for n = 0.
    """
    angle = np.radians(40)
    gbuffer = bench.points(4000, view=(np.sin(angle), np.cos(angle), 0))
    estimate = bench.estimate(gbuffer, bench.light((0, 0, 0), 1.0), bench.phong(0, 0.6, 0))
    assert abs(bench.z_score(estimate, 0.6 * (1 + np.cos(angle)) / 2)) < Z_BOUND


def test_phong_under_a_light_on_its_mirror_axis(bench):
    # View and light on the normal: ks (n + 2)/(2 pi) 2 pi int_{cos a}^1 c^(n+1) dc = ks (1 - cos^(n+2) a).
    exponent, sine = 30.0, 0.2
    exact = 1 - np.sqrt(1 - sine**2) ** (exponent + 2)
    estimate = bench.estimate(
        bench.points(2000), bench.light((0, 5, 0), 5 * sine), bench.phong(0, 1, exponent)
    )
    assert abs(bench.z_score(estimate, exact)) < Z_BOUND


@pytest.mark.parametrize("exponent", [100.0, 3000.0])
def test_sharp_lobes_under_a_light_on_their_axis(bench, exponent):
    """As above, with a lobe so sharp that it has directions of its own."""
    sine = 0.6
    exact = 1 - np.sqrt(1 - sine**2) ** (exponent + 2)
    estimate = bench.estimate(
        bench.points(2000), bench.light((0, 5, 0), 5 * sine), bench.phong(0, 1, exponent), samples=16
    )
    assert abs(bench.z_score(estimate, exact)) < Z_BOUND


@pytest.mark.parametrize("case", ["inside", "rim", "outside", "blocked"])
def test_directions_of_lobes_change_the_noise_only(bench, monkeypatch, case):
    """The light alone, and the light and the lobe together: the same mean, whatever the lobe meets."""
    across = {"inside": 0.2, "rim": 0.75, "outside": 1.1, "blocked": 0.2}[case]
    gbuffer = bench.points(3000, view=(-np.sin(across), np.cos(across), 0))
    light = bench.light((0, 4, 0), 4 * np.sin(0.75))
    blocker = bench.spheres(((0.45, 2, 0.1), 0.3)) if case == "blocked" else None
    found = {}
    for sharp in (0.0, 10.0):
        monkeypatch.setattr("coslobe.evaluate.direct.SHARP", sharp)
        found[sharp] = bench.estimate(gbuffer, light, bench.phong(0.2, 0.5, 300), blocker, samples=128)
    alone, both = found[0.0], found[10.0]
    error = np.sqrt(alone.variance[:, 0].sum() + both.variance[:, 0].sum()) / 3000
    assert abs(both.radiance[:, 0].mean() - alone.radiance[:, 0].mean()) < Z_BOUND * error
    if case == "inside":
        assert both.variance[:, 0].mean() < 0.05 * alone.variance[:, 0].mean()


def test_a_point_inside_a_foreign_sphere_loses_the_half_space_towards_its_centre(bench):
    # The light stands on the normal, the sphere's centre to the side: by symmetry half of the light is lost.
    blockers = bench.spheres(((0.3, 0, 0), 0.5))
    light = bench.light((0, 4, 0), 2.0)
    estimate = bench.estimate(bench.points(4000), light, blockers=blockers)
    assert abs(bench.z_score(estimate, 0.5 * 0.25)) < Z_BOUND


def test_a_blocker_on_the_axis_leaves_a_ring(bench):
    # Projected solid angles of coaxial caps subtract: E = pi (sin^2 a - sin^2 b).
    estimate = bench.estimate(
        bench.points(4000), bench.light((0, 4, 0), 1.0), blockers=bench.spheres(((0, 2, 0), 0.3))
    )
    assert abs(bench.z_score(estimate, 0.25**2 - 0.15**2)) < Z_BOUND


def cap_overlap(a: float, b: float, theta: float) -> float:
    """Solid angle common to two caps of half-angles a, b at the angle theta, which do cross (Mazonka 2012).

    Integrated over rings around the first axis, so that the formula is an independent one.
    """
    ring = (np.arange(20000) + 0.5) / 20000 * a
    c = (np.cos(b) - np.cos(ring) * np.cos(theta)) / (np.sin(ring) * np.sin(theta))
    return float(np.sum(2 * np.arccos(np.clip(c, -1, 1)) * np.sin(ring)) * a / 20000)


@pytest.mark.parametrize("offset", [0.1, 0.25, 0.4])
def test_one_blocker_covers_the_overlap_of_two_caps(bench, offset):
    # Phong without its cosine factor is not available, so the light is tiny against the cosine's variation:
    # with a = 0.01 the cosine of a direction within the cap differs from 1 by at most 5e-5.
    a, b, theta = 0.01, 0.007, offset * 0.03
    center = 2 * np.array([np.sin(theta), np.cos(theta), 0])
    blockers = bench.spheres((center, 2 * np.sin(b)))
    light = bench.light((0, 4, 0), 4 * np.sin(a))
    estimate = bench.estimate(bench.points(4000), light, blockers=blockers, samples=256)
    visible = 1 - cap_overlap(a, b, theta) / (2 * np.pi * (1 - np.cos(a)))
    assert estimate.radiance[:, 0].mean() / np.sin(a) ** 2 == pytest.approx(visible, abs=4e-4)


def test_blockers_behind_beside_and_beyond_change_nothing(bench):
    harmless = bench.spheres(
        ((0, -1, 0), 0.9),  # below the horizon
        ((3, 2, 0), 0.5),  # beside the cone
        ((0, 6, 0), 0.9),  # behind the light
        ((0, 4.2, 0), 0.7),  # inside the light: entered after the light's surface
    )
    gbuffer, light = bench.points(200), bench.light((0, 4, 0), 1.0)
    alone = bench.estimate(gbuffer, light)
    np.testing.assert_array_equal(bench.estimate(gbuffer, light, blockers=harmless).radiance, alone.radiance)


def test_a_blocker_that_covers_the_light_makes_exact_darkness(bench):
    light = bench.light((0, 4, 0), 1.0)
    for blocker in [((0, 2, 0), 0.9), ((0.2, 4, 0), 1.5), ((0, 0.5, 0), 0.52)]:
        estimate = bench.estimate(bench.points(50), light, blockers=bench.spheres(blocker))
        np.testing.assert_array_equal(estimate.radiance, 0)
        np.testing.assert_array_equal(estimate.variance, 0)


def test_nothing_stands_between_a_point_and_the_light_around_it(bench):
    gbuffer, light = bench.points(100), bench.light((0, 0.1, 0), 1.0)
    blocked = bench.estimate(gbuffer, light, blockers=bench.spheres(((0, 0.5, 0), 0.3)))
    np.testing.assert_array_equal(blocked.radiance, bench.estimate(gbuffer, light).radiance)


def test_lights_block_one_another_but_not_themselves(bench):
    lights = {"near": bench.light((0, 2, 0), 0.5), "far": bench.light((0, 6, 0), 0.5)}
    scene = SimpleNamespace(materials={"m": bench.lambert()}, lights=lights)
    both = direct_light(scene, bench.points(100), Occluders(light_spheres(scene)), strata(64), (0,))
    # The far light hides behind the near one: only the near one's closed form is left.
    assert abs(bench.z_score(both, 0.25**2)) < Z_BOUND


@pytest.mark.parametrize("case", ["smooth", "edge", "gloss"])
def test_the_variance_is_honest(bench, case):
    """Squared errors over many pixels add up to the variances claimed, and z-scores have unit variance.

    Of 8000 pixels the ratio has a relative standard deviation of sqrt(2 / 8000) = 1.6 % for Gaussian
    errors, a little more for heavier tails: the bound is 6 %.
    """
    light = bench.light((0.5, 2, 0), 0.6)
    blockers = bench.spheres(((0.3, 1, 0.05), 0.2)) if case == "edge" else bench.spheres()
    material = bench.phong(0.3, 0.4, 200) if case == "gloss" else bench.lambert(0.8)
    # The lobe has its own directions, of which the light's rim in the mirror cuts a part off: only the strata
    # on the rim vary, and they must be many.
    n, samples = (4000, 1024) if case == "gloss" else (8000, 128)
    gbuffer = bench.points(n, view=(-1.1 if case == "gloss" else -0.5, 2, 0.2))
    estimate = bench.estimate(gbuffer, light, material, blockers, samples=samples)
    radiance = estimate.radiance[:, 0]
    squared_error = np.sum((radiance - radiance.mean()) ** 2) * len(radiance) / (len(radiance) - 1)
    assert squared_error / estimate.variance[:, 0].sum() == pytest.approx(1, abs=0.06)
    # Pixel by pixel the variance is itself an estimate, of 64 strata with unequal shares: z-scores have
    # somewhat heavier tails than a Gaussian.
    z = (radiance - radiance.mean()) / np.sqrt(estimate.variance[:, 0])
    assert 0.98 < z.var() < 1.25
    assert np.mean(np.abs(z) < 1.96) > 0.92


def test_stratification_pays(bench):
    """The variance of a smooth integrand falls with a higher power of the number of samples."""
    gbuffer, light = bench.points(2000), bench.light((1, 2, 0), 0.8)
    few, many = (bench.estimate(gbuffer, light, samples=n).variance[:, 0].mean() for n in (64, 256))
    assert few / many == pytest.approx(16, rel=0.15)  # 1/n^2 for a differentiable integrand; independent: 4


def test_the_result_does_not_depend_on_threads(bench, monkeypatch):
    gbuffer, light = bench.points(3000), bench.light((1, 2, 0), 0.8)
    first = bench.estimate(gbuffer, light)
    monkeypatch.setattr("coslobe.evaluate.integration.cpu_count", lambda: 1)
    second = bench.estimate(gbuffer, light)
    np.testing.assert_array_equal(first.radiance, second.radiance)
    np.testing.assert_array_equal(first.variance, second.variance)


def test_seeds_give_independent_noise(bench):
    gbuffer, light = bench.points(3000), bench.light((1, 2, 0), 0.8)
    a, b = (bench.estimate(gbuffer, light, seed=seed).radiance[:, 0] for seed in (0, 1))
    assert abs(np.corrcoef(a, b)[0, 1]) < 4.5 / np.sqrt(3000)


def test_own_spheres_do_not_darken_the_surface_they_stand_for(bench):
    """A point inside a sphere of its own object sees the light; the same sphere of another one blocks."""
    light = bench.light((0, 4, 0), 1.0)
    gbuffer = bench.points(50, owner=3)
    bulge = {"outside": 0.05}
    inside = ((0.2, 0, 0), 0.3)
    own = bench.estimate(gbuffer, light, blockers=bench.spheres(inside, owner=3, **bulge))
    np.testing.assert_array_equal(own.radiance, bench.estimate(gbuffer, light).radiance)
    foreign = bench.estimate(gbuffer, light, blockers=bench.spheres(inside, owner=2, **bulge))
    assert foreign.radiance.mean() == pytest.approx(own.radiance.mean() / 2, rel=0.1)
    # A sphere of its own that stands clear of the surface does cast a shadow on it.
    clear = bench.estimate(gbuffer, light, blockers=bench.spheres(((0, 2, 0), 0.9), owner=3, **bulge))
    np.testing.assert_array_equal(clear.radiance, 0)
