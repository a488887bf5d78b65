"""Error maps as pictures: one colour scale for all frames, blue where too dark, orange where too bright."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core.files import atomic_path
from coslobe.render.images import srgb

COLOURS = ("#b7d9ff", "#5aa5f0", "#1f5fa8", "#15171b", "#a8441a", "#f08a4b", "#ffe0b8")
"""From the most negative error over zero to the most positive, equally spaced; the middle is dark."""

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
    stops = np.array([[int(colour[i : i + 2], 16) for i in (1, 3, 5)] for colour in COLOURS], np.float64)
    position = np.clip(error / scale, -1, 1)
    at = np.linspace(-1, 1, len(stops))
    return np.stack([np.rint(np.interp(position, at, stops[:, c])) for c in range(3)], -1).astype(np.uint8)


def write_error_map(path: Path, error: NDArray, hit: NDArray, scale: float) -> None:
    """Write signed errors [h, w] as an RGBA picture; pixels without a surface are transparent."""
    from PIL import Image

    pixels = np.full((*error.shape, 4), NO_SURFACE, np.uint8)
    pixels[hit, :3] = error_colours(error[hit], scale)
    pixels[hit, 3] = 255
    with atomic_path(path) as temporary:
        Image.fromarray(pixels).save(temporary)


def write_comparison(
    path: Path, pictures: dict[str, NDArray], maps: dict[str, tuple[NDArray, NDArray, float]], title: str
) -> None:
    """A figure for papers and slides: linear pictures above, error maps (error, hit, scale) below."""
    from matplotlib.colors import LinearSegmentedColormap
    from matplotlib.figure import Figure

    colormap = LinearSegmentedColormap.from_list("coslobe_error", COLOURS)
    columns = max(len(pictures), len(maps))
    height, width = next(iter(pictures.values())).shape[:2]
    size = (3.6 * columns, 2 * (3.6 * height / width + 0.55))
    figure = Figure(figsize=size, layout="constrained")
    axes = figure.subplots(2, columns, squeeze=False)
    for axis in axes.flat:
        axis.set_axis_off()
    for axis, (name, picture) in zip(axes[0], pictures.items(), strict=False):
        axis.imshow(srgb(picture))
        axis.set_title(name, fontsize=10)
    for axis, (name, (error, hit, scale)) in zip(axes[1], maps.items(), strict=False):
        shown = axis.imshow(np.where(hit, error, np.nan), cmap=colormap, vmin=-scale, vmax=scale)
        axis.set_title(name, fontsize=10)
        figure.colorbar(shown, ax=axis, orientation="horizontal", format="{x:+.2g}", shrink=0.8)
    figure.suptitle(title, fontsize=11)
    with atomic_path(path) as temporary:
        figure.savefig(temporary, dpi=150)
