"""The pinhole camera of the scene file, with Mitsuba 3's conventions, as rays in tile order."""

from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from coslobe.render.scene import Camera, Image, Scene

TILE = 8  # pixels; the points of one tile are shaded by one work-group
BLOCK = TILE * TILE  # pixels that lie together
BAND = 1 << 19  # rays that are traced and shaded at once: bounds the memory of large pictures
KEPT_BANDS = 4  # what is found behind the rays is kept from frame to frame in pictures of up to as many bands


class Part(NamedTuple):
    """Some of a picture's pixels in tile order: from `first` to `last`, of them one block in `every`."""

    first: int
    last: int
    every: int = 1


def bands(image: "Image", rays: int = BAND) -> list[Part]:
    """The parts in which a picture is computed, of at most `rays` rays (but at least one block) each."""
    pixels = image.width * image.height
    step = max(rays // image.samples // BLOCK, 1) * BLOCK
    return [Part(first, min(first + step, pixels)) for first in range(0, pixels, step)]


@dataclass(frozen=True, eq=False)
class Rays:
    """One ray per sample, tile after tile and the samples of a pixel side by side.

    Attributes
    ----------
    origin : float64 [3]
        The pinhole; all rays start there.
    frame : float64 [3, 3]
        Unit vectors to the right, up and forward, as rows.
    local : float64 [3, n]
        Unit vectors in that frame: right, up and forward of each.
    pixel : int32 [n]
        row * width + column, row 0 on top.
    """

    origin: NDArray
    frame: NDArray
    local: NDArray
    pixel: NDArray

    @property
    def direction(self) -> NDArray:
        """Unit vectors in the world, float64 [n, 3]."""
        return turned(self.frame.T, self.local).T

    @cached_property
    def blocks(self) -> tuple[NDArray, NDArray]:
        """Lower and upper bounds of x / z and y / z in the frame, per block of BLOCK rays, [m, 2] each."""
        slope = self.local[:2] / self.local[2]
        starts = np.arange(0, slope.shape[1], BLOCK)
        return np.minimum.reduceat(slope, starts, axis=1).T, np.maximum.reduceat(slope, starts, axis=1).T


def turned(matrix: NDArray, vectors: NDArray) -> NDArray:
    """`matrix @ vectors`, [m, 3] and [3, n], without the threads of BLAS, which would spin beside kernels."""
    return np.stack([row[0] * vectors[0] + row[1] * vectors[1] + row[2] * vectors[2] for row in matrix])


def camera_rays(scene: "Scene", part: Part | None = None) -> Rays:
    """Rays through the sample positions of the pixels of `part`, all by default.

    A camera that rests is asked once, and cameras of one picture share the directions in their frames.
    """
    image = scene.image
    part = part or Part(0, image.width * image.height)
    # Both are frozen, so hashable.
    return _rays(scene.camera, image, part)  # pyright: ignore[reportArgumentType]


@lru_cache(maxsize=KEPT_BANDS + 1)
def _rays(camera: "Camera", image: "Image", part: Part) -> Rays:
    right, up, forward, origin = camera_frame(camera)
    field = (camera.fov, camera.fov_axis)
    local, pixel = _local_rays(image, *field, part)  # pyright: ignore[reportArgumentType]
    return Rays(origin, np.stack([right, up, forward]), local, pixel)


@lru_cache(maxsize=KEPT_BANDS + 1)
def _local_rays(image: "Image", fov: float, fov_axis: str, part: Part) -> tuple[NDArray, NDArray]:
    """Unit vectors [3, n] in the camera's frame, and their pixels."""
    width, height = image.width, image.height
    pixel = tile_order(width, height)[part.first : part.last]
    if part.every > 1:
        pixel = pixel[np.arange(len(pixel)) // BLOCK % part.every == 0]
    row, column = np.divmod(pixel, width)
    offsets = sample_pattern(image.samples)
    tan_x, tan_y = half_extent(fov, fov_axis, width, height)
    x = ((2 * (column[:, None] + offsets[:, 0]) / width - 1) * tan_x).ravel()
    y = ((1 - 2 * (row[:, None] + offsets[:, 1]) / height) * tan_y).ravel()
    local = np.stack([x, y, np.ones_like(x)]) / np.sqrt(x * x + y * y + 1)
    return local, np.repeat(pixel, image.samples)


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
    """Pixel indices (row * width + column) ordered by tiles of TILE x TILE pixels, int32 [width * height]."""
    rows, columns = (-(-extent // TILE) * TILE for extent in (height, width))
    column = np.arange(columns, dtype=np.int32)
    # int32 suffices: a picture of more pixels than that does not fit any memory
    pixel = np.where(column < width, np.arange(rows, dtype=np.int32)[:, None] * width + column, -1)
    pixel[height:] = -1
    tiles = pixel.reshape(rows // TILE, TILE, columns // TILE, TILE).transpose(0, 2, 1, 3).ravel()
    return tiles if len(tiles) == width * height else tiles[tiles >= 0]
