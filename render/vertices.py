"""Shading at mesh vertices: which points that are, the picture between them, and the file of them."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError
from coslobe.core.files import atomic_path
from coslobe.render.gbuffer import GBuffer
from coslobe.render.images import srgb
from coslobe.render.surface import OnObjects, with_surface

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.scene import Scene


def vertex_points(scene: "Scene", assets: "Assets") -> GBuffer:
    """Every vertex of the visible objects, in the order of the scene file, as points to be shaded.

    Their normal is both the geometric and the shading normal, turned to the viewer; their triangle is one of
    those around them. Pixels only number them.
    """
    eye = np.asarray(scene.camera.look_at.origin, np.float64)
    materials = {name: index for index, name in enumerate(scene.materials)}
    parts = []
    for index, obj in enumerate(scene.objects.values()):
        if obj.visible:
            mesh, matrix = assets.mesh(obj), obj.transform.matrix()
            position = mesh.vertices @ matrix[:3, :3].T + matrix[:3, 3]
            normal = _unit(mesh.normals @ np.linalg.inv(matrix[:3, :3]))
            indices = np.full((len(position), 4), (index, materials[obj.material], 0, 0))
            corners = np.arange(mesh.faces.size)
            indices[mesh.faces.ravel(), 2:] = np.stack(np.divmod(corners, 3), axis=1)
            parts.append((position, normal, indices))
    empty = [(np.empty((0, 3)), np.empty((0, 3)), np.empty((0, 4), int))]
    position, normal, indices = (np.concatenate(column) for column in zip(*(parts or empty), strict=True))
    n = len(position)
    to_eye = eye - position
    distance = np.linalg.norm(to_eye, axis=1)
    view = to_eye / np.maximum(distance, np.finfo(float).tiny)[:, None]
    normal = normal * np.where(np.einsum("ij,ij->i", normal, view) < 0, -1.0, 1.0)[:, None]
    points = GBuffer(
        position=position,
        geometric_normal=normal,
        shading_normal=normal,
        view=view,
        object=indices[:, 0].astype(np.int32),
        material=indices[:, 1].astype(np.int32),
        pixel=np.arange(n, dtype=np.int32),
        depth=distance,
        triangle=indices[:, 2].astype(np.int32),
        weights=np.eye(3)[indices[:, 3]],
        width=max(int(np.ceil(np.sqrt(n))), 1),
        height=1,
        samples=1,
    )
    return with_surface(points, scene, assets)


def interpolate(scene: "Scene", assets: "Assets", seen: OnObjects, values: NDArray) -> NDArray:
    """`values` [m, c] of the vertices between them, at the points of `seen`: float64 [n, c]."""
    between = np.zeros((len(seen), values.shape[1]))
    first = 0
    for index, obj in enumerate(scene.objects.values()):
        if obj.visible:
            mesh = assets.mesh(obj)
            here, triangle, weights = seen.on(index)
            between[here] = np.einsum("nk,nkc->nc", weights, values[first + mesh.faces[triangle]])
            first += len(mesh.vertices)
    return between


def write_vertices(path: Path, scene: "Scene", assets: "Assets", points: GBuffer, radiance: NDArray) -> None:
    """A binary PLY file in world coordinates, atomically.

    Per vertex float32 x, y, z, nx, ny, nz, the radiance towards the viewer as radiance_r, radiance_g,
    radiance_b, and its sRGB colour as uchar red, green, blue, which viewers show.

    Raises
    ------
    CoslobeError
        A radiance is not finite.
    """
    if not np.isfinite(radiance).all():
        raise CoslobeError(
            f"{path}: not written: some radiance is not finite", "look for extreme values in the scene"
        )
    fields = ("x", "y", "z", "nx", "ny", "nz", "radiance_r", "radiance_g", "radiance_b")
    vertices = np.zeros(
        len(points.position), [*((f, "<f4") for f in fields), *((c, "u1") for c in ("red", "green", "blue"))]
    )
    columns = np.concatenate([points.position, points.shading_normal, radiance], axis=1)
    for name, column in zip(fields, columns.T, strict=True):
        vertices[name] = column
    for name, column in zip(("red", "green", "blue"), np.rint(srgb(radiance) * 255).T, strict=True):
        vertices[name] = column
    faces, first = [np.empty((0, 3), np.int32)], 0
    for obj in scene.objects.values():
        if obj.visible:
            mesh = assets.mesh(obj)
            faces.append(mesh.faces + first)
            first += len(mesh.vertices)
    corners = np.concatenate(faces)
    triangles = np.zeros(len(corners), [("count", "u1"), ("corners", "<i4", (3,))])
    triangles["count"], triangles["corners"] = 3, corners
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(vertices)}"]
    header += [f"property float {name}" for name in fields]
    header += [f"property uchar {name}" for name in ("red", "green", "blue")]
    header += [f"element face {len(triangles)}", "property list uchar int vertex_indices", "end_header", ""]
    with atomic_path(path) as temporary:
        temporary.write_bytes("\n".join(header).encode() + vertices.tobytes() + triangles.tobytes())


def _unit(vectors: NDArray) -> NDArray:
    return vectors / np.maximum(np.linalg.norm(vectors, axis=1, keepdims=True), np.finfo(float).tiny)
