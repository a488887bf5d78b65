"""Pictures as textures: read from a file, and looked up at texture coordinates."""

import contextlib
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.render.images import linear

SUFFIXES = (".png", ".jpg", ".jpeg", ".exr")


def read_texels(path: Path, *, colour: bool) -> NDArray[np.float32]:
    """The texels of a picture, row 0 on top: float32 [h, w, 3] of a `colour`, else [h, w].

    Numbers are the first channel as stored, 0 to 1 in PNG and JPEG files. Colours of such files are decoded
    with the sRGB curve; EXR files are linear. Transparency is ignored.

    Raises
    ------
    InvalidInput
        The file is missing, broken, of another type, or holds values that are not finite.
    """
    readers = {suffix: _read_exr if suffix == ".exr" else _read_encoded for suffix in SUFFIXES}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise InvalidInput(
            f"{path}: not a picture that can be read as a texture", f"use {', '.join(SUFFIXES)}"
        )
    try:
        pixels = reader(path)
    except Exception as error:  # the readers raise whatever their format makes them stumble over
        raise InvalidInput(f"{path}: cannot be read as a texture ({error})", "export it again") from error
    if not np.isfinite(pixels).all():
        raise InvalidInput(f"{path}: holds values that are not finite", "repair the picture")
    if not colour:
        return np.ascontiguousarray(pixels[..., 0])
    rgb = pixels[..., :3] if pixels.shape[-1] >= 3 else np.repeat(pixels[..., :1], 3, axis=-1)
    return rgb if reader is _read_exr else linear(rgb).astype(np.float32)


def _read_encoded(path: Path) -> NDArray[np.float32]:
    """Channels [h, w, c] of a PNG or JPEG file, 0 to 1."""
    from PIL import Image

    with Image.open(path) as picture:
        if picture.mode.startswith("I"):  # 16 bits of grey
            return np.asarray(picture, np.float32)[..., None] / np.float32(65535)
        grey = picture.mode in ("1", "L", "LA")
        pixels = np.asarray(picture.convert("L" if grey else "RGB"), np.float32)
        return np.atleast_3d(pixels) / np.float32(255)


def _read_exr(path: Path) -> NDArray[np.float32]:
    """Channels [h, w, c] of an EXR file: R, G, B where it has them, else the first."""
    import OpenEXR

    # OpenEXR prints its warnings to stdout, which belongs to results.
    with (
        contextlib.redirect_stdout(sys.stderr),
        OpenEXR.File(str(path), separate_channels=True) as file,
    ):
        channels: dict[str, Any] = dict(file.channels())
        names = [name for name in "RGB" if name in channels]
        names = names if len(names) == 3 else list(channels)[:1]
        return np.stack([np.asarray(channels[name].pixels, np.float32) for name in names], axis=-1)


def look_up(texels: NDArray, uv: NDArray) -> NDArray[np.float64]:
    """`texels` [h, w] or [h, w, 3] at texture coordinates [n, 2]: float64 [n] or [n, 3].

    Bilinear between the centres of texels, wrapped in both directions. u runs from left to right and v from
    bottom to top, both from 0 to 1 over the picture.
    """
    height, width = texels.shape[:2]
    row, column = (1 - uv[:, 1]) * height - 0.5, uv[:, 0] * width - 0.5
    top, left = np.floor(row), np.floor(column)
    down, right = (row - top).astype(np.float64), (column - left).astype(np.float64)
    rows = [np.mod(top + k, height).astype(np.int64) * width for k in (0, 1)]
    columns = [np.mod(left + k, width).astype(np.int64) for k in (0, 1)]
    flat = texels.reshape(height * width, *texels.shape[2:])
    if flat.ndim == 2:
        down, right = down[:, None], right[:, None]
    upper, lower = ((1 - right) * flat[line + columns[0]] + right * flat[line + columns[1]] for line in rows)
    return (1 - down) * upper + down * lower
