"""Triangle meshes: read from a file, checked, in the file's own coordinates."""

from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.core.files import sha256

SUFFIXES = (".ply", ".obj", ".stl", ".glb", ".gltf")
SAMPLE_BUNNY = "sample:bunny"


@dataclass(frozen=True)
class Mesh:
    """Triangles with a normal per vertex.

    Attributes
    ----------
    vertices : float64 [n, 3]
        Coordinates of the file (glTF: after its node transforms). Vertices that differ only in normal or
        texture coordinate stay apart.
    faces : int32 [m, 3]
    normals : float64 [n, 3]
        Unit length: the file's where it has them, else angle-weighted averages over coincident vertices.
    file : str
        As given: a path, or "sample:bunny".
    sha256 : str
        Hash of the file's bytes.
    uv : float64 [n, 2] or None
        Texture coordinates, v up; NaN where a part of the file has none, None where no part has any.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64]
    file: str
    sha256: str
    uv: NDArray[np.float64] | None = None

    @property
    def name(self) -> str:
        """The file's name without folder and suffix; "bunny" for "sample:bunny"."""
        return self.file.removeprefix("sample:") if self.file == SAMPLE_BUNNY else Path(self.file).stem

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lower and upper corner of the bounding box of the triangles, [2, 3]."""
        used = self.vertices[self.faces.reshape(-1)]
        return np.stack([used.min(0), used.max(0)])

    @property
    def diagonal(self) -> float:
        """Length of the bounding box's diagonal."""
        lower, upper = self.bounds
        return float(np.linalg.norm(upper - lower))


def load_mesh(source: str | Path) -> Mesh:
    """Read PLY, OBJ, STL, GLB or glTF; polygons are split into triangles, glTF nodes are put in place.

    `sample:bunny` is the bunny that comes with pymeshlab, scaled so that its longest side is 1, centred in
    x and z, standing on y = 0.

    Raises
    ------
    InvalidInput
        The file is missing, broken or empty, or has coordinates that are not finite.
    """
    if str(source) == SAMPLE_BUNNY:
        return _sample_bunny()
    path = Path(source)
    if path.suffix.lower() not in SUFFIXES:
        raise InvalidInput(f"{path}: not a mesh file type that can be read", f"use {', '.join(SUFFIXES)}")
    digest = sha256(path)
    vertices, faces, normals, uv = _triangles(path)
    return Mesh(vertices, faces, normals, str(source), digest, uv)


def _sample_bunny() -> Mesh:
    package = find_spec("pymeshlab")  # found, not imported: that would load Qt
    folders = list(package.submodule_search_locations or ()) if package else []
    paths = [Path(folder, "tests", "sample_meshes", "bunny.obj") for folder in folders]
    path = next((path for path in paths if path.is_file()), None)
    if path is None:
        raise CoslobeError(
            f"{SAMPLE_BUNNY}: the installed pymeshlab does not contain the bunny", "pip install pymeshlab"
        )
    digest = sha256(path)
    vertices, faces, normals, uv = _triangles(path)
    lower, upper = vertices.min(0), vertices.max(0)
    origin = np.array([(lower[0] + upper[0]) / 2, lower[1], (lower[2] + upper[2]) / 2])
    return Mesh((vertices - origin) / (upper - lower).max(), faces, normals, SAMPLE_BUNNY, digest, uv)


