"""The preview picture: what is grey, vermilion and blue, and how large the panels are."""

import numpy as np
import pytest
import trimesh
from PIL import Image

from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.preview import HEADER, LINE, MARGIN, PIXELS, WINDOW, write_preview


def areas(path):
    """Shares of vermilion and blue in a panel's square, all views of the last column together."""
    picture = np.asarray(Image.open(path).convert("RGB")).astype(int)
    r, _, b = np.moveaxis(picture[HEADER:, MARGIN + 2 * (PIXELS + MARGIN) :], -1, 0)
    return np.array([(r > b + 60).sum(), (b > r + 60).sum()]) / PIXELS**2


@pytest.mark.parametrize(("radius", "more"), [(0.7, "missing"), (1.3, "extra")])
def test_missing_is_vermilion_and_extra_is_blue(ball, tmp_path, radius, more):
    path = tmp_path / "ball.spheres.png"
    write_preview(path, ball, SphereSet(np.zeros((1, 3)), np.array([radius]), np.zeros(1)))
    missing, extra = areas(path)
    disc = np.pi / 4 / (WINDOW * max(radius, 1)) ** 2  # of a panel, for the unit ball
    rings = 3 * abs(radius**2 - 1) * disc
    np.testing.assert_allclose(missing, rings if more == "missing" else 0, atol=0.03)
    np.testing.assert_allclose(extra, rings if more == "extra" else 0, atol=0.03)


def test_a_good_fit_is_grey(ball, tmp_path):
    path = tmp_path / "ball.spheres.png"
    write_preview(path, ball, SphereSet(np.zeros((1, 3)), np.ones(1), np.zeros(1)))
    assert areas(path).max() < 0.015
    assert not list(tmp_path.glob(".coslobe-tmp-*"))


def test_panels_are_as_high_as_what_they_show(mesh_of, tmp_path):
    slab = mesh_of(trimesh.creation.box((4, 1, 2)))
    write_preview(tmp_path / "slab.png", slab, SphereSet(np.zeros((1, 3)), np.full(1, 0.5), np.zeros(1)))
    _, height = Image.open(tmp_path / "slab.png").size
    expected = np.ceil(PIXELS * np.array([1, 1, 2]) / 4).sum()  # from the front, the side and above
    assert abs(height - HEADER - 3 * (LINE + MARGIN) - expected) <= 3
