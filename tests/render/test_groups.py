"""Blockers in groups of neighbours."""

import numpy as np

from coslobe.render.groups import clusters, group
from coslobe.render.layout import GROUP, emitter_owner


def test_groups_hold_every_sphere_once_and_bound_it():
    rng = np.random.default_rng(0)
    n = 100
    owner = rng.integers(0, 3, n)
    centers, radii = rng.normal(size=(n, 3)), rng.uniform(0.01, 0.3, n)
    groups = group(clusters(centers, owner), centers, radii, np.zeros(n), owner, 8)
    assert groups.n_groups % 8 == 0
    used = groups.spheres[3] > 0
    np.testing.assert_array_equal(np.sort(groups.spheres[0, used]), np.sort(centers[:, 0].astype(np.float32)))
    of_group = np.repeat(np.arange(groups.n_groups), GROUP)[used]
    distance = np.linalg.norm(groups.spheres[:3, used] - groups.bounds[:3, of_group], axis=0)
    assert np.all(distance + groups.spheres[3, used] <= groups.bounds[3, of_group] * (1 + 1e-6))


def test_emitters_share_groups():
    """Each is an owner of its own; a group for each would make culling sixteen times the work."""
    n = 1000
    owner = np.array([emitter_owner(j) for j in range(n)])
    centers = np.random.default_rng(0).normal(size=(n, 3))
    assert len(clusters(centers, owner)) == -(-n // GROUP)


def test_clusters_of_another_frame_bound_spheres_where_they_are_now():
    rng = np.random.default_rng(1)
    n = 50
    owner, centers, radii = np.zeros(n, int), rng.normal(size=(n, 3)), rng.uniform(0.01, 0.3, n)
    before = clusters(centers, owner)
    step = np.array([5.0, -3.0, 2.0])
    moved = group(before, centers + step, radii, np.zeros(n), owner, 4)
    still = group(before, centers, radii, np.zeros(n), owner, 4)
    real = still.bounds[3] > 0
    went = (moved.bounds - still.bounds)[:3, real].T
    np.testing.assert_allclose(went, np.tile(step, (real.sum(), 1)), atol=1e-5)
    np.testing.assert_allclose(moved.bounds[3], still.bounds[3], rtol=1e-5)


def test_no_sphere_no_group():
    none = np.empty(0)
    assert group(clusters(np.empty((0, 3)), none), np.empty((0, 3)), none, none, none, 8).n_groups == 0