def _triangles(
    path: Path,
) -> tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.float64], NDArray[np.float64] | None]:
    import trimesh

    try:
        # Vertices keep the file's order and count: merging would lose normals at creases.
        scene = trimesh.load_scene(path, process=False)
    except Exception as error:  # the readers raise whatever their format makes them stumble over
        reason = f"{type(error).__name__}: {error}" if str(error) else type(error).__name__
        raise InvalidInput(f"{path}: cannot be read as a mesh ({reason})", "export the mesh again") from error

    parts = [_placed(scene, node) for node in scene.graph.nodes_geometry]
    parts = [part for part in parts if part is not None]
    if not parts:
        raise InvalidInput(f"{path}: holds no triangles", "export surfaces, not points or lines")
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _, _ in parts])
    vertices = np.concatenate([vertices for vertices, _, _, _ in parts])
    faces = np.concatenate([faces + offset for (_, faces, _, _), offset in zip(parts, offsets, strict=False)])
    normals = np.concatenate([normals for _, _, normals, _ in parts])
    uv = np.concatenate([uv for _, _, _, uv in parts])

    if faces.min() < 0 or faces.max() >= len(vertices):
        face = int(np.flatnonzero(((faces < 0) | (faces >= len(vertices))).any(1))[0])
        raise InvalidInput(
            f"{path}: triangle {face} refers to a vertex that does not exist (the file has {len(vertices)})",
            "export the mesh again",
        )
    broken = np.flatnonzero(~np.isfinite(vertices).all(1))
    if broken.size:
        raise InvalidInput(
            f"{path}: vertex {broken[0]} is not finite ({' '.join(map(str, vertices[broken[0]]))})",
            "remove or repair the vertex",
        )
    if not np.ptp(vertices[faces.reshape(-1)], axis=0).any():
        raise InvalidInput(f"{path}: all triangles are one point", "export the mesh again")
    missing = ~(np.isfinite(normals).all(1) & (np.linalg.norm(normals, axis=1) > 0))
    if missing.any():
        normals[missing] = angle_weighted_normals(vertices, faces)[missing]
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return vertices, faces.astype(np.int32), normals, uv if np.isfinite(uv).any() else None


def _placed(scene: Any, node: str) -> tuple[NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]] | None:
    """Vertices, faces, the file's normals (else 0) and uv (else NaN) of one node in scene coordinates."""
    import trimesh

    transform, name = scene.graph[node]
    geometry = scene.geometry[name]
    if not isinstance(geometry, trimesh.Trimesh) or len(geometry.faces) == 0:
        return None
    vertices = np.array(geometry.vertices, np.float64)
    faces = np.array(geometry.faces, np.int64)
    # trimesh computes normals on demand; only those in its cache before that came from the file.
    stored = "vertex_normals" in geometry._cache
    normals = np.array(geometry.vertex_normals if stored else np.zeros_like(vertices), np.float64)
    linear = transform[:3, :3]
    if not np.array_equal(transform, np.eye(4)):
        vertices = vertices @ linear.T + transform[:3, 3]
        # Normals transform with the cofactors, which exist for any matrix, mirrored ones included.
        normals = normals @ _cofactors(linear).T
        if np.linalg.det(linear) < 0:
            faces = faces[:, ::-1]
            normals = -normals
    uv = getattr(geometry.visual, "uv", None)
    uv = np.full((len(vertices), 2), np.nan) if uv is None else np.array(uv, np.float64)[:, :2]
    return vertices, faces, normals, uv


def _cofactors(m: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c = m.T
    return np.stack([np.cross(b, c), np.cross(c, a), np.cross(a, b)], axis=1)


def angle_weighted_normals(vertices: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.float64]:
    """Unit normals [n, 3]: face normals averaged with the angle that each face has at the vertex.

    Coincident vertices share one normal. Where nothing is left (a vertex without a face, faces that cancel)
    the normal is (0, 1, 0).
    """
    unique, index = np.unique(vertices, axis=0, return_inverse=True)
    index = index.reshape(-1)
    corners = index[faces]
    p = unique[corners]
    normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
    length = np.linalg.norm(normal, axis=1, keepdims=True)
    normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
    total = np.zeros_like(unique)
    for k in range(3):
        u, v = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
        angle = np.arctan2(np.linalg.norm(np.cross(u, v), axis=1), (u * v).sum(1))
        np.add.at(total, corners[:, k], normal * angle[:, None])
    total[np.linalg.norm(total, axis=1) < 1e-12] = (0.0, 1.0, 0.0)
    total /= np.linalg.norm(total, axis=1, keepdims=True)
    return total[index]
