"""Numbers of samples chosen by a pilot: as few as do, and without bias."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coslobe.evaluate.adaptive import FEWEST, Goal, allocate, integrate_adaptively
from coslobe.evaluate.direct import direct_sources
from coslobe.evaluate.integration import integrate, uniform
from coslobe.evaluate.occlusion import Occluders
from coslobe.evaluate.sampling import strata

ONE = np.ones(1)


def of_tiles(*spreads: float) -> np.ndarray:
    """Variances of whole tiles, so that smoothing over a tile changes nothing."""
    return np.repeat(np.array(spreads), 64)[None]


def predicted(spread, samples, decays, choice) -> float:
    return float((spread * (samples / choice.samples) ** decays[:, None]).sum())


def test_sixteen_times_the_variance_gets_the_root_of_lagrange():
    """n is proportional to c^(1 / (p + 1)): with p = 1, four times as many; with p = 3, twice."""
    spread = of_tiles(1.0, 16.0)
    for p, ratio in ((1.0, 4.0), (3.0, 2.0)):
        choice = allocate(spread, np.full(spread.shape, 32.0), ONE, p * ONE, 0.5, 1 << 20)
        assert choice.samples[0, -1] / choice.samples[0, 0] == ratio


def test_dearer_sources_get_fewer_samples():
    spread = np.ones((2, 64))
    choice = allocate(spread, np.full((2, 64), 32.0), np.array([1.0, 16.0]), np.ones(2), 1.0, 1 << 20)
    assert choice.samples[0, 0] == 4 * choice.samples[1, 0]


@settings(max_examples=60, deadline=None)
@given(
    spreads=st.lists(st.floats(1e-12, 1e12), min_size=1, max_size=6),
    share=st.floats(1e-3, 0.9),
    p=st.floats(1.0, 2.0),
)
def test_the_variance_that_is_left_is_what_is_allowed(spreads, share, p):
    """No more than allowed, and, where not held at the fewest samples, about the next power of two below."""
    spread, decays = of_tiles(*spreads), p * ONE
    samples = np.full(spread.shape, 32.0)
    allowed = share * float(spread.sum())
    choice = allocate(spread, samples, ONE, decays, allowed, 1 << 20)
    left = predicted(spread, samples, decays, choice)
    assert left <= allowed * (1 + 1e-6)
    assert left >= allowed / 2 ** (p + 1) or choice.samples.min() == FEWEST


def test_the_most_is_never_exceeded_and_darkness_costs_the_least():
    spread = of_tiles(0.0, 1.0)
    choice = allocate(spread, np.full(spread.shape, 32.0), ONE, 1.5 * ONE, 1e-30, 256)
    assert choice.samples[0, 0] == FEWEST
    assert choice.samples[0, -1] == 256


def edge(bench, n=2000, covered=0.15):
    """Points under a light that a ball covers in part: every one has noise, and the answer is known.

    `covered` is the sine of the ball's half-angle, that of the light's is 0.25.
    """
    scene = SimpleNamespace(materials={"m": bench.lambert()}, lights={"l": bench.light((0, 4, 0), 1.0)})
    gbuffer = bench.points(n)
    occluders = Occluders(bench.spheres(((0, 2, 0), 2 * covered)))
    return direct_sources(scene, gbuffer, occluders), gbuffer.material, 0.25**2 - covered**2


def test_the_error_that_was_asked_for_is_met_without_bias(bench):
    sources, material, exact = edge(bench)
    for error in (0.02, 0.004):
        goal = Goal(error, 1 << 16, len(material))
        estimate, _ = integrate_adaptively(sources, material, goal, (0,), "test")
        radiance, variance = estimate.radiance[:, 0], estimate.variance[:, 0]
        assert np.sqrt(variance.mean()) / radiance.mean() <= error
        # neither do the numbers overshoot by more than the powers of two make them
        assert np.sqrt(variance.mean()) / radiance.mean() > error / 4
        assert abs(radiance.mean() - exact) < 4.5 * np.sqrt(variance.sum()) / len(variance)
        # and the variance is honest: of 2000 pixels, the ratio is known to 3 %
        assert radiance.var(ddof=1) == pytest.approx(variance.mean(), rel=0.1)


def test_what_most_pilots_miss_is_not_lost(bench):
    """Of the light 1 % is seen: of 32 samples of a pilot, mostly none. A biased stop would call it black."""
    sources, material, exact = edge(bench, 1000, covered=0.24875)
    estimate, _ = integrate_adaptively(sources, material, Goal(0.2, 1 << 16, 1000), (0,), "test")
    radiance, variance = estimate.radiance[:, 0], estimate.variance[:, 0]
    assert np.sqrt(variance.mean()) / radiance.mean() <= 0.2
    assert abs(radiance.mean() - exact) < 4.5 * np.sqrt(variance.sum()) / len(variance)


def test_samples_go_where_the_noise_is(bench):
    """Half of the points have no blocker: they get fewer, and the same error costs less than everywhere."""
    scene = SimpleNamespace(materials={"m": bench.lambert()}, lights={"l": bench.light((0, 4, 0), 1.0)})
    gbuffer = bench.points(2048)
    gbuffer.position[1024:, 0] += 3
    sources = direct_sources(scene, gbuffer, Occluders(bench.spheres(((0.1, 2, 0), 0.3))))
    goal = Goal(0.002, 1 << 16, 2048)
    estimate, choice = integrate_adaptively(sources, gbuffer.material, goal, (0,), "test")
    blocked, free = choice.samples[0, :1024], choice.samples[0, 1024:]
    assert np.median(blocked) >= 4 * np.median(free)
    mean = strata(int(choice.samples.mean()))
    same, _ = integrate(sources, gbuffer.material, uniform(mean, 1, 2048), (0,), "test")
    assert estimate.variance.sum() < 0.8 * same.variance.sum()


def test_it_ends_where_the_most_samples_do_not_suffice(bench):
    sources, material, _ = edge(bench, 300)
    estimate, choice = integrate_adaptively(sources, material, Goal(1e-6, 100, 300), (0,), "test")
    assert choice.samples.max() == 64
    assert np.all(estimate.variance > 0)


def test_points_in_darkness_and_no_points_at_all(bench):
    scene = SimpleNamespace(materials={"m": bench.lambert()}, lights={"l": bench.light((0, -4, 0), 1.0)})
    for n in (0, 10):
        gbuffer = bench.points(n)
        sources = direct_sources(scene, gbuffer, Occluders(bench.spheres()))
        estimate, _ = integrate_adaptively(sources, gbuffer.material, Goal(0.01, 256, max(n, 1)), (0,), "t")
        np.testing.assert_array_equal(estimate.radiance, np.zeros((n, 3)))
