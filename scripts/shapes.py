"""Makes the shapes and textures of the shipped scenes: `python scripts/shapes.py`. All are our own formulas.

Shapes are glTF files with normals and texture coordinates, about one unit in size, standing on y = 0.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import trimesh
from numpy.typing import NDArray
from PIL import Image

CONFIGS = Path(__file__).resolve().parent.parent / "configs"
Array = NDArray[np.float64]
Surface = Callable[[Array, Array], Array]


def surface(of: Surface, columns: int, rows: int) -> trimesh.Trimesh:
    """The closed surface of(u, v), u and v in [0, 1], facing outwards, standing on y = 0."""
    u, v = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    points = of(u, v)
    index = np.arange(u.size).reshape(u.shape)
    a, b, c, d = (part.ravel() for part in (index[:-1, :-1], index[:-1, 1:], index[1:, 1:], index[1:, :-1]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    step = 1e-4
    along, up = (of(u + du, v + dv) - of(u - du, v - dv) for du, dv in ((step, 0 * v), (0 * u, step)))
    normals = np.cross(along, up).reshape(-1, 3)
    points = points.reshape(-1, 3)
    points[:, 1] -= points[:, 1].min()
    points = np.round(points, 6) + 0.0  # seams meet to the last bit
    corners = points[faces]
    sizes = np.linalg.norm(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]), axis=1)
    faces = faces[sizes > 1e-12]  # the poles' triangles have no area
    length = np.linalg.norm(normals, axis=1, keepdims=True)
    poles = np.where(points[:, 1:2] > points[:, 1].mean(), 1.0, -1.0) * [0, 1, 0]
    normals = np.where(length > 1e-14, normals / np.maximum(length, 1e-14), poles)
    shape = trimesh.Trimesh(points, faces, vertex_normals=normals, process=False)
    if shape.volume < 0:
        shape = trimesh.Trimesh(points, faces[:, ::-1], vertex_normals=-normals, process=False)
    shape.visual = trimesh.visual.TextureVisuals(uv=np.stack([u, v], -1).reshape(-1, 2))
    return shape


def ring(u: Array, v: Array, radius: Array | float, height: Array | float) -> Array:
    """Points at `radius` from the vertical axis."""
    angle = -2 * np.pi * u
    return np.stack([radius * np.cos(angle), height + 0 * u, radius * np.sin(angle)], axis=-1)


def ball(u: Array, v: Array) -> Array:
    return ring(u, v, 0.5 * np.sin(np.pi * v), -0.5 * np.cos(np.pi * v))


def torus(u: Array, v: Array) -> Array:
    return ring(u, v, 0.36 + 0.14 * np.cos(2 * np.pi * v), 0.14 * np.sin(2 * np.pi * v))


def vase(u: Array, v: Array) -> Array:
    """Closed at both ends: a foot, a belly, a neck, a lip."""
    t = np.clip(v, 0, 1)
    profile = 0.16 + 0.2 * np.sin(np.pi * t**0.8) ** 2 - 0.1 * t + 0.12 * np.exp(-(((t - 1) / 0.08) ** 2))
    ends = np.sqrt(np.clip(1 - (2 * t - 1) ** 24, 0, 1))
    return ring(u, v, profile * ends, t)


def drop(u: Array, v: Array) -> Array:
    """A ball drawn out into a tip."""
    t = np.pi * np.clip(v, 0, 1)
    return ring(u, v, 0.42 * np.sin(t) * np.sin(t / 2) ** 1.0, 0.5 + 0.5 * np.cos(t))


def knot(u: Array, v: Array) -> Array:
    """A tube around the trefoil."""
    s = 2 * np.pi * u

    def line(s: Array) -> Array:
        return 0.155 * np.stack(
            [np.sin(s) + 2 * np.sin(2 * s), np.cos(s) - 2 * np.cos(2 * s), -np.sin(3 * s)], -1
        )

    tangent = line(s + 1e-4) - line(s - 1e-4)
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    across = np.cross(tangent, [0.0, 0.0, 1.0])
    across /= np.linalg.norm(across, axis=-1, keepdims=True)
    around = 2 * np.pi * v[..., None]
    return line(s) + 0.09 * (np.cos(around) * across + np.sin(around) * np.cross(tangent, across))


def room() -> trimesh.Trimesh:
    """A box that is open towards +z, its walls facing inwards; 4 wide, 3 high, 4 deep, its floor in y = 0."""
    corners = np.array([[x, y, z] for x in (-2, 2) for y in (0, 3) for z in (-2, 2)], float)
    walls = [(0, 4, 5, 1), (2, 3, 7, 6), (0, 1, 3, 2), (4, 6, 7, 5), (0, 2, 6, 4)]
    vertices = corners[np.array(walls).ravel()]
    first = 4 * np.arange(len(walls))[:, None]
    faces = np.concatenate([first + np.array([0, 2, 1]), first + np.array([0, 3, 2])])
    return trimesh.Trimesh(vertices, faces, process=False)


def tiles(size: int) -> tuple[NDArray, NDArray]:
    """Inlaid tiles: a colour map and a map of what is metal (1), polished stone (1/4), and joint (0)."""
    y, x = (np.mgrid[:size, :size] + 0.5) / size
    column, row = np.floor(x * 4), np.floor(y * 4)
    fx, fy = x * 4 - column - 0.5, y * 4 - row - 0.5
    star = np.hypot(fx, fy) * (1 + 0.2 * np.cos(8 * np.arctan2(fy, fx))) < 0.24
    joint = np.maximum(abs(fx), abs(fy)) > 0.47
    even = (column + row) % 2 == 0
    veins = 0.06 * np.sin(40 * x + 6 * np.sin(23 * y) + 3 * np.sin(51 * x * y))
    stone = np.where(even[..., None], [0.72, 0.66, 0.55], [0.25, 0.30, 0.33]) + veins[..., None]
    colour = np.where(star[..., None], [0.62, 0.42, 0.16], stone)
    colour = np.where(joint[..., None], 0.12, colour)
    metal = np.where(joint, 0.0, np.where(star, 1.0, 0.25))
    return np.uint8(np.clip(colour, 0, 1) * 255), np.uint8(metal * 255)


def main() -> None:
    shapes = {
        "ball": surface(ball, 48, 24),
        "torus": surface(torus, 64, 24),
        "vase": surface(vase, 48, 48),
        "drop": surface(drop, 48, 32),
        "knot": surface(knot, 192, 16),
        "room": room(),
    }
    for name, shape in shapes.items():
        (CONFIGS / "shapes" / f"{name}.glb").write_bytes(
            trimesh.exchange.gltf.export_glb(shape.scene(), include_normals=name != "room")
        )
    for name, pixels in zip(("tiles", "tiles_metal"), tiles(512), strict=True):
        Image.fromarray(pixels).save(CONFIGS / "textures" / f"{name}.png", optimize=True)


if __name__ == "__main__":
    main()
