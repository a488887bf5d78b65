"""Pictures: the one writer and reader of EXR files, and the PNG preview."""

import contextlib
import struct
import sys
import zlib
from collections.abc import Iterator, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.core.files import atomic_path
from coslobe.render.plain_exr import write_plain_exr

BEAUTY = "beauty"  # the layer whose channels are plain R, G, B
PREFIX = "coslobe:"  # of our own attributes

# x and y of red, green, blue and white: Rec.709, D65.
_REC_709 = (0.64, 0.33, 0.30, 0.60, 0.15, 0.06, 0.3127, 0.3290)

_XYZ = ("normal", "position")

# Previews: radiance is noise to a predictor, so rows stay unfiltered; see docs/performance.md.
_PNG_LEVEL = 2
_PNG_BLOCK = 1 << 16  # values encoded at a time: they stay in the processor's cache


def write_exr(
    path: Path,
    layers: Mapping[str, ArrayLike],
    attributes: Mapping[str, str | int],
    *,
    compressed: bool = True,
) -> None:
    """Write linear Rec.709 layers as float32, atomically.

    Parameters
    ----------
    layers : dict of arrays [h, w] or [h, w, 3]
        "beauty" becomes R, G, B; another three-channel layer NAME.R/G/B (normal and position: NAME.X/Y/Z); a
        one-channel layer NAME.V (depth: depth.Z).
    attributes : dict
        Stored as "coslobe:NAME". The file holds no times: equal arguments give equal bytes.
    compressed : bool
        With ZIP, which takes eight times as long; it shortens shaded pixels by a fifth, indices to little.

    Raises
    ------
    CoslobeError
        A value is NaN or infinite in float32, or the file cannot be written.
    """
    channels: dict[str, NDArray[np.float32]] = {}
    for layer, values in layers.items():
        with np.errstate(over="ignore"):
            pixels = np.asarray(values, np.float32)
        _refuse_nonfinite(path, layer, pixels)
        planes = [pixels] if pixels.ndim == 2 else np.moveaxis(pixels, -1, 0)
        channels |= zip(_channel_names(layer, pixels.ndim), planes, strict=True)
    stored = {
        "chromaticities": _REC_709,
        "colorInteropID": "lin_rec709_scene",
        **{PREFIX + name: value for name, value in attributes.items()},
    }
    with atomic_path(path) as temporary:
        if compressed:
            _write_compressed(path, temporary, channels, stored)
        else:
            with open(temporary, "wb") as file:
                write_plain_exr(file, channels, stored)


def _write_compressed(
    path: Path, temporary: Path, channels: Mapping[str, NDArray[np.float32]], attributes: Mapping[str, Any]
) -> None:
    import OpenEXR

    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, **attributes}
    # OpenEXR writes the wrong pixels of arrays that are not contiguous, without an error.
    with OpenEXR.File(
        header, {name: np.ascontiguousarray(plane) for name, plane in channels.items()}
    ) as file:
        try:
            file.write(str(temporary))
        except RuntimeError as error:
            reason = str(error).rpartition('". ')[2]  # without the temporary name
            message = f"{path}: cannot be written ({reason})"
            raise CoslobeError(message, "free space or choose another folder") from error


def read_exr(path: Path) -> tuple[dict[str, NDArray[np.float32]], dict[str, Any]]:
    """The layers of an EXR file under the names of `write_exr`, and its "coslobe:" attributes.

    Raises
    ------
    InvalidInput
        The file cannot be read.
    """
    channels, attributes = _read(path, header_only=False)
    groups: dict[str, dict[str, Any]] = {}
    for name, channel in channels.items():
        layer, _, component = name.rpartition(".")
        groups.setdefault(layer or BEAUTY, {})[component] = channel.pixels
    layers = {}
    for layer, planes in groups.items():
        names = _channel_names(layer, 3 if len(planes) == 3 else 2)
        order = [name.rpartition(".")[2] for name in names]
        if set(order) != set(planes) or any(pixels is None for pixels in planes.values()):
            raise InvalidInput(f"{path}: layer {layer} cannot be read", "render the frame again")
        layers[layer] = (
            np.stack([planes[name] for name in order], axis=-1) if len(order) == 3 else planes[order[0]]
        )
    return layers, attributes


def stored_attributes(path: Path) -> dict[str, Any]:
    """The attributes of an earlier picture; nothing where there is none or it is broken."""
    try:
        return read_attributes(path) if path.is_file() else {}
    except InvalidInput:
        return {}


def read_attributes(path: Path) -> dict[str, Any]:
    """The "coslobe:" attributes of an EXR file, without its pixels. Errors as in `read_exr`."""
    return _read(path, header_only=True)[1]


