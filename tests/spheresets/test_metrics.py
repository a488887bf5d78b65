"""Metrics against closed forms for balls, whose every figure is known."""

import numpy as np
import pytest
import trimesh

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.ground_shadow import cap_directions, in_reach
from coslobe.spheresets.metrics import disc_mask, measure
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.outside import TOLERANCE, outside_distances
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.union import Union
from coslobe.spheresets.volumes import ball_points, solid_points, volumes

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
    # at most TOLERANCE too small, and the mesh is a little smaller than the ball
    np.testing.assert_allclose(outside, [0, 0.2, 0.2, 2.1], atol=TOLERANCE * solid.size + 0.003)


def test_what_is_outside_counts_however_far_it_reaches(mesh_of, one_device):
    """A plate in a ball that holds it: nearly all of the ball is outside, and outside the plate's box."""
    thickness = 0.002
    plate = Solid(mesh_of(trimesh.creation.box([1, 1, thickness])))
    unit = np.array([[0.0, 0, 0, 0.5]])
    found = volumes(plate, Union(one_device, unit), unit, np.random.default_rng(0))
    ratio = np.pi / 6 * plate.size**3 / thickness
    assert found["sum_outside_volume"] == pytest.approx(ratio - 1, rel=0.03)
    assert found["outside_volume"] == found["sum_outside_volume"]
    assert found["uncovered_volume"] < 1e-3  # the plate's corners touch the ball
    assert found["volume_iou"] == pytest.approx(1 / ratio, rel=0.03)


@pytest.mark.parametrize("thickness", [0.1, 0.01, 0.001])
def test_samples_of_the_solid_add_up_to_its_volume(thickness, mesh_of):
    turn = trimesh.transformations.rotation_matrix(0.7, [1, 2, 3])
    plate = Solid(mesh_of(trimesh.creation.box([1, 0.7, thickness]).apply_transform(turn)))
    points, weights = solid_points(plate, np.random.default_rng(0))
    # about 400,000 x thickness points in cells that it fills by half or less
    tolerance = 4 / np.sqrt(4e5 * thickness)
    assert weights.sum() * plate.size**3 == pytest.approx(0.7 * thickness, rel=tolerance)
    moments = (weights[:, None] * (points * plate.size + plate.center)).sum(0) / weights.sum()
    np.testing.assert_allclose(moments, 0, atol=0.3 * tolerance)


def test_points_in_balls_are_uniform_and_shared_by_volume():
    spheres = np.array([[0.0, 0, 0, 1.0], [5.0, 0, 0, 0.5], [0.0, 5, 0, 0.01]])
    points, weights = ball_points(spheres, np.random.default_rng(0))
    for x, y, z, r in spheres:
        distance = np.linalg.norm(points - [x, y, z], axis=1)
        own = distance <= r * (1 + 1e-12)
        assert weights[own].sum() == pytest.approx(4 / 3 * np.pi * r**3)
        if own.sum() > 1000:
            # the cube of the distance is uniform; strata leave far less than 1 / sqrt(n)
            assert (distance[own] ** 3).mean() == pytest.approx(r**3 / 2, rel=1e-3)
            np.testing.assert_allclose((points[own] - [x, y, z]).mean(0), 0, atol=4 * r / np.sqrt(own.sum()))


def test_metrics_need_a_volume(mesh_of, one_device):
    sheet = trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0.2]], [[0, 1, 2]])
    with pytest.raises(InvalidInput, match="encloses no volume"):
        measure(Solid(mesh_of(sheet)), spheres([0, 0, 0, 1]), one_device)


def test_figures_are_finite_for_a_mesh_with_holes(mesh_of, one_device):
    """A ball without its lowest tenth, against the ball."""
    part = trimesh.creation.icosphere(subdivisions=4)
    part.update_faces(part.triangles_center[:, 1] > -0.8)
    m = measure(Solid(mesh_of(part)), spheres([0, 0, 0, 1]), one_device)
    assert all(np.isfinite(value).all() for value in m.values())
    assert m["volume_iou"] > 0.95  # the winding number closes the hole with a surface of its own
    assert m["hausdorff_mesh_to_union"] < 0.005


def test_surface_within_the_solid_is_no_surface(mesh_of, one_device):
    """Two overlapping balls with a sphere each: what lies inside is far from the union's surface."""
    parts = (trimesh.creation.icosphere(subdivisions=4).apply_translation([x, 0, 0]) for x in (-0.1, 0.1))
    m = measure(Solid(mesh_of(*parts)), spheres([-0.1, 0, 0, 1], [0.1, 0, 0, 1]), one_device)
    assert m["hausdorff_mesh_to_union"] < 0.005
    assert m["hausdorff_union_to_mesh"] < 0.005


def test_only_receivers_in_reach_are_traced():
    """Caps that just meet and just miss a ball of radius 0.5."""
    receivers = np.array([[0.0, -2, 0]] * 3 + [[0.0, -0.4, 0]])
    beta, sigma = np.arcsin(0.5 / 2), 0.1
    angle = np.array([beta + sigma - 1e-6, beta + sigma + 1e-6, 0.0, np.pi])
    caps = np.stack([np.sin(angle), np.cos(angle), np.zeros(4), np.full(4, np.cos(sigma))], axis=1)
    np.testing.assert_array_equal(in_reach(receivers, caps, 0.5), [True, False, True, True])
