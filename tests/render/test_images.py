"""EXR and PNG files: what is written is what is read, byte for byte the same, and never half or NaN."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.render.images import _encode, linear, read_attributes, read_exr, srgb, write_exr, write_png

RNG = np.random.default_rng(0)
LAYERS = {
    "beauty": RNG.random((5, 7, 3)),
    "normal": RNG.normal(size=(5, 7, 3)),
    "irradiance": RNG.random((5, 7, 3)),
    "object": np.arange(35.0).reshape(5, 7) - 1,
    "depth": RNG.random((5, 7)),
}


def test_layers_come_back_in_single_precision(tmp_path):
    path = tmp_path / "a.exr"
    write_exr(path, LAYERS, {"frame": 3, "version": "1"})
    layers, attributes = read_exr(path)
    assert set(layers) == set(LAYERS)
    for name, values in LAYERS.items():
        np.testing.assert_array_equal(layers[name], values.astype(np.float32))
    assert attributes == read_attributes(path) == {"frame": 3, "version": "1"}


def test_channels_have_the_contracts_names(tmp_path):
    import OpenEXR

    path = tmp_path / "a.exr"
    write_exr(path, LAYERS, {})
    with OpenEXR.File(str(path), separate_channels=True) as file:
        names = set(file.channels())
        header = dict(file.header())
    beauty = {"R", "G", "B", "irradiance.R", "irradiance.G", "irradiance.B"}
    assert names == beauty | {"normal.X", "normal.Y", "normal.Z", "object.V", "depth.Z"}
    assert header["compression"] == OpenEXR.ZIP_COMPRESSION
    assert header["colorInteropID"] == "lin_rec709_scene"


@pytest.mark.parametrize(
    "view",
    [
        lambda a: a[::-1],
        lambda a: a[:, ::-1],
        lambda a: a[..., ::-1],
        lambda a: a[1:4, 2:6],
        np.asfortranarray,
        lambda a: a.transpose(1, 0, 2),
        lambda a: a.repeat(2, axis=1)[:, ::2],
        lambda a: np.broadcast_to(a[:1], a.shape),
    ],
    ids=["up", "left", "bgr", "crop", "fortran", "transposed", "strided", "broadcast"],
)
def test_views_of_any_layout_keep_their_pixels(tmp_path, view):
    pixels = view(LAYERS["beauty"].astype(np.float32))
    write_exr(tmp_path / "a.exr", {"beauty": pixels, "depth": pixels[..., 1]}, {})
    layers, _ = read_exr(tmp_path / "a.exr")
    np.testing.assert_array_equal(layers["beauty"], pixels)
    np.testing.assert_array_equal(layers["depth"], pixels[..., 1])


@pytest.mark.parametrize("shape", [(5, 7), (1, 1), (64, 3), (131, 2)])  # more rows than are written at once
def test_plain_files_hold_the_same_as_compressed_ones(tmp_path, shape):
    import OpenEXR

    values = RNG.normal(size=(*shape, 3))
    headers = []
    for compressed in (True, False):
        path = tmp_path / f"{compressed}.exr"
        layers = {"beauty": values, "normal": values, "depth": values[..., 0]}
        write_exr(path, layers, {"frame": 3, "version": "1"}, compressed=compressed)
        found, attributes = read_exr(path)
        assert set(found) == set(layers)
        for name in layers:
            np.testing.assert_array_equal(found[name], layers[name].astype(np.float32))
        assert attributes == {"frame": 3, "version": "1"}
        with OpenEXR.File(str(path), separate_channels=True, header_only=True) as file:
            headers.append(dict(file.header()))
    assert headers[1].pop("compression") == OpenEXR.NO_COMPRESSION
    assert headers[0].pop("compression") == OpenEXR.ZIP_COMPRESSION
    assert str(headers[1]) == str({name: headers[0][name] for name in headers[1]})
    assert set(headers[0]) - set(headers[1]) <= {"type"}  # which only files of several parts need


@given(st.lists(st.floats(width=32), min_size=3, max_size=3))
def test_previews_are_rounded_as_the_curve_says(values):
    pixel = np.array(values, np.float32)
    finite = np.nan_to_num(pixel, nan=0.0)
    np.testing.assert_array_equal(_encode(finite), np.rint(srgb(finite) * 255))


def test_previews_step_where_the_curve_does():
    """At the 255 places between two levels, and at their neighbours among float32 numbers."""
    steps = linear((np.arange(1, 256) - 0.5) / 255).astype(np.float32)
    for values in (steps, np.nextafter(steps, np.float32(0)), np.nextafter(steps, np.float32(9))):
        np.testing.assert_array_equal(_encode(values), np.rint(srgb(values) * 255))


@pytest.mark.parametrize("compressed", [True, False])
def test_equal_arguments_give_equal_bytes(tmp_path, compressed):
    for name in ("a.exr", "b.exr"):
        write_exr(tmp_path / name, LAYERS, {"frame": 0, "config_sha256": "ab"}, compressed=compressed)
    assert (tmp_path / "a.exr").read_bytes() == (tmp_path / "b.exr").read_bytes()


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, 1e39], ids=str)
def test_pixels_that_are_not_finite_are_never_written(tmp_path, bad):
    path = tmp_path / "a.exr"
    write_exr(path, {"beauty": np.zeros((4, 5, 3))}, {})
    before = path.read_bytes()
    pixels = np.zeros((4, 5, 3))
    pixels[2, 3, 1] = bad
    with pytest.raises(CoslobeError, match="1 pixels of beauty are not finite, the first in row 2, column 3"):
        write_exr(path, {"beauty": pixels}, {})
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


PICTURE = RNG.random((64, 64, 3))


@pytest.mark.parametrize(
    "write",
    [
        lambda path: write_exr(path, {"beauty": PICTURE}, {}),
        lambda path: write_exr(path, {"beauty": PICTURE}, {}, compressed=False),
        lambda path: write_png(path, PICTURE),
    ],
)
def test_a_full_disk_is_one_clear_error_and_leaves_nothing(tmp_path, write):
    resource = pytest.importorskip("resource")
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (4000, limits[1]))  # as if the disk ended there
    try:
        with pytest.raises(CoslobeError, match=r"a.png: cannot be written \(File too large"):
            write(tmp_path / "a.png")
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("keep", [0, 4, 100, 400, -20])
def test_damaged_files_are_refused(tmp_path, keep, capfd):
    path = tmp_path / "a.exr"
    write_exr(path, {"beauty": RNG.random((64, 64, 3))}, {})
    path.write_bytes(path.read_bytes()[:keep])
    with pytest.raises(InvalidInput, match=r"a\.exr: "):
        read_exr(path)
    assert capfd.readouterr().out == ""  # stdout belongs to results


def test_srgb_curve():
    # IEC 61966-2-1: linear near black, mid grey 0.2140 at 0.5, clipped outside [0, 1].
    np.testing.assert_allclose(srgb([0.001]), [0.01292])
    np.testing.assert_allclose(srgb([0.2140411]), [0.5], atol=1e-6)
    np.testing.assert_allclose(srgb([-1, 0, 1, 7]), [0, 0, 1, 1], rtol=1e-15)  # one rounding
    np.testing.assert_allclose(np.diff(srgb([0.0031308, 0.0031309])), 0, atol=1e-5)  # the pieces meet


def test_png_is_the_encoded_picture(tmp_path):
    linear = np.zeros((2, 3, 3))
    linear[0, 1] = [1, 0.2158605, 0.001]
    write_png(tmp_path / "a.png", linear)
    with Image.open(tmp_path / "a.png") as image:
        assert image.size == (3, 2)
        assert image.mode == "RGB"
        assert image.getpixel((1, 0)) == (255, 128, 3)
