"""Pictures as text inside a page."""

import base64
import io
import zlib
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.report.page import Picture
from coslobe.render.images import BEAUTY, read_exr

FILM_QUALITY = 88  # JPEG; the frames that are compared are shown without loss

LARGEST_HALF = 65504.0


def png(path: Path, label: str, *, exr: Path | None = None, bar: dict | None = None) -> Picture:
    """A PNG file as it is; `exr` holds the same picture in full range."""
    from PIL import Image

    data = path.read_bytes()
    with Image.open(io.BytesIO(data)) as image:
        width, height = image.size
    full = None if exr is None else radiance(read_exr(exr)[0][BEAUTY])
    return Picture(label, data_url("png", data), width, height, full, bar)


def jpeg(path: Path, label: str) -> Picture:
    """A picture file as a small JPEG."""
    from PIL import Image

    buffer = io.BytesIO()
    with Image.open(path) as image:
        image.save(buffer, "JPEG", quality=FILM_QUALITY)
        width, height = image.size
    return Picture(label, data_url("jpeg", buffer.getvalue()), width, height)


def data_url(kind: str, content: bytes) -> str:
    """A picture's file as what stands in `src`."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode()}"


def radiance(pixels: NDArray) -> str:
    """Linear radiance [h, w, 3] for viewer.js: half floats, three digits of which are right, compressed.

    Per channel, the differences of neighbours' bits: all high bytes, then all low ones.
    """
    halves = np.clip(np.nan_to_num(pixels), 0, LARGEST_HALF).astype(np.float16)
    bits = np.ascontiguousarray(np.moveaxis(halves, -1, 0)).view(np.uint16).reshape(3, -1)
    steps = np.diff(bits, axis=1, prepend=np.uint16(0))
    planes = np.stack([steps >> 8, steps & 255], axis=1).astype(np.uint8)
    return base64.b64encode(zlib.compress(planes.tobytes())).decode()
