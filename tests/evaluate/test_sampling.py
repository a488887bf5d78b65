"""The strata and the maps from the square to the cap."""

import numpy as np
import pytest

from coslobe.evaluate.sampling import light_caps, square_to_cap, square_to_disk, strata, tangent_frame


@pytest.mark.parametrize("samples", [2, 4, 8, 16, 18, 32, 50, 64, 128, 256, 1024])
def test_powers_of_two_and_doubled_squares_are_met_exactly(samples):
    assert strata(samples).samples == samples


@pytest.mark.parametrize("samples", [1, 2, 3, 5, 7, 13, 97, 101, 997])
def test_other_counts_are_rounded_up_by_little_and_cells_stay_compact(samples):
    grid = strata(samples)
    assert samples <= grid.samples <= 1.1 * samples + 3
    assert grid.rows <= grid.columns <= 2 * grid.rows + 1


def test_every_stratum_gets_its_two_samples():
    grid = strata(64)
    u, v = grid.jittered(np.random.default_rng(0), points=10)
    cell = (u * grid.rows).astype(int) * grid.columns + (v * grid.columns).astype(int)
    first, second = cell[:, :32], cell[:, 32:]
    np.testing.assert_array_equal(first, np.tile(np.arange(32), (10, 1)))
    np.testing.assert_array_equal(second, first)
    assert not np.any(u[:, :32] == u[:, 32:])


def test_the_disk_map_preserves_area_and_its_corners_meet_the_rim():
    # Jacobian by central differences away from the diagonals, where the map has kinks.
    rng = np.random.default_rng(1)
    u, v = rng.uniform(0.02, 0.98, (2, 1000))
    keep = np.abs(np.abs(2 * u - 1) - np.abs(2 * v - 1)) > 0.01
    u, v, h = u[keep], v[keep], 1e-6
    xu, yu = (a - b for a, b in zip(square_to_disk(u + h, v), square_to_disk(u - h, v), strict=True))
    xv, yv = (a - b for a, b in zip(square_to_disk(u, v + h), square_to_disk(u, v - h), strict=True))
    jacobian = np.abs(xu * yv - xv * yu) / (2 * h) ** 2
    np.testing.assert_allclose(jacobian, np.pi, rtol=1e-6)  # area of the disk over that of the square
    x, y = square_to_disk(np.array([0.0, 0.0, 1.0, 0.5]), np.array([0.0, 1.0, 0.5, 0.5]))
    np.testing.assert_allclose(np.hypot(x, y), [1, 1, 1, 0], atol=1e-15)


@pytest.mark.parametrize("radius", [1e-4, 0.3, 1.9])
def test_directions_fill_the_cap_uniformly_in_solid_angle(radius):
    position = np.zeros((50, 3))
    caps = light_caps(position, np.tile([0.0, 1, 0], (50, 1)), np.array([0.3, 1.9, -0.5]), radius)
    u, v = strata(1024).jittered(np.random.default_rng(2), 50)
    directions = np.stack(square_to_cap(u, v, caps), axis=-1)
    np.testing.assert_allclose(np.linalg.norm(directions, axis=-1), 1, atol=1e-14)
    rise = 1 - np.einsum("nsk,nk->ns", directions, caps.axis)
    share = rise / caps.height[:, None]  # uniform in [0, 1] when the solid angle is
    # 51,200 stratified samples: moments within a thousandth; rounding of 1 - cos for the tiny cap.
    assert share.min() >= -1e-6
    assert share.max() <= 1 + 1e-6
    assert share.mean() == pytest.approx(1 / 2, abs=1e-3)
    assert (share**2).mean() == pytest.approx(1 / 3, abs=1e-3)
    sideways = directions - (1 - rise)[..., None] * caps.axis[:, None]
    np.testing.assert_allclose(sideways.mean(axis=(0, 1)), 0, atol=2e-3 * radius)


def test_the_cap_of_a_distant_light_keeps_its_digits():
    # q = 1e-16: 1 - cos(a) = q / 2 to first order, where 1 - sqrt(1 - q) would give 0.
    caps = light_caps(np.zeros((1, 3)), np.array([[0.0, 1, 0]]), np.array([0.0, 1e8, 0]), 1.0)
    assert caps.height[0] == pytest.approx(0.5e-16, rel=1e-12)


def test_inside_the_light_the_cap_is_the_hemisphere_above_the_surface():
    normal = np.array([[0.0, 0.6, 0.8]])
    caps = light_caps(np.zeros((1, 3)), normal, np.array([0.0, 0.1, 0.0]), 0.5)
    assert caps.height[0] == 1
    np.testing.assert_array_equal(caps.axis, normal)


def test_tangent_frames_are_orthonormal_and_right_handed_at_the_poles_too():
    rng = np.random.default_rng(3)
    normals = rng.normal(size=(1000, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    normals = np.concatenate([normals, [[0, 0, 1], [0, 0, -1], [0, 1, 0], [1e-9, 0, -1]]])
    tangent, bitangent = tangent_frame(normals)
    np.testing.assert_allclose(np.cross(tangent, bitangent), normals, atol=1e-8)
    np.testing.assert_allclose(np.einsum("ij,ij->i", tangent, bitangent), 0, atol=1e-14)
