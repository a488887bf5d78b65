"""A picture of a fit: mesh, spheres, and the difference of their silhouettes, from three sides."""

import colorsys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.files import atomic_path
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.solid import Solid, solid_of

Array = NDArray[np.float64]

PIXELS = 340  # of a panel's width
OVERSAMPLING = 2
WINDOW = 1.06  # a panel's width, in longest sides of what is shown
MARGIN, HEADER, LINE, SWATCH = 16, 56, 26, 13

# Name, viewing direction and the image's upward direction; meshes stand upright in y.
VIEWS = (
    ("front", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    ("side", (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ("above", (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
)
KEY_LIGHT = np.array([-0.45, 0.65, 0.61])  # right, up, towards the viewer; unit length

PAPER, INK = np.array([1.0, 1.0, 1.0]), (45, 47, 52)
CLAY = np.array([0.80, 0.82, 0.86])
BOTH = np.array([0.84, 0.85, 0.87])
# Vermilion and blue of Okabe and Ito (2008): apart for every kind of colour vision, and in grey.
MISSING, EXTRA = np.array([[0.835, 0.369, 0.0], [0.0, 0.447, 0.698]])


def write_preview(path: Path, mesh: Mesh, spheres: SphereSet) -> None:
    """Write a PNG with one row per view: the mesh, the spheres, their silhouettes over each other.

    In the last column grey is where both are, vermilion where only the mesh is, blue where only spheres are.
    """
    from PIL import Image, ImageDraw, ImageFont

    solid = solid_of(mesh)
    unit = np.column_stack([(spheres.centers - solid.center) / solid.size, spheres.radii / solid.size])
    # Rows of a camera: right, up, towards the viewer.
    cameras = [np.array([np.cross(forward, up), up, np.negative(forward)]) for _, forward, up in VIEWS]
    views = [_panels(solid, mesh.normals, unit, camera) for camera in cameras]
    step = PIXELS + MARGIN
    heights = [len(panels[0]) // OVERSAMPLING for panels, _ in views]
    sheet = Image.new(
        "RGB", (3 * step + MARGIN, HEADER + sum(heights) + len(views) * (LINE + MARGIN)), "white"
    )
    draw = ImageDraw.Draw(sheet)
    title, small = ImageFont.load_default(18), ImageFont.load_default(14)
    plural = "" if spheres.count == 1 else "s"
    draw.text((MARGIN, MARGIN), f"{mesh.name}: {len(mesh.faces):,} triangles", INK, title)
    draw.text((MARGIN + step, MARGIN), f"{spheres.count:,} sphere{plural}", INK, title)
    at = MARGIN + 2 * step
    for text, color in (("missing", MISSING), ("extra", EXTRA)):
        draw.rectangle((at, MARGIN + 5, at + SWATCH, MARGIN + 5 + SWATCH), _bytes(color))
        draw.text((at + 2 * SWATCH, MARGIN), text, INK, title)
        at += 4 * SWATCH + draw.textlength(text, title)
    top = HEADER
    for (name, _, _), (panels, iou), height in zip(VIEWS, views, heights, strict=True):
        for column, panel in enumerate(panels):
            sheet.paste(_image(panel), (MARGIN + column * step, top))
        top += height + MARGIN // 2
        draw.text((MARGIN, top), name, INK, small)
        draw.text((MARGIN + 2 * step, top), f"silhouette IoU {iou:.3f}", INK, small)
        top += LINE + MARGIN // 2
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="PNG")


def sphere_colors(count: int) -> Array:
    """Colours [count, 3] in linear light; neighbours in a fit's order differ clearly."""
    hues = 0.6 + 0.618034 * np.arange(count)
    return np.array([colorsys.hsv_to_rgb(hue % 1, 0.42, 0.92) for hue in hues]) ** 2.2


def _bytes(color: Array) -> tuple[int, ...]:
    return tuple(int(255 * value) for value in color)


def _image(panel: Array) -> Any:
    """Box-filter the samples of a panel [h, w, 3] in linear light and encode them as sRGB."""
    from PIL import Image

    h, w = np.array(panel.shape[:2]) // OVERSAMPLING
    linear = panel.reshape(h, OVERSAMPLING, w, OVERSAMPLING, 3).mean((1, 3))
    root = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, root)
    return Image.fromarray(np.rint(255 * encoded.clip(0, 1)).astype(np.uint8))


def _panels(solid: Solid, normals: Array, spheres: Array, camera: Array) -> tuple[list[Array], float]:
    """The three panels [h, w, 3] in linear light, and the intersection over union of the silhouettes."""
    lower = np.minimum(solid.lower, (spheres[:, :3] - spheres[:, 3:]).min(0))
    upper = np.maximum(solid.upper, (spheres[:, :3] + spheres[:, 3:]).max(0))
    pixel = WINDOW * (upper - lower).max() / PIXELS
    # Views are along axes: the box's extent up the image is exact, and panels are no higher than it.
    height = int(np.ceil(WINDOW * abs(camera[1] @ (upper - lower)) / pixel))
    middle = camera @ (lower + upper) / 2
    x = middle[0] + _centered(PIXELS) * pixel
    y = middle[1] - _centered(height) * pixel
    right, up = np.meshgrid(x, y)
    seen_mesh, mesh_normals = _mesh_view(solid, normals, right, up, camera)
    index, sphere_normals = _sphere_view(spheres @ _embedded(camera).T, x, y)
    seen_spheres = index >= 0

    mesh = np.where(seen_mesh[..., None], CLAY**2.2 * _shade(mesh_normals), PAPER)
    balls = np.where(
        seen_spheres[..., None], sphere_colors(len(spheres))[index] * _shade(sphere_normals), PAPER
    )
    difference = np.tile(PAPER, (*index.shape, 1))
    difference[seen_mesh & seen_spheres] = BOTH**2.2
    difference[seen_mesh & ~seen_spheres] = MISSING**2.2
    difference[~seen_mesh & seen_spheres] = EXTRA**2.2
    iou = (seen_mesh & seen_spheres).sum() / max((seen_mesh | seen_spheres).sum(), 1)
    return [mesh, balls, difference], float(iou)


def _centered(pixels: int) -> Array:
    """Positions of the samples along a side of so many pixels around its middle, in pixels."""
    return (np.arange(pixels * OVERSAMPLING) + 0.5) / OVERSAMPLING - pixels / 2


def _embedded(camera: Array) -> Array:
    """The rotation that turns centers into camera coordinates and leaves radii alone, [4, 4]."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera
    return matrix


def _shade(normals: Array) -> Array:
    """Light that wraps around: shapes read on the far side too."""
    return (0.1 + 0.9 * (0.5 + 0.5 * normals @ KEY_LIGHT) ** 2)[..., None]


def _mesh_view(
    solid: Solid, normals: Array, right: Array, up: Array, camera: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Mask and camera-space normals of the mesh."""
    origins = np.stack([right, up, np.ones_like(up)], axis=-1).reshape(-1, 3) @ camera
    distance, face, weights = solid.first_hit(origins, -camera[2])
    normal = np.einsum("nk,nkd->nd", weights, normals[solid.faces[face]]) @ camera.T
    normal *= np.where(normal[:, 2:] < 0, -1, 1)  # towards the viewer
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12)
    return np.isfinite(distance).reshape(right.shape), normal.reshape(*right.shape, 3)


def _sphere_view(spheres: Array, x: Array, y: Array) -> tuple[NDArray[np.int64], Array]:
    """Which sphere (camera coordinates, [n, 4]) each pixel sees (-1: none) and its normals there.

    Columns are at `x`, rising, and rows at `y`, falling.
    """
    nearest = np.full((len(y), len(x)), -np.inf)
    index = np.full(nearest.shape, -1)
    for k, (center_x, center_y, center_z, r) in enumerate(spheres):
        columns = slice(*np.searchsorted(x, (center_x - r, center_x + r)))
        rows = slice(*np.searchsorted(-y, (-center_y - r, -center_y + r)))
        height2 = r * r - (x[columns] - center_x) ** 2 - (y[rows, None] - center_y) ** 2
        height = center_z + np.sqrt(np.maximum(height2, 0))
        front = (height2 > 0) & (height > nearest[rows, columns])
        nearest[rows, columns] = np.where(front, height, nearest[rows, columns])
        index[rows, columns] = np.where(front, k, index[rows, columns])
    surface = np.stack([*np.meshgrid(x, y), np.where(index < 0, 0, nearest)], axis=-1)
    return index, (surface - spheres[index, :3]) / spheres[index, 3:]
