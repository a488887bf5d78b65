"""The preview picture: what is grey, red and blue."""

import numpy as np
import pytest
from PIL import Image

from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.preview import HEADER, LINE, MARGIN, PIXELS, write_preview


def areas(path):
    """Shares of red and blue pixels in the three panels of the last column."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    left = MARGIN + 2 * (PIXELS + MARGIN)
    shares = []
    for row in range(3):
        top = HEADER + row * (PIXELS + MARGIN + LINE)
        r, _, b = np.moveaxis(picture[top : top + PIXELS, left : left + PIXELS], -1, 0)
        shares.append(((r > b + 60).mean(), (b > r + 60).mean()))
    return np.array(shares).T


@pytest.mark.parametrize(("radius", "red", "blue"), [(0.7, True, False), (1.3, False, True)])
def test_missing_is_red_and_extra_is_blue(ball, tmp_path, radius, red, blue):
    path = tmp_path / "ball.spheres.png"
    write_preview(path, ball, SphereSet(np.zeros((1, 3)), np.array([radius]), np.zeros(1)))
    missing, extra = areas(path)
    disc = np.pi / 4 / (1.06 * max(radius, 1)) ** 2  # of a panel, for the unit ball
    ring = abs(radius**2 - 1) * disc
    np.testing.assert_allclose(missing, ring if red else 0, atol=0.01)
    np.testing.assert_allclose(extra, ring if blue else 0, atol=0.01)


def test_a_good_fit_is_grey(ball, tmp_path):
    path = tmp_path / "ball.spheres.png"
    write_preview(path, ball, SphereSet(np.zeros((1, 3)), np.ones(1), np.zeros(1)))
    assert areas(path).max() < 0.005
    assert not list(tmp_path.glob(".coslobe-tmp-*"))
