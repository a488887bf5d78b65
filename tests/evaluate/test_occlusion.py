"""Shadow tests: culling never changes them, and meshes block like the solids they are."""

import numpy as np
import pytest

from coslobe.evaluate.occlusion import NONE, Segments, Spheres, blocked_by_spheres, entry_distance, may_block
from coslobe.evaluate.sampling import light_caps, square_to_cap, strata


def blocked_by_definition(segments: Segments, spheres: Spheres) -> np.ndarray:
    """Every sphere against every direction, by the rules of docs/reference.md, one after the other."""
    l = np.stack(segments.directions, axis=-1)
    blocked = np.zeros(l.shape[:2], bool)
    for c, r, e, owner in zip(spheres.centers, spheres.radii, spheres.outside, spheres.owner, strict=True):
        o = c - segments.position
        d2, h = np.sum(o * o, axis=-1), np.sum(o * segments.normal, axis=-1)
        own = owner == segments.object
        w = e * np.clip(0.25 - h / r, 0, 1)
        shrunk = r - w * np.clip((r + 2 * e - np.sqrt(d2)) / e, 0, 1)
        skipped = own & ((h <= -r) | (np.sqrt(d2) < r + w) | (shrunk <= 0))
        radius = np.where(own, shrunk, r)
        along = np.einsum("nk,nsk->ns", o, l)
        m = np.maximum(d2 - radius**2, 0)[:, None]
        meets = (along > 0) & (along**2 >= m)
        entered = along - np.sqrt(np.maximum(along**2 - m, 0))
        blocked |= meets & (entered < segments.reach) & ~skipped[:, None]
    return blocked


def random_case(seed: int, extent: float, light_radius: float) -> tuple[Segments, Spheres]:
    """Points spread over `extent`, among 30 spheres of all sizes, many of which contain some of them."""
    rng = np.random.default_rng(seed)
    n = 12
    position = rng.uniform(-extent, extent, (n, 3))
    normal = rng.normal(size=(n, 3))
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    center = rng.uniform(-2, 2, 3)
    caps = light_caps(position, normal, center, light_radius)
    directions = square_to_cap(*strata(32).jittered(rng, n), caps)
    reach = entry_distance(position, directions, center, light_radius)
    above = sum(normal[:, k, None] * directions[k] for k in range(3)) > 0
    owners = rng.integers(0, 3, n).astype(np.int32)
    segments = Segments(position, normal, owners, 0, center, light_radius, directions, reach, above)
    m = 30
    spheres = Spheres(
        rng.uniform(-2, 2, (m, 3)),
        10 ** rng.uniform(-2, 0.3, m),
        10 ** rng.uniform(-3, -1, m),
        rng.integers(0, 3, m).astype(np.int32),
        np.full(m, NONE, np.int32),
    )
    return segments, spheres


@pytest.mark.parametrize("light_radius", [0.01, 0.3, 1.5])
@pytest.mark.parametrize("extent", [0.05, 2.0])
def test_culling_changes_nothing(extent, light_radius):
    """Only directions above the horizon count: the rest are arbitrary, as spheres below it are left out."""
    for seed in range(60):
        segments, spheres = random_case(seed, extent, light_radius)
        expected = blocked_by_definition(segments, spheres)
        found = blocked_by_spheres(segments, spheres)
        np.testing.assert_array_equal(found[segments.wanted], expected[segments.wanted], f"seed {seed}")


def test_culling_does_cull():
    position = np.zeros((1, 3))
    light = np.array([0.0, 4, 0]), 0.5
    centers = np.array([[0, 2, 0], [2, 2, 0], [0, -2, 0], [0.65, 2, 0], [0.1, 0, 0]], float)
    radii = np.array([0.2, 0.5, 0.5, 0.5, 0.3])
    np.testing.assert_array_equal(
        may_block(position, centers, radii, *light), [[True, False, False, True, True]]
    )


def test_the_entry_into_a_light():
    position = np.array([[0.0, 0, 0], [0, 3.9, 0]])
    up = tuple(np.full((2, 1), value) for value in (0.0, 1.0, 0.0))
    distance = entry_distance(position, up, np.array([0.0, 4, 0]), 0.5)
    assert distance[0, 0] == pytest.approx(3.5)
    assert distance[1, 0] == 0  # from inside
