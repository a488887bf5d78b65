"""Where the rays of a pixel go, and in which order."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coslobe.render.camera import BLOCK, TILE, Part, bands, camera_rays, sample_pattern, tile_order
from coslobe.render.scene import Image, load_scene


@pytest.mark.parametrize("n", [1, 2, 3, 4, 5, 8, 12, 16, 33])
def test_samples_are_centred_in_the_pixel_and_spread(n):
    """A pattern off the centre would shift the whole picture by as much."""
    pattern = sample_pattern(n)
    assert pattern.shape == (n, 2)
    assert pattern.min() > 0
    assert pattern.max() < 1
    np.testing.assert_allclose(pattern.mean(axis=0), 0.5, atol=1e-12)
    assert len(np.unique(pattern, axis=0)) == n


@given(st.integers(1, 70), st.integers(1, 70))
def test_pixels_are_ordered_by_tiles(width, height):
    order = tile_order(width, height)
    row, column = np.divmod(np.arange(width * height), width)
    expected = np.lexsort((column % TILE, row % TILE, column // TILE, row // TILE))
    np.testing.assert_array_equal(order, expected)


@given(st.integers(1, 300), st.integers(1, 300), st.integers(1, 16), st.integers(1, 20000))
def test_bands_cover_the_picture_once_in_bounded_parts(width, height, samples, rays):
    parts = bands(Image(width=width, height=height, samples=samples), rays)
    assert [part.first for part in parts] == [0, *(part.last for part in parts[:-1])]
    assert parts[-1].last == width * height
    most = max(rays, BLOCK * samples)
    assert all((part.last - part.first) * samples <= most for part in parts)


def test_parts_have_the_rays_of_the_whole(tiny_scene):
    scene = load_scene(tiny_scene, ["image.samples=3"]).at(0)
    whole = camera_rays(scene)
    pieces = [camera_rays(scene, part) for part in bands(scene.image, 400)]
    assert len(pieces) > 2
    np.testing.assert_array_equal(np.concatenate([piece.pixel for piece in pieces]), whole.pixel)
    np.testing.assert_array_equal(np.concatenate([piece.local for piece in pieces], axis=1), whole.local)
    third = camera_rays(scene, Part(0, 21 * 16, 3))
    blocks = np.arange(len(whole.pixel)) // (BLOCK * 3)
    np.testing.assert_array_equal(third.pixel, whole.pixel[blocks % 3 == 0])


def test_rays_go_where_mitsuba_sends_them(tiny_scene):
    """The centre of the picture looks at the target; its right edge is half the angle of view away."""
    scene = load_scene(tiny_scene, ["image.width=41", "image.height=31"]).at(0)
    rays = camera_rays(scene)
    direction = rays.direction
    np.testing.assert_allclose(np.linalg.norm(direction, axis=1), 1, rtol=1e-14)
    middle = direction[rays.pixel == 15 * 41 + 20][0]
    towards = np.array([0, 0.2, 0]) - [-1, 1.2, 1.5]
    np.testing.assert_allclose(middle, towards / np.linalg.norm(towards), atol=1e-14)
    right = direction[rays.pixel == 15 * 41 + 40][0]
    tangent = np.tan(np.radians(20)) * 40 / 41  # at the pixel's centre
    assert middle @ right == pytest.approx(1 / np.hypot(1, tangent), rel=1e-13)
    above = direction[rays.pixel == 20][0]
    assert above[1] > middle[1]
