"""Where the rays of a pixel go."""

import numpy as np
import pytest

from coslobe.render.camera import sample_pattern


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 12, 16, 33])
def test_samples_are_centred_in_the_pixel_and_spread(n):
    """A pattern off the centre would shift the whole picture by as much."""
    pattern = sample_pattern(n)
    assert pattern.shape == (n, 2)
    assert pattern.min() > 0
    assert pattern.max() < 1
    np.testing.assert_allclose(pattern.mean(axis=0), 0.5, atol=1e-12)
    assert len(np.unique(pattern, axis=0)) == n
