"""Hits of camera rays."""

import numpy as np
import pytest

from coslobe.render.raycaster import RayCaster


@pytest.mark.parametrize("distance", [3.0, 1e3, 1e6])
def test_hits_lie_on_their_rays_however_far_the_camera_is(distance):
    """A telephoto lens: Embree's float32 has digits for the mesh, but not for the way to it."""
    rng = np.random.default_rng(0)
    corners = np.array([[-1.0, -1.0, 0.0], [1.0, -1.0, 0.2], [0.0, 1.0, -0.1]])
    origin = distance * np.array([0.1, -0.2, 1.0])
    weights = rng.dirichlet([2.0, 2.0, 2.0], 200)
    targets = weights @ corners
    length = np.linalg.norm(targets - origin, axis=1)
    t, triangle, uv = RayCaster(corners, np.array([[0, 1, 2]])).nearest(
        origin, ((targets - origin) / length[:, None]).T
    )
    assert np.all(triangle == 0)
    np.testing.assert_allclose(t, length, atol=1e-5)
    np.testing.assert_allclose(uv, weights[:, 1:], atol=1e-5)
