"""Lines and bundles against a ball, of which everything is known."""

import numpy as np
import pytest

from coslobe.spheresets.line_samples import BATCH, BLUR, SPREAD, UNIFORM, draw_bundles, draw_lines
from coslobe.spheresets.soft_lines import BUNDLE
from coslobe.spheresets.solid import Solid


@pytest.fixture(scope="module")
def solid(ball) -> Solid:
    return Solid(ball)


@pytest.fixture(scope="module")
def bundles(solid):
    """Origins, directions [n, BUNDLE, 3] and hits [n, BUNDLE] of four batches."""
    rows = draw_bundles(solid, 4, 1.0, np.random.default_rng(0))
    assert rows.shape == (4, 7, BATCH * BUNDLE)
    assert rows.dtype == np.float32
    lines = rows.transpose(0, 2, 1).reshape(-1, BUNDLE, 7).astype(np.float64)
    return lines[:, :, :3], lines[:, :, 3:6], lines[:, :, 6]


def test_lines_hit_a_ball_where_they_pass_within_its_radius(solid, bundles):
    origins, directions, hit = bundles
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1, atol=1e-6)
    distance = np.linalg.norm(np.cross(origins, directions), axis=2)
    np.testing.assert_allclose(distance, np.linalg.norm(origins, axis=2), atol=1e-6)  # the nearest points
    radius = 1 / solid.size
    clear = np.abs(distance - radius) > 0.005 * radius  # the icosphere lies up to 0.4 % below the ball
    np.testing.assert_array_equal(hit[clear], distance[clear] < radius)


def test_most_bundles_go_past_the_outline(solid, bundles):
    origins, _, hit = bundles
    away = np.linalg.norm(origins.mean(1), axis=1) - 1 / solid.size
    anywhere = np.arange(len(away)) % UNIFORM == 0
    assert np.abs(away[~anywhere]).max() < 5 * SPREAD[1] + BLUR[1]
    assert np.median(np.abs(away[~anywhere])) < SPREAD[1]
    # Uniform in the disk of the circumsphere, of radius 1/2: a share of hits that is known.
    assert hit[anywhere].mean() == pytest.approx((2 / solid.size) ** 2, abs=0.06)  # 512 bundles, 3 deviations
    assert 0.4 < hit[~anywhere].mean() < 0.6


def test_bundles_are_as_wide_as_the_blur(bundles):
    _, directions, _ = bundles
    spread = np.linalg.norm(directions - directions.mean(1, keepdims=True), axis=2).max(1)
    assert spread.min() > 0.5 * BLUR[0]
    assert spread.max() < 1.2 * BLUR[1]


def test_finer_bundles_are_narrower(solid):
    widths = []
    for fineness in (1.0, 0.25):
        rows = draw_bundles(solid, 1, fineness, np.random.default_rng(1))
        directions = rows[0, 3:6].T.reshape(-1, BUNDLE, 3)
        widths.append(np.linalg.norm(np.ptp(directions, axis=1), axis=1))
    np.testing.assert_allclose(widths[1] / widths[0], 0.25, rtol=0.05)


def test_the_share_of_hits_is_the_projected_area(solid):
    """Of the area of the circumsphere's disk; 3 deviations of 100,000 lines."""
    lines = draw_lines(solid, np.random.default_rng(2))
    assert lines.hit.mean() == pytest.approx((2 / solid.size) ** 2, abs=0.005)
