"""Blockers in groups of neighbours."""

import numpy as np

from coslobe.render.groups import group
from coslobe.render.layout import GROUP, emitter_owner


def test_groups_hold_every_sphere_once_and_bound_it():
    rng = np.random.default_rng(0)
    n = 100
    owner = rng.integers(0, 3, n)
    centers, radii = rng.normal(size=(n, 3)), rng.uniform(0.01, 0.3, n)
    groups = group(centers, radii, np.zeros(n), owner, 8)
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
    assert group(centers, np.full(n, 0.1), np.zeros(n), owner, 1).n_groups == -(-n // GROUP)
