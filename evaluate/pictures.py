"""Error maps as pictures: one colour scale for all frames, blue where too dark, orange where too bright."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core.files import atomic_path
from coslobe.render.images import srgb

COLOURS = ("#b7d9ff", "#5aa5f0", "#1f5fa8", "#15171b", "#a8441a", "#f08a4b", "#ffe0b8")
"""From the most negative error over zero to the most positive, equally spaced; the middle is dark."""

SHARE_COLOURS = ("#1b1030", "#7b3f8c", "#e8a06b", "#fff7e0")
"""From no light over penumbra to all of it, equally spaced."""

HEAT_COLOURS = ("#120a3a", "#2a4fb0", "#25a39a", "#9ad24a", "#fbe34d", "#f5762a", "#b3122b")
"""From nothing to the most, equally spaced: false colours of counts."""

NO_SURFACE = (0, 0, 0, 0)  # transparent


def error_scale(errors: Sequence[NDArray]) -> float:
    """The error at the ends of the colour scale: 1, 2 or 5 times a power of ten, above 99.5 % of pixels."""
    values = np.abs(np.concatenate([error.ravel() for error in errors]))
    wanted = float(np.quantile(values, 0.995)) if values.size else 0.0
    if wanted <= 1e-6:
        return 1e-6
    power = 10 ** np.floor(np.log10(wanted))
    return float(next(step * power for step in (1, 2, 5, 10) if step * power >= wanted * (1 - 1e-9)))


def error_colours(error: NDArray, scale: float) -> NDArray:
    """sRGB colours, uint8 [..., 3], of signed errors; those beyond the scale get its last colour."""
    return _interpolated(np.clip(error / scale, -1, 1) / 2 + 0.5, COLOURS)


def _interpolated(position: NDArray, colours: Sequence[str]) -> NDArray:
    """Equally spaced colours between positions 0 and 1: uint8 [..., 3]."""
    stops = np.array([[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in colours], np.float64)
    at = np.linspace(0, 1, len(stops))
    return np.stack([np.rint(np.interp(position, at, stops[:, c])) for c in range(3)], -1).astype(np.uint8)


def write_error_map(path: Path, error: NDArray, hit: NDArray, scale: float) -> None:
    """Write signed errors [h, w] as an RGBA picture; pixels without a surface are transparent."""
    _write(path, error_colours(error, scale), hit)


def write_share_map(path: Path, share: NDArray, hit: NDArray) -> None:
    """Write shares from 0 to 1, [h, w], as `write_error_map` does, in `SHARE_COLOURS`."""
    _write(path, _interpolated(np.clip(share, 0, 1), SHARE_COLOURS), hit)


def write_heat_map(path: Path, counts: NDArray, most: float) -> None:
    """Write counts [h, w] from 0 to `most` in `HEAT_COLOURS`."""
    _write(path, _interpolated(np.clip(counts / most, 0, 1), HEAT_COLOURS), np.ones(counts.shape, bool))


def _write(path: Path, colours: NDArray, hit: NDArray) -> None:
    from PIL import Image

    pixels = np.full((*hit.shape, 4), NO_SURFACE, np.uint8)
    pixels[hit, :3], pixels[hit, 3] = colours[hit], 255
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary)


def write_comparison(
    path: Path, pictures: dict[str, NDArray], maps: dict[str, tuple[NDArray, NDArray, float]], title: str
) -> None:
    """A figure for papers and slides: linear pictures above, error maps (error, hit, scale) below."""
    from PIL import Image, ImageDraw, ImageFont

    height, width = next(iter(pictures.values())).shape[:2]
    gap = max(width // 40, 6)
    size = max(width // 28, 9)
    font, line = ImageFont.load_default(size=size), round(size * 1.5)
    columns, row = max(len(pictures), len(maps)), height + line + gap
    canvas = Image.new("RGB", (gap + columns * (width + gap), gap + line + 2 * row + 2 * line), "white")
    draw = ImageDraw.Draw(canvas)
    draw.text((gap, gap), title, fill="black", font=font)
    for column, (name, picture) in enumerate(pictures.items()):
        x, y = gap + column * (width + gap), gap + line
        draw.text((x, y), name, fill="black", font=font)
        canvas.paste(Image.fromarray(np.rint(srgb(picture) * 255).astype(np.uint8)), (x, y + line))
    for column, (name, (error, hit, scale)) in enumerate(maps.items(), start=columns - len(maps)):
        x, y = gap + column * (width + gap), gap + line + row
        draw.text((x, y), name, fill="black", font=font)
        colours = np.where(hit[..., None], error_colours(error, scale), np.uint8(255))
        canvas.paste(Image.fromarray(colours), (x, y + line))
        ramp = np.broadcast_to(np.linspace(-scale, scale, width), (line // 2, width))
        canvas.paste(Image.fromarray(error_colours(ramp, scale)), (x, y + line + height + gap // 2))
        below = y + line + height + gap // 2 + line // 2
        for at, anchor in ((-scale, "la"), (0.0, "ma"), (scale, "ra")):
            place = (x + width * (at / scale + 1) / 2, below)
            draw.text(place, f"{at:+.3g}" if at else "0", fill="black", font=font, anchor=anchor)
    with atomic_path(path) as temporary:
        canvas.save(temporary)
