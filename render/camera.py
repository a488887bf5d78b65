"""The pinhole camera of the scene file, with Mitsuba 3's conventions, as rays in tile order."""

from dataclasses import dataclass
from functools import lru_cache
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from coslobe.render.scene import Camera, Image, Scene

TILE = 8  # pixels; the points of one tile are shaded by one work-group


@dataclass(frozen=True)
class Rays:
    """One ray per sample, tile after tile and the samples of a pixel side by side.

    Attributes
    ----------
    origin : float64 [3]
        The pinhole; all rays start there.
    direction : float64 [n, 3]
        Unit vectors.
    pixel : int32 [n]
        row * width + column, row 0 on top.
    """

    origin: NDArray
    direction: NDArray
    pixel: NDArray


def camera_rays(scene: "Scene") -> Rays:
    """Rays through the sample positions of every pixel; a camera that rests is asked once."""
    return _rays(scene.camera, scene.image)  # pyright: ignore[reportArgumentType]  # frozen, so hashable


@lru_cache(maxsize=2)
def _rays(camera: "Camera", image: "Image") -> Rays:
    width, height = image.width, image.height
    pixel = tile_order(width, height)
    offsets = sample_pattern(image.samples)
    row, column = np.divmod(pixel, width)
    x = (column[:, None] + offsets[:, 0]).ravel()
    y = (row[:, None] + offsets[:, 1]).ravel()
    tan_x, tan_y = half_extent(camera.fov, camera.fov_axis, width, height)
    right, up, forward, origin = camera_frame(camera)
    direction = (
        forward
        + ((2 * x / width - 1) * tan_x)[:, None] * right
        + ((1 - 2 * y / height) * tan_y)[:, None] * up
    )
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    return Rays(origin, direction, np.repeat(pixel, len(offsets)).astype(np.int32))


def camera_frame(camera: "Camera") -> tuple[NDArray, NDArray, NDArray, NDArray]:
    """Right, up and forward unit vectors and the origin, float64 [3] each."""
    look_at = camera.look_at
    origin = np.asarray(look_at.origin, np.float64)
    forward = np.asarray(look_at.target, np.float64) - origin
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, np.asarray(look_at.up, np.float64))
    right /= np.linalg.norm(right)
    return right, np.cross(right, forward), forward, origin


def half_extent(fov: float, fov_axis: str, width: int, height: int) -> tuple[float, float]:
    """Half-width and half-height of the image plane at distance 1; `fov` in degrees along `fov_axis`."""
    tangent = np.tan(np.radians(fov) / 2)
    across = {
        "x": width,
        "y": height,
        "smaller": min(width, height),
        "larger": max(width, height),
        "diagonal": np.hypot(width, height),
    }[fov_axis]
    return tangent * width / across, tangent * height / across


def sample_pattern(n: int) -> NDArray:
    """Fixed positions in the unit pixel, float64 [n, 2]: centre, grid or Hammersley's set."""
    side = round(np.sqrt(n))
    if side * side == n:
        centres = (np.arange(side) + 0.5) / side
        return np.stack(np.meshgrid(centres, centres), axis=-1).reshape(-1, 2)
    index = np.arange(n)
    radical_inverse = np.zeros(n)
    for bit in range(n.bit_length()):
        radical_inverse += ((index >> bit) & 1) / 2.0 ** (bit + 1)
    # Its ranks, not itself: their mean is the pixel's centre for every n, so that no picture is shifted.
    return np.stack([index + 0.5, np.argsort(np.argsort(radical_inverse)) + 0.5], axis=-1) / n


@lru_cache(maxsize=2)
def tile_order(width: int, height: int) -> NDArray:
    """Pixel indices (row * width + column) ordered by tiles of TILE x TILE pixels, int64 [width * height]."""
    row, column = np.divmod(np.arange(width * height), width)
    return np.lexsort((column % TILE, row % TILE, column // TILE, row // TILE))
