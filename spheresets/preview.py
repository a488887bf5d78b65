"""A picture of a fit: mesh, spheres, and the difference of their silhouettes, from three sides."""

import colorsys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.files import atomic_path
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

PIXELS = 340  # of a panel's side
OVERSAMPLING = 2
WINDOW = 1.06  # a panel's side, in longest sides of what is shown
MARGIN, HEADER, LINE = 16, 56, 20

# Name, viewing direction and the image's upward direction; meshes stand upright in y.
VIEWS = (
    ("front", (0.0, 0.0, -1.0), (0.0, 1.0, 0.0)),
    ("side", (-1.0, 0.0, 0.0), (0.0, 1.0, 0.0)),
    ("above", (0.0, -1.0, 0.0), (0.0, 0.0, -1.0)),
)
KEY_LIGHT = np.array([-0.45, 0.65, 0.61])  # right, up, towards the viewer; unit length
AMBIENT = 0.30

PAPER, INK = np.array([1.0, 1.0, 1.0]), (45, 47, 52)
CLAY = np.array([0.72, 0.74, 0.78])
BOTH, MISSING, EXTRA = np.array([[0.84, 0.85, 0.87], [0.83, 0.21, 0.16], [0.15, 0.38, 0.78]])


def write_preview(path: Path, mesh: Mesh, spheres: SphereSet) -> None:
    """Write a PNG with one row per view: the mesh, the spheres, their silhouettes over each other.

    In the last column grey is where both are, red where only the mesh is, blue where only spheres are.
    """
    from PIL import Image, ImageDraw, ImageFont

    solid = Solid(mesh)
    unit = np.column_stack([(spheres.centers - solid.center) / solid.size, spheres.radii / solid.size])
    step = PIXELS + MARGIN
    sheet = Image.new("RGB", (3 * step + MARGIN, HEADER + len(VIEWS) * (step + LINE)), "white")
    draw = ImageDraw.Draw(sheet)
    title, small = ImageFont.load_default(18), ImageFont.load_default(14)
    plural = "" if spheres.count == 1 else "s"
    draw.text((MARGIN, MARGIN), f"{mesh.name}: {len(mesh.faces):,} triangles", INK, title)
    draw.text((MARGIN + step, MARGIN), f"{spheres.count:,} sphere{plural}", INK, title)
    at = MARGIN + 2 * step
    for text, color in (("silhouettes: ", INK), ("missing ", _bytes(MISSING)), ("extra", _bytes(EXTRA))):
        draw.text((at, MARGIN), text, color, title)
        at += draw.textlength(text, title)
    for row, (name, forward, up) in enumerate(VIEWS):
        # Rows: right, up, towards the viewer.
        camera = np.array([np.cross(forward, up), up, np.negative(forward)])
        panels, iou = _panels(solid, mesh.normals, unit, camera)
        top = HEADER + row * (step + LINE)
        for column, panel in enumerate(panels):
            sheet.paste(_image(panel), (MARGIN + column * step, top))
        draw.text((MARGIN, top + PIXELS + 2), name, INK, small)
        draw.text((MARGIN + 2 * step, top + PIXELS + 2), f"IoU {iou:.3f}", INK, small)
    with atomic_path(path) as temporary:
        sheet.save(temporary, format="PNG")


def _bytes(color: Array) -> tuple[int, ...]:
    return tuple(int(255 * value) for value in color)


def _image(panel: Array) -> Any:
    """Box-filter the samples of a panel [s, s, 3] in linear light and encode them as sRGB."""
    from PIL import Image

    linear = panel.reshape(PIXELS, OVERSAMPLING, PIXELS, OVERSAMPLING, 3).mean((1, 3))
    root = 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055
    encoded = np.where(linear <= 0.0031308, 12.92 * linear, root)
    return Image.fromarray(np.rint(255 * encoded.clip(0, 1)).astype(np.uint8))


def _panels(solid: Solid, normals: Array, spheres: Array, camera: Array) -> tuple[list[Array], float]:
    """The three panels [s, s, 3] in linear light, and the intersection over union of the silhouettes."""
    side = PIXELS * OVERSAMPLING
    lower = np.minimum(solid.lower, (spheres[:, :3] - spheres[:, 3:]).min(0))
    upper = np.maximum(solid.upper, (spheres[:, :3] + spheres[:, 3:]).max(0))
    steps = ((np.arange(side) + 0.5) / side - 0.5) * WINDOW * 2 * max(upper.max(), -lower.min())
    right, up = np.meshgrid(steps, -steps)
    seen_mesh, mesh_normals = _mesh_view(solid, normals, right, up, camera)
    index, sphere_normals = _sphere_view(spheres @ _embedded(camera).T, steps)
    seen_spheres = index >= 0

    mesh = np.where(seen_mesh[..., None], CLAY * _shade(mesh_normals), PAPER)
    hues = np.array([colorsys.hsv_to_rgb((0.6 + 0.618034 * k) % 1, 0.42, 0.92) for k in range(len(spheres))])
    balls = np.where(seen_spheres[..., None], hues[index] ** 2.2 * _shade(sphere_normals), PAPER)
    difference = np.tile(PAPER, (side, side, 1))
    difference[seen_mesh & seen_spheres] = BOTH**2.2
    difference[seen_mesh & ~seen_spheres] = MISSING**2.2
    difference[~seen_mesh & seen_spheres] = EXTRA**2.2
    iou = (seen_mesh & seen_spheres).sum() / max((seen_mesh | seen_spheres).sum(), 1)
    return [mesh, balls, difference], float(iou)


def _embedded(camera: Array) -> Array:
    """The rotation that turns centers into camera coordinates and leaves radii alone, [4, 4]."""
    matrix = np.eye(4)
    matrix[:3, :3] = camera
    return matrix


def _shade(normals: Array) -> Array:
    return (AMBIENT + (1 - AMBIENT) * np.maximum(normals @ KEY_LIGHT, 0))[..., None]


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


def _sphere_view(spheres: Array, steps: Array) -> tuple[NDArray[np.int64], Array]:
    """Which sphere (camera coordinates, [n, 4]) each pixel sees (-1: none) and its normals there."""
    nearest = np.full((len(steps), len(steps)), -np.inf)
    index = np.full(nearest.shape, -1)
    for k, (x, y, z, r) in enumerate(spheres):
        columns = slice(*np.searchsorted(steps, (x - r, x + r)))
        rows = slice(*np.searchsorted(steps, (-y - r, -y + r)))
        height2 = r * r - (steps[columns] - x) ** 2 - (-steps[rows, None] - y) ** 2
        height = z + np.sqrt(np.maximum(height2, 0))
        front = (height2 > 0) & (height > nearest[rows, columns])
        nearest[rows, columns] = np.where(front, height, nearest[rows, columns])
        index[rows, columns] = np.where(front, k, index[rows, columns])
    x, y = np.meshgrid(steps, -steps)
    surface = np.stack([x, y, np.where(index < 0, 0, nearest)], axis=-1)
    return index, (surface - spheres[index, :3]) / spheres[index, 3:]
