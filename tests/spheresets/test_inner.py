"""Inner sets: nothing outside the solid, exact counts, and more filled than by cutting radii."""

import numpy as np
import pytest
import trimesh

from coslobe.spheresets.balanced import Balanced
from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.inner import inner
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid


@pytest.fixture(scope="module")
def torus(mesh_of) -> Solid:
    return Solid(mesh_of(trimesh.creation.torus(1.0, 0.3, major_sections=96, minor_sections=48)))


@pytest.fixture(scope="module")
def fits(torus, one_device) -> Balanced:
    return Balanced(torus, FitSettings(mode="inner"), one_device)


def filled(points, spheres) -> float:
    gaps = np.linalg.norm(points[:, None] - spheres[:, :3], axis=2) - spheres[:, 3]
    return float((gaps.min(1) <= 0).mean())


@pytest.mark.parametrize("count", [1, 5, 30])
def test_no_point_of_any_sphere_is_outside(torus, fits, count):
    spheres = fits.fit(count, coarse=True)
    assert spheres.shape == (count, 4)
    assert (spheres[:, 3] > 0).all()
    shell = (spheres[:, None, :3] + spheres[:, None, 3:] * fibonacci_sphere(4000)).reshape(-1, 3)
    # float32 distances in a box of diagonal 1; spheres stay 1e-6 away from the surface
    assert torus.signed_distance(shell).max() < 1e-6


def test_a_ball_gives_the_ball_back(ball, one_device):
    solid = Solid(ball)
    sphere = Balanced(solid, FitSettings(mode="inner"), one_device).fit(1, coarse=True)[0] * solid.size
    # the icosphere's faces are up to 0.4 % nearer than its corners
    np.testing.assert_allclose(sphere, [0, 0, 0, 0.997], atol=0.01)


def test_moving_fills_more_than_cutting_radii(mesh_of, one_device):
    """In a box, where balanced spheres reach through the faces."""
    solid = Solid(mesh_of(trimesh.creation.box([1, 1, 0.5])))
    start, fitted = (
        Balanced(solid, FitSettings(mode=mode), one_device).fit(12, coarse=True)
        for mode in ("balanced", "inner")
    )
    depth = np.maximum(-solid.signed_distance(start[:, :3]), 0)
    cut = np.column_stack([start[:, :3], depth])
    points = np.random.default_rng(9).uniform(solid.lower, solid.upper, (20_000, 3))
    assert filled(points, fitted) > filled(points, cut) + 0.01


def test_centers_outside_are_moved_in(torus, one_device):
    points = Balanced(torus, FitSettings(), one_device).samples(8).points
    spheres = np.column_stack([np.random.default_rng(2).uniform(-0.5, 0.5, (8, 3)), np.full(8, 0.1)])
    assert not torus.inside(spheres[:, :3]).all()
    assert torus.inside(inner(torus, points, spheres)[:, :3]).all()
