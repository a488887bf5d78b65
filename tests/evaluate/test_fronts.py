"""Interpolation on error-against-time fronts, against fronts in closed form."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coslobe.evaluate.fronts import best_speedups, front, time_at, with_speedups


def row(renderer, error, seconds, points=100, material="matt", device="cpu", **setting):
    return {
        "renderer": renderer,
        "material": material,
        "setting": setting,
        "device": device,
        "seconds": seconds,
        "cpu_seconds": 2 * seconds if renderer == "coslobe" else seconds,
        "points": points,
        "relative_rmse_mesh": error,
    }


def test_a_front_holds_what_nothing_beats():
    points = [(0.1, 4.0), (0.2, 1.0), (0.3, 2.0), (0.1, 5.0), (0.05, 5.0), (0.0, 6.0), (0.01, -1.0)]
    assert front(points) == [(0.2, 1.0), (0.1, 4.0), (0.05, 5.0)]


@given(slope=st.floats(0.2, 3.0), error=st.floats(0.011, 0.99))
def test_power_laws_are_met_between_their_points(slope, error):
    """t = error^-slope is straight in logarithms: what lies between two points is exact."""
    curve = front((e, e**-slope) for e in (1.0, 0.3, 0.1, 0.01))
    seconds, extrapolated = time_at(curve, error)
    assert not extrapolated
    assert seconds == pytest.approx(error**-slope, rel=1e-9)


@given(error=st.one_of(st.floats(1e-4, 0.0099), st.floats(1.01, 100.0)))
def test_independent_samples_continue_a_front(error):
    """With t = error^-2, as for independent samples, what lies beyond the ends is exact, and said to."""
    curve = front((e, e**-2) for e in (1.0, 0.1, 0.01))
    seconds, extrapolated = time_at(curve, error)
    assert extrapolated
    assert seconds == pytest.approx(error**-2, rel=1e-9)


def test_the_ends_belong_to_the_front():
    curve = [(0.4, 1.0), (0.1, 3.0)]
    assert time_at(curve, 0.4) == (1.0, False)
    assert time_at(curve, 0.1) == (3.0, False)
    assert time_at([(0.4, 1.0)], 0.4) == (1.0, False)


def test_speedups_are_per_point_and_per_material():
    rows = [
        row("embree", 0.4, 1.0, rays=1),
        row("embree", 0.1, 8.0, points=50, rays=16),  # 16 s for 100 points
        row("embree", 0.1, 1.0, material="shiny", rays=1),
        row("coslobe", 0.2, 0.5, spheres=8),
    ]
    (found,) = (r for r in with_speedups(rows) if r["renderer"] == "coslobe")
    # Halfway in log(error) is halfway in log(time): 4 s against 0.5 s.
    assert found["speedup"]["embree"]["speedup"] == pytest.approx(8.0)
    assert found["speedup"]["embree"]["cpu_speedup"] == pytest.approx(4.0)
    assert not found["speedup"]["embree"]["extrapolated"]
    assert "mitsuba" not in found["speedup"]


def test_the_best_setting_of_each_number_of_spheres_counts():
    rows = [row("embree", 0.4, 16.0, rays=1), row("embree", 0.1, 256.0, rays=16)]
    rows += [row("coslobe", 0.25, 4.0, spheres=8, depth=5), row("coslobe", 0.2, 4.0, spheres=8, depth=4)]
    rows += [row("coslobe", 0.31, 0.1, spheres=8, depth=2)]  # far from what eight spheres can do
    rows += [row("coslobe", 0.05, 4.0, spheres=64, depth=5)]
    eight, many = best_speedups(with_speedups(rows))
    assert eight["speedup"] == pytest.approx(16.0)
    assert eight["setting"]["depth"] == 4
    assert eight["at_error"] == 0.2
    assert many["spheres"] == 64
    assert many["extrapolated"]
    assert many["speedup"] == pytest.approx(256.0)  # error halved: four times 256 s, over 4 s
