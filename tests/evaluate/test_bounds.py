"""Culling in the reference never loses a blocker, wherever the point is."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from coslobe.evaluate.occlusion import may_block

coordinates = st.tuples(*[st.floats(-2, 2)] * 3)


@given(
    coordinates, coordinates, st.floats(0.01, 3), coordinates, st.floats(0.01, 1), st.integers(0, 2**32 - 1)
)
def test_what_a_ray_into_the_light_meets_is_never_culled(point, center, radius, light, light_radius, seed):
    """A bounding sphere may hold its contents anywhere, also beside or behind its centre."""
    rng = np.random.default_rng(seed)
    point, center, light = (np.asarray(v, np.float64) for v in (point, center, light))
    onto_light = rng.normal(size=(50, 3))
    targets = light + light_radius * onto_light / np.linalg.norm(onto_light, axis=1, keepdims=True)
    along = targets - point
    # The nearest point of each segment to the sphere's centre.
    t = np.clip(((center - point) @ along.T) / np.maximum(np.einsum("ij,ij->i", along, along), 1e-30), 0, 1)
    distance = np.linalg.norm(point + t[:, None] * along - center, axis=1)
    met = bool((distance < radius * (1 - 1e-6)).any())
    kept = may_block(point[None], center[None], np.array([radius]), light, light_radius)[0, 0]
    assert kept or not met
