"""A closed surface of few triangles around the volume of any solid: what exact volumes are summed over."""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

TRIANGLES = 10_000  # where the mesh has more, it is simplified,
MOST_TRIANGLES = 500_000  # but not where it has more than these: that would take minutes
LOST = 0.01  # of the volume, at most, in simplification
OVERLAP = 0.03  # relative difference of volumes above which parts of the mesh overlap
CELLS = 64  # voxels along the longest side
POINTS = 100_000  # for the volume by samples


def closed_surface(solid: Solid) -> tuple[Array, bool]:
    """Corners [m, 3, 3] of a closed surface, normals outwards, and whether it is the mesh itself.

    A closed mesh is simplified by quadric errors (Garland and Heckbert 1997). One that is open, that counts
    some volume twice because parts overlap, or that is huge, is replaced by the faces of the voxels in it.
    """
    if len(solid.faces) > MOST_TRIANGLES:
        return _voxel_faces(solid), False
    corners = solid.triangles
    volume = _volume(corners)
    if not solid.closed or abs(abs(volume) / _sampled_volume(solid) - 1) > OVERLAP:
        return _voxel_faces(solid), False
    corners = corners if volume > 0 else corners[:, ::-1]
    simple = _simplified(corners) if len(corners) > TRIANGLES else corners
    return (simple if abs(_volume(simple) / abs(volume) - 1) < LOST else corners), True


def _volume(corners: Array) -> float:
    return float(np.linalg.det(corners).sum() / 6)


def _sampled_volume(solid: Solid) -> float:
    points = np.random.default_rng(0).uniform(solid.lower, solid.upper, (POINTS, 3))
    return float(np.prod(solid.upper - solid.lower) * max(solid.inside(points).mean(), 1 / POINTS))


def _simplified(corners: Array) -> Array:
    """About TRIANGLES triangles, or the same where that would open the surface."""
    import open3d

    vertices = open3d.utility.Vector3dVector(corners.reshape(-1, 3))
    faces = open3d.utility.Vector3iVector(np.arange(3 * len(corners), dtype=np.int32).reshape(-1, 3))
    mesh = open3d.geometry.TriangleMesh(vertices, faces).remove_duplicated_vertices()
    if not mesh.is_edge_manifold(allow_boundary_edges=False):
        return corners
    mesh = mesh.simplify_quadric_decimation(TRIANGLES)
    if not mesh.is_edge_manifold(allow_boundary_edges=False):
        return corners
    return np.asarray(mesh.vertices)[np.asarray(mesh.triangles)]


def _voxel_faces(solid: Solid) -> Array:
    """The faces, two triangles each, between voxels whose centers are inside and others."""
    step = (solid.upper - solid.lower).max() / CELLS
    shape = np.ceil((solid.upper - solid.lower) / step).astype(int) + 2  # a frame of empty ones around
    origin = (solid.lower + solid.upper) / 2 - shape * step / 2
    cells = np.stack(np.meshgrid(*map(np.arange, shape), indexing="ij"), axis=-1)
    inside = solid.inside(origin + (cells.reshape(-1, 3) + 0.5) * step).reshape(shape)
    quads = []
    for axis in range(3):
        ahead = np.roll(inside, -1, axis)  # the frame is empty, so nothing comes in from the other end
        u, v = np.eye(3)[(axis + 1) % 3], np.eye(3)[(axis + 2) % 3]
        square = np.array([0 * u, u, u + v, v])  # counter-clockwise seen from ahead
        for leaving, turn in ((inside & ~ahead, 1), (~inside & ahead, -1)):
            base = np.argwhere(leaving) + np.eye(3)[axis]
            quads.append(base[:, None] + square[::turn])
    corners = origin + step * np.concatenate(quads)
    return np.concatenate([corners[:, [0, 1, 2]], corners[:, [0, 2, 3]]])
