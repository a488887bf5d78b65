"""Sphere trees for other programs: Bradshaw's `.sph` and a `.glb` that any viewer opens."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core.files import atomic_path, write_text
from coslobe.spheresets.model import Hierarchy, SphereTree
from coslobe.spheresets.preview import sphere_colors
from coslobe.spheresets.tree import BRANCHING

Array = NDArray[np.float64]

UNUSED = (0.0, 0.0, 0.0, -1.0)
TRIANGLES = 400_000  # that a GLB file may hold before its balls get coarser
FINENESS = (1, 4)  # fewest and most subdivisions of the icosahedra that stand for balls


def write_sph(path: Path, tree: SphereTree) -> None:
    """Write the bounding hierarchy as a sphere tree in the flat order of Bradshaw's toolkit (2002).

    Line 1: levels L and branching B = 4. Then every place of the complete tree, one sphere `x y z r 1` per
    line; the children of line n are B n + 1 to B n + B, counted from 0, and r < 0 marks a place without a
    sphere. The last level holds the finest level's spheres; a sphere that is a leaf further up is its own
    only child down to there, so that each level covers all of them. With N spheres L is log4 N + 1, rounded
    up, and the file has less than 6 N lines.
    """
    rows = _complete_tree(tree.hierarchy, np.column_stack([tree.finest.centers, tree.finest.radii]))
    levels = _levels(tree.hierarchy)
    lines = [f"{levels} {BRANCHING}", *(" ".join(map(repr, row)) + " 1" for row in rows.tolist())]
    write_text(path, "\n".join(lines) + "\n")


def _levels(hierarchy: Hierarchy) -> int:
    """Levels of the tree, root and leaves included."""
    depth = np.ones(len(hierarchy.radii), int)
    for node, (first, count) in enumerate(zip(hierarchy.first_child, hierarchy.child_count, strict=True)):
        depth[first : first + count] = depth[node] + 1  # of nodes; leaves have numbers beyond
    return int(depth.max()) + 1


def _complete_tree(hierarchy: Hierarchy, leaves: Array) -> Array:
    """Spheres [(B^L - 1) / (B - 1), 4] in breadth-first order of the complete tree."""
    m = len(hierarchy.radii)
    spheres = np.vstack([np.column_stack([hierarchy.centers, hierarchy.radii]), leaves])
    level, levels = np.array([0]), []  # numbers of nodes and leaves at the places of a level, -1: unused
    for _ in range(_levels(hierarchy)):
        levels.append(level)
        below = np.full((len(level), BRANCHING), -1)
        nodes, ends = (level >= 0) & (level < m), level >= m
        children = hierarchy.first_child[level[nodes], None] + np.arange(BRANCHING)
        below[nodes] = np.where(
            np.arange(BRANCHING) < hierarchy.child_count[level[nodes], None], children, -1
        )
        below[ends, 0] = level[ends]
        level = below.reshape(-1)
    order = np.concatenate(levels)
    return np.where(order[:, None] < 0, UNUSED, spheres[order])


def write_glb(path: Path, tree: SphereTree) -> None:
    """Write the finest level as one mesh of coloured balls, in the coordinates of the mesh file.

    Corners lie on the spheres. Balls are icosahedra subdivided 4 times, fewer for many spheres (3 from 79,
    2 from 313, 1 from 1,251 on): a viewer should turn 10,000 of them without effort.
    """
    import trimesh
    from trimesh.exchange.gltf import export_glb
    from trimesh.visual.material import PBRMaterial
    from trimesh.visual.texture import TextureVisuals

    finest = tree.finest
    room = int(np.log2(TRIANGLES / (20 * finest.count)) / 2)  # a subdivision makes four triangles of one
    ball = trimesh.creation.icosphere(int(np.clip(room, *FINENESS)))
    corners, faces = np.array(ball.vertices), np.array(ball.faces)
    starts = len(corners) * np.arange(finest.count)
    # glTF keeps colours of corners in linear light.
    colors = np.rint(255 * sphere_colors(finest.count)).astype(np.uint8)
    visual = TextureVisuals(material=PBRMaterial(metallicFactor=0.0, roughnessFactor=0.7))
    visual.vertex_attributes["color"] = np.repeat(
        np.column_stack([colors, np.full(finest.count, 255, np.uint8)]), len(corners), axis=0
    )
    mesh = trimesh.Trimesh(
        (finest.centers[:, None] + finest.radii[:, None, None] * corners).reshape(-1, 3),
        (starts[:, None, None] + faces).reshape(-1, 3),
        vertex_normals=np.tile(corners, (finest.count, 1)),
        visual=visual,
        process=False,
    )
    scene = trimesh.Scene()
    scene.add_geometry(mesh, node_name="spheres", geom_name="spheres")
    with atomic_path(path) as temporary:
        temporary.write_bytes(export_glb(scene, include_normals=True))


FORMATS = {"sph": write_sph, "glb": write_glb}