def _read(path: Path, *, header_only: bool) -> tuple[dict[str, Any], dict[str, Any]]:
    import OpenEXR

    try:
        # OpenEXR prints its warnings to stdout, which belongs to results.
        with (
            contextlib.redirect_stdout(sys.stderr),
            OpenEXR.File(str(path), separate_channels=True, header_only=header_only) as file,
        ):
            header = dict(file.header())
            channels = {} if header_only else dict(file.channels())
    except (RuntimeError, ValueError, TypeError) as error:
        raise InvalidInput(
            f"{path}: cannot be read as an EXR file ({error})", "render the frame again"
        ) from error
    return channels, {
        key.removeprefix(PREFIX): value for key, value in header.items() if key.startswith(PREFIX)
    }


def _channel_names(layer: str, dimensions: int) -> list[str]:
    if dimensions == 2:
        return [f"{layer}.Z" if layer == "depth" else f"{layer}.V"]
    if layer == BEAUTY:
        return ["R", "G", "B"]
    return [f"{layer}.{component}" for component in ("XYZ" if layer in _XYZ else "RGB")]


def _refuse_nonfinite(path: Path, layer: str, pixels: NDArray[np.float32]) -> None:
    finite = np.isfinite(pixels)
    if not finite.all():
        bad = ~finite.reshape(*pixels.shape[:2], -1).all(axis=-1)
        row, column = np.argwhere(bad)[0]
        raise CoslobeError(
            f"{path}: not written: {bad.sum()} pixels of {layer} are not finite, the first in row {row}, "
            f"column {column}",
            "look for extreme sizes, distances or radiances in the scene; report it if there are none",
        )


def write_png(path: Path, rgb: ArrayLike) -> None:
    """Write linear Rec.709 radiance [h, w, 3] as an 8-bit sRGB picture, exposure 1, clipped; atomically."""
    pixels = np.asarray(rgb, np.float32)
    height, width = pixels.shape[:2]
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)  # 8 bits of red, green and blue
    with atomic_path(path) as temporary, open(temporary, "wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n" + _png_chunk(b"IHDR", header))
        for part in _deflated_rows(pixels):
            file.write(_png_chunk(b"IDAT", part))
        file.write(_png_chunk(b"IEND", b""))


def _deflated_rows(pixels: NDArray[np.float32]) -> Iterator[bytes]:
    """The rows of a PNG file, each after its filter's number, in compressed parts that are not empty."""
    height, width = pixels.shape[:2]
    stream = zlib.compressobj(_PNG_LEVEL)
    step = max(_PNG_BLOCK // (3 * width), 1)
    for first in range(0, height, step):
        block = pixels[first : first + step]
        rows = np.zeros((len(block), 1 + 3 * width), np.uint8)
        rows[:, 1:] = _encode(block).reshape(len(block), 3 * width)
        if part := stream.compress(rows.data):
            yield part
    yield stream.flush()


def _png_chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(data, zlib.crc32(kind)))


@lru_cache(maxsize=1)
def _levels() -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    """Tables of `_encode`, by the upper halves of float32 numbers.

    The 8-bit level of the smallest number with such a half, and from where on it is one more. There is never
    a second step: seven bits of the fraction are finer than eight bits of the curve.
    """
    half = np.arange(1 << 16, dtype=np.uint32)
    edges = (half << 16).view(np.float32)
    edges[half >= 0x8000] = 0.0  # negative
    edges[np.isnan(edges)] = np.inf
    steps = linear((np.arange(1, 256) - 0.5) / 255)  # where rounding goes up
    below = np.searchsorted(steps, edges, side="right")
    step = np.append(steps, np.nan)[below]
    single = step.astype(np.float32)
    above = np.where(single < step, np.nextafter(single, np.float32(np.inf)), single)
    return below.astype(np.uint8), above


def _encode(rgb: NDArray[np.float32]) -> NDArray[np.uint8]:
    """rint(255 srgb(rgb)) by tables, several times as fast as by powers; NaN becomes some level."""
    level, step = _levels()
    half = np.ascontiguousarray(rgb, "<f4").view("<u2").reshape(*rgb.shape, 2)[..., 1]
    return level[half] + (rgb >= step[half])


def srgb(linear: ArrayLike) -> NDArray[np.float64]:
    """Encode linear values with the sRGB curve (IEC 61966-2-1), clipped to [0, 1]."""
    x = np.clip(np.asarray(linear, np.float64), 0, 1)
    return np.where(x <= 0.0031308, 12.92 * x, 1.055 * x ** (1 / 2.4) - 0.055)


def linear(srgb_values: ArrayLike) -> NDArray[np.float64]:
    """Decode values from 0 to 1 that the sRGB curve has encoded: the inverse of `srgb`."""
    x = np.asarray(srgb_values, np.float64)
    return np.where(x <= 0.04045, x / 12.92, ((x + 0.055) / 1.055) ** 2.4)
