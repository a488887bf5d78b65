"""Volumes of balls outside a solid: closed forms, sampling, derivatives, kernel against twin."""

import numpy as np
import pytest
import trimesh

from coslobe.spheresets.closed_surface import closed_surface
from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.outside_volume import OutsideVolume, outside, overlaps
from coslobe.spheresets.solid import Solid

BOX = trimesh.creation.box([1, 2, 3])


def in_box(points):
    return (np.abs(points) < [0.5, 1, 1.5]).all(1)


def shares(corners, inside, *balls):
    """Share of each ball that is outside."""
    balls = np.array(balls, float)
    volumes, _ = outside(balls, overlaps(corners, balls), inside)
    return volumes / (4 / 3 * np.pi * balls[:, 3] ** 3)


def cap(r, d):
    """Share of a ball beyond a plane at distance d from its center."""
    return (r - d) ** 2 * (2 * r + d) / (4 * r**3)


AROUND = 1 - 6 / (4 / 3 * np.pi * 1000)
IN = 1e-9  # beside faces: exactly on them, which side the center is on is rounding


@pytest.mark.parametrize(
    ("ball", "expected"),
    [
        ((0, 0, 0, 0.4), 0),  # inside
        ((2, 0, 0, 0.5), 1),  # outside
        ((0, 0, 0, 10), AROUND),  # around the box,
        ((0.1, -0.2, 0.7, 10), AROUND),
        ((5, 0, 0, 10), AROUND),  # from a center outside
        ((0.5 - IN, 0.2, 0.3, 0.4), 1 / 2),  # on a face,
        ((0.5 + IN, 0.2, 0.3, 0.4), 1 / 2),
        ((0.5 - IN, 1 - IN, 0.3, 0.4), 3 / 4),  # an edge,
        ((0.5 - IN, 1 - IN, 1.5 - IN, 0.4), 7 / 8),  # a corner
        ((0.45, 0.1, 0.2, 0.3), cap(0.3, 0.05)),  # through one face, from inside
        ((0.7, 0.1, 0.2, 0.3), 1 - cap(0.3, 0.2)),  # and from outside
        ((0, 0, 0, 0.55), 2 * cap(0.55, 0.5)),  # through two faces
    ],
)
def test_balls_and_a_box(ball, expected):
    assert shares(BOX.triangles, in_box, ball)[0] == pytest.approx(expected, abs=1e-7)


@pytest.fixture(scope="module")
def torus(mesh_of) -> Solid:
    return Solid(mesh_of(trimesh.creation.torus(1.0, 0.3, major_sections=48, minor_sections=24)))


def balls_near(solid: Solid, count: int):
    rng = np.random.default_rng(3)
    return np.column_stack([rng.uniform(solid.lower, solid.upper, (count, 3)), rng.uniform(0.02, 0.3, count)])


def test_against_sampling(torus):
    balls = balls_near(torus, 12)
    n = 40_000
    radius = (np.arange(n) + 0.5) / n
    # a lattice in a ball: directions of a spiral in another order than the radii
    grain = fibonacci_sphere(n)[np.random.default_rng(0).permutation(n)] * np.cbrt(radius)[:, None]
    sampled = [1 - torus.inside(ball[:3] + ball[3] * grain).mean() for ball in balls]
    # 4 standard deviations of independent samples
    np.testing.assert_allclose(shares(torus.triangles, torus.inside, *balls), sampled, atol=4 * 0.5 / n**0.5)


def test_the_gradient_is_that_of_the_volume(torus):
    balls = balls_near(torus, 20)
    step = 1e-6

    def volume(balls):
        return outside(balls, overlaps(torus.triangles, balls), torus.inside)[0]

    _, gradient = outside(balls, overlaps(torus.triangles, balls), torus.inside)
    for k in range(4):
        moved = step * np.eye(4)[k]
        slope = (volume(balls + moved) - volume(balls - moved)) / (2 * step)
        np.testing.assert_allclose(gradient[:, k] / balls[:, 3] ** 2, slope / balls[:, 3] ** 2, atol=2e-4)


def test_kernel(torus, device):
    balls = balls_near(torus, 50).astype(np.float32).astype(np.float64)
    volumes, gradient = OutsideVolume(device, torus.triangles, torus.inside)(balls)
    expected, slope = outside(balls, overlaps(torus.triangles, balls), torus.inside)
    # sums over 2304 triangles of float32 angles, each wrong by 1e-7 of a turn or two
    size = balls[:, 3]
    np.testing.assert_allclose(volumes / size**3, expected / size**3, atol=1e-4)
    np.testing.assert_allclose(gradient / size[:, None] ** 2, slope / size[:, None] ** 2, atol=3e-4)


def test_a_closed_mesh_stands_for_itself(torus):
    corners, exact = closed_surface(torus)
    assert exact
    np.testing.assert_array_equal(corners, torus.triangles)


def test_a_mesh_of_many_triangles_is_simplified(mesh_of):
    """Also where it is inside out."""
    ball, inverted = (trimesh.creation.icosphere(subdivisions=5) for _ in range(2))
    inverted.invert()
    for mesh in (ball, inverted):
        corners, exact = closed_surface(solid := Solid(mesh_of(mesh)))
        assert exact
        assert len(corners) <= 10_000
        assert np.linalg.det(corners).sum() / 6 * solid.size**3 == pytest.approx(4 / 3 * np.pi, rel=0.005)


@pytest.mark.parametrize("defect", ["open", "overlapping"])
def test_other_meshes_become_voxels(mesh_of, defect):
    part = trimesh.creation.icosphere(subdivisions=4)
    if defect == "open":
        part.update_faces(part.triangles_center[:, 1] > -0.95)
        parts, volume = [part], 4 / 3 * np.pi
    else:
        parts, volume = (
            [part, part.copy().apply_translation([1, 0, 0])],
            4 / 3 * np.pi * (2 - cap(1, 0.5) * 2),
        )
    corners, exact = closed_surface(solid := Solid(mesh_of(*parts)))
    assert not exact
    # voxels of 1/32 to 1/21 of the radius, counted at their centers
    assert np.linalg.det(corners).sum() / 6 * solid.size**3 == pytest.approx(volume, rel=0.01)
