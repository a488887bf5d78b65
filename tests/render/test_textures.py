"""Pictures as textures: decoding, directions, interpolation, and what is refused."""

import numpy as np
import pytest
from PIL import Image

from coslobe.core.errors import InvalidInput
from coslobe.render.images import linear, srgb, write_exr
from coslobe.render.textures import look_up, read_texels


def bilinear(texels, u, v):
    """By definition: texel (row, column) is centred at u = (column + 1/2) / w, 1 - v = (row + 1/2) / h."""
    h, w = texels.shape[:2]
    x, y = u * w - 0.5, (1 - v) * h - 0.5
    c, r = int(np.floor(x)), int(np.floor(y))
    fx, fy = x - c, y - r
    corner = [[texels[(r + i) % h, (c + j) % w].astype(float) for j in (0, 1)] for i in (0, 1)]
    upper = (1 - fx) * corner[0][0] + fx * corner[0][1]
    return (1 - fy) * upper + fy * ((1 - fx) * corner[1][0] + fx * corner[1][1])


@pytest.mark.parametrize("channels", [(), (3,)])
def test_look_up_is_bilinear_and_wraps(channels):
    rng = np.random.default_rng(0)
    texels = rng.random((3, 5, *channels)).astype(np.float32)
    uv = rng.uniform(-2, 3, (200, 2))
    expected = [bilinear(texels, u, v) for u, v in uv]
    np.testing.assert_allclose(look_up(texels, uv), expected, atol=1e-12)


def test_u_runs_right_and_v_up():
    texels = np.array([[0.1, 0.2], [0.3, 0.4]], np.float32)
    found = look_up(texels, np.array([[0.25, 0.25], [0.75, 0.25], [0.25, 0.75], [0.75, 0.75]]))
    np.testing.assert_allclose(found, [0.3, 0.4, 0.1, 0.2], atol=1e-7)


def test_colours_are_decoded_and_numbers_are_not(tmp_path):
    pixels = np.array([[[0, 128, 255], [64, 10, 11]]], np.uint8)
    Image.fromarray(pixels).save(tmp_path / "a.png")
    np.testing.assert_allclose(read_texels(tmp_path / "a.png", colour=True), linear(pixels / 255), rtol=1e-6)
    np.testing.assert_allclose(read_texels(tmp_path / "a.png", colour=False), pixels[..., 0] / 255, rtol=1e-6)
    x = np.linspace(0, 1, 50)
    np.testing.assert_allclose(srgb(linear(x)), x, atol=2e-8)  # the standard's two pieces meet to 3e-8


@pytest.mark.parametrize(
    ("mode", "value", "expected"),
    [("L", 51, 0.2), ("1", 1, 1.0), ("LA", (51, 9), 0.2), ("I;16", 13107, 0.2), ("P", 0, 0.0)],
)
def test_grey_pictures_are_numbers_and_grey_colours(tmp_path, mode, value, expected):
    Image.new(mode, (3, 2), value).save(tmp_path / "a.png")
    np.testing.assert_allclose(
        read_texels(tmp_path / "a.png", colour=False), np.full((2, 3), expected), rtol=1e-6
    )
    colour = read_texels(tmp_path / "a.png", colour=True)
    np.testing.assert_allclose(colour, np.full((2, 3, 3), linear(expected)), rtol=1e-6)


def test_exr_files_are_linear(tmp_path):
    pixels = np.array([[[0.0, 2.5, -1.0], [0.5, 100.0, 0.1]]], np.float32)
    write_exr(tmp_path / "a.exr", {"beauty": pixels}, {})
    np.testing.assert_array_equal(read_texels(tmp_path / "a.exr", colour=True), pixels)
    np.testing.assert_array_equal(read_texels(tmp_path / "a.exr", colour=False), pixels[..., 0])
    write_exr(tmp_path / "b.exr", {"products": pixels[..., 1]}, {})
    np.testing.assert_array_equal(read_texels(tmp_path / "b.exr", colour=False), pixels[..., 1])
    assert read_texels(tmp_path / "b.exr", colour=True).shape == (1, 2, 3)


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("a.png", b"no picture", "cannot be read as a texture"),
        ("a.exr", b"no picture", "cannot be read as a texture"),
        ("a.hdr", b"#?RADIANCE", "not a picture that can be read as a texture"),
    ],
)
def test_what_is_no_picture_is_refused_in_words(tmp_path, name, content, message):
    (tmp_path / name).write_bytes(content)
    with pytest.raises(InvalidInput, match=rf"{name}: {message}"):
        read_texels(tmp_path / name, colour=True)
