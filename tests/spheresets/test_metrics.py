"""Metrics against closed forms for balls, whose every figure is known."""

import numpy as np
import pytest
import trimesh

from coslobe.spheresets.ground_shadow import cap_directions
from coslobe.spheresets.metrics import disc_mask, measure
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.outside import outside_distances
from coslobe.spheresets.solid import Solid

DIAGONAL = 2 * np.sqrt(3)  # of the unit ball's box


@pytest.fixture(autouse=True)
def coarser_ground(monkeypatch):
    """A quarter of the receivers: what is tested here shows on fewer."""
    monkeypatch.setattr("coslobe.spheresets.ground_shadow.GROUND_CELLS", 48)


@pytest.fixture(scope="module")
def solid(ball) -> Solid:
    return Solid(ball)


def spheres(*rows) -> SphereSet:
    array = np.array(rows, np.float64)
    return SphereSet(array[:, :3], array[:, 3], np.zeros(len(array)))


def test_a_ball_measured_against_itself(solid, one_device):
    m = measure(solid, spheres([0, 0, 0, 1]), one_device)
    # 256 pixels over 1.1 diagonals are 134 across the ball; the icosphere lacks 0.3 % of it
    assert m["silhouette_iou_min"] > 0.99
    assert m["volume_iou"] > 0.99
    assert m["max_gap"] == 0
    assert m["hausdorff_mesh_to_union"] < 0.004  # spacing of the points on the sphere
    assert m["hausdorff_union_to_mesh"] < 0.003 / DIAGONAL
    assert max(m["shadow_rmse_no_contact"]) < 0.02
    assert max(map(abs, m["shadow_bias"])) < 2e-3


def test_a_smaller_ball(solid, one_device):
    r = 0.8
    m = measure(solid, spheres([0, 0, 0, r]), one_device)
    assert m["silhouette_iou_mean"] == pytest.approx(r**2, abs=0.01)
    assert m["volume_iou"] == pytest.approx(r**3, abs=0.01)
    assert m["uncovered_volume"] == pytest.approx(1 - r**3, abs=0.01)
    assert m["outside_volume"] == m["sum_outside_volume"] == 0
    assert m["max_gap"] == pytest.approx((1 - r) / DIAGONAL, rel=0.02)
    assert m["hausdorff_union_to_mesh"] == pytest.approx((1 - r) / DIAGONAL, rel=0.02)
    assert min(m["shadow_bias"]) > 0.005  # too light


def test_larger_balls_count_once_in_the_union_and_twice_in_the_sum(solid, one_device):
    r = 1.1
    m = measure(solid, spheres([0, 0, 0, r], [0, 0, 0, r]), one_device)
    assert m["outside_volume"] == pytest.approx(r**3 - 1, abs=0.02)
    assert m["sum_outside_volume"] == pytest.approx(2 * (r**3 - 1), abs=0.04)
    assert m["uncovered_volume"] == 0
    assert m["max_gap"] == 0
    assert m["hausdorff_mesh_to_union"] == pytest.approx(0.1 / DIAGONAL, rel=0.1)
    assert max(m["shadow_bias"]) < -0.005  # too dark


def test_a_gap_is_the_farthest_uncovered_place(mesh_of, one_device):
    pair = Solid(mesh_of(*(trimesh.creation.icosphere().apply_translation([x, 0, 0]) for x in (0, 4))))
    m = measure(pair, spheres([0, 0, 0, 1]), one_device)
    assert m["max_gap"] == pytest.approx(4 / np.sqrt(6**2 + 2 * 2**2), rel=0.01)


def test_shadow_errors_do_not_depend_on_size_or_place(mesh_of, one_device):
    part = trimesh.creation.icosphere(subdivisions=3)
    here = measure(Solid(mesh_of(part)), spheres([0, 0, 0, 0.9]), one_device)
    part = part.copy().apply_scale(8).apply_translation([100, -50, 20])
    there = measure(Solid(mesh_of(part)), spheres([100, -50, 20, 7.2]), one_device)
    for name, value in here.items():
        # float32 coordinates move grazing rays and pixels on the edge
        np.testing.assert_allclose(there[name], value, atol=2e-4, err_msg=name)


def test_cap_directions_fill_the_lights_solid_angle():
    receivers = np.array([[0.0, 0, 0], [1.0, 0, 2.0]])
    light = np.array([0.5, 2.0, -0.3, 0.4])
    axes, directions, solid_angles = cap_directions(receivers, light)
    offset = light[:3] - receivers
    distance = np.linalg.norm(offset, axis=1)
    closed_form = (
        np.pi * (light[3] / distance) ** 2 * offset[:, 1] / distance
    )  # of the irradiance, no horizon
    irradiance = directions[:, :, 1].mean(1) * solid_angles
    np.testing.assert_allclose(irradiance, closed_form, rtol=1e-3)  # midpoints of 16 x 16 strata
    assert ((directions * axes[:, None, :3]).sum(-1) > axes[:, 3:]).all()
    np.testing.assert_allclose(np.linalg.norm(directions, axis=2), 1, atol=1e-12)


def test_discs_are_drawn_where_they_are():
    steps = np.linspace(-1, 1, 41)
    mask = disc_mask(np.array([[0.5, -0.25], [-3.0, 0.0]]), np.array([0.3, 0.5]), steps)
    x, y = np.meshgrid(steps, steps)
    np.testing.assert_array_equal(mask, (x - 0.5) ** 2 + (y + 0.25) ** 2 < 0.3**2)


def test_outside_distances(solid):
    unit = np.array([[0.0, 0, 0, 0.9], [0.0, 0, 0, 1.2], [0.5, 0, 0, 0.7], [3.0, 0, 0, 0.1]]) / solid.size
    outside = outside_distances(solid, unit) * solid.size
    # 256 points leave gaps of about 0.1 radii
    np.testing.assert_allclose(outside, [0, 0.2, 0.2, 2.1], atol=0.01)
