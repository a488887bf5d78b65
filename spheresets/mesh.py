"""Triangle meshes: read from a file, checked, in the file's own coordinates."""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.core.files import sha256
from coslobe.spheresets.obj import read_obj
from coslobe.spheresets.orientation import coincident
from coslobe.spheresets.ply import read_ply
from coslobe.spheresets.stl import read_stl

SUFFIXES = (".ply", ".obj", ".stl", ".glb", ".gltf")
UNREADABLE = {"KHR_draco_mesh_compression", "EXT_meshopt_compression"}
BLOCK = 1 << 20  # triangles at a time: bounds the memory for what is only needed for a moment
SAMPLE_BUNNY = "sample:bunny"

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
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
    defects : tuple of str
        What reading had to leave out.
    """

    vertices: NDArray[np.float64]
    faces: NDArray[np.int32]
    normals: NDArray[np.float64]
    file: str
    sha256: str
    uv: NDArray[np.float64] | None = None
    defects: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """The file's name without folder and suffix; "bunny" for "sample:bunny"."""
        return self.file.removeprefix("sample:") if self.file == SAMPLE_BUNNY else Path(self.file).stem

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Lower and upper corner of the bounding box of the triangles, [2, 3]."""
        used = np.zeros(len(self.vertices), bool)
        used[self.faces] = True
        return np.stack([self.vertices[used].min(0), self.vertices[used].max(0)])

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
        The file is missing, broken or empty.
    """
    if str(source) == SAMPLE_BUNNY:
        return _sample_bunny()
    path = Path(source)
    if path.suffix.lower() not in SUFFIXES:
        raise InvalidInput(f"{path}: not a mesh file type that can be read", f"use {', '.join(SUFFIXES)}")
    digest = sha256(path)
    vertices, faces, normals, uv, defects = _triangles(path)
    return Mesh(vertices, faces, normals, str(source), digest, uv, defects)


def blocks(count: int) -> Iterator[slice]:
    """The slices that cut `count` triangles into blocks."""
    for start in range(0, count, BLOCK):
        yield slice(start, start + BLOCK)


def counted(count: int, one: str, many: str = "", end: str = "") -> tuple[str, ...]:
    """As in "1 hole" or "12 duplicate vertices merged"; nothing for none."""
    return (f"{count:,} {one if count == 1 else many or one + 's'}{end}",) if count else ()


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
    vertices, faces, normals, uv, _ = _triangles(path)
    lower, upper = vertices.min(0), vertices.max(0)
    origin = np.array([(lower[0] + upper[0]) / 2, lower[1], (lower[2] + upper[2]) / 2])
    return Mesh((vertices - origin) / (upper - lower).max(), faces, normals, SAMPLE_BUNNY, digest, uv)


def _triangles(path: Path) -> tuple[Array, NDArray[np.int32], Array, Array | None, tuple[str, ...]]:
    """Vertices, faces, unit normals, texture coordinates, and what was left out."""
    readers = {".ply": read_ply, ".obj": read_obj, ".stl": read_stl}
    try:
        vertices, faces, normals, uv = readers.get(path.suffix.lower(), _read_gltf)(path)
    except Exception as error:  # readers raise whatever their format makes them stumble over
        reason = str(error) if type(error) is ValueError else f"{type(error).__name__}: {error}"
        raise InvalidInput(f"{path}: cannot be read as a mesh ({reason})", "export the mesh again") from error
    if not len(faces):
        raise InvalidInput(f"{path}: holds no triangles", "export surfaces, not points or lines")
    if faces.min() < 0 or faces.max() >= len(vertices):
        raise InvalidInput(
            f"{path}: a triangle refers to a vertex that does not exist (the file has {len(vertices)})",
            "export the mesh again",
        )
    faces = faces.astype(np.int32, copy=False)
    defects = ()
    broken = ~np.isfinite(vertices).all(1)
    if broken.any():
        faces = faces[~broken[faces].any(1)]
        first = int(np.flatnonzero(broken)[0])
        if not len(faces):
            raise InvalidInput(
                f"{path}: vertex {first} is not finite ({' '.join(map(str, vertices[first]))})",
                "remove or repair the vertex: no triangle is left without it",
            )
        vertices[broken] = vertices[faces[0, 0]]
        defects = counted(int(broken.sum()), "vertex", "vertices", " not finite, left out with its triangles")
    if not any(np.ptp(vertices[:, k][faces]) for k in range(3)):
        raise InvalidInput(f"{path}: all triangles are one point", "export the mesh again")
    length = np.linalg.norm(normals, axis=1)
    missing = ~(np.isfinite(length) & (length > 0))
    if missing.any():
        normals[missing] = angle_weighted_normals(vertices, faces)[missing]
        length[missing] = 1
    normals /= length[:, None]
    return vertices, faces, normals, uv if np.isfinite(uv).any() else None, defects


def _read_gltf(path: Path) -> tuple[Array, NDArray[np.int64], Array, Array]:
    """Vertices, faces, normals (0 where the file has none) and uv (else NaN) of all nodes, put in place.

    Joints and morph targets stay in their rest pose.

    Raises
    ------
    ValueError
        The file has what trimesh would leave out without a word.
    """
    import trimesh

    _check_gltf(path)
    # Vertices keep the file's order and count: merging would lose normals at creases.
    scene = trimesh.load_scene(path, process=False)
    parts = [_placed(scene, node) for node in scene.graph.nodes_geometry]
    parts = [part for part in parts if part is not None]
    if not parts:
        return np.zeros((0, 3)), np.zeros((0, 3), np.int64), np.zeros((0, 3)), np.zeros((0, 2))
    offsets = np.cumsum([0] + [len(vertices) for vertices, _, _, _ in parts])
    vertices, faces, normals, uv = zip(*parts, strict=True)
    faces = [part + offset for part, offset in zip(faces, offsets, strict=False)]
    return np.concatenate(vertices), np.concatenate(faces), np.concatenate(normals), np.concatenate(uv)


def _check_gltf(path: Path) -> None:
    with open(path, "rb") as file:
        if file.read(4) == b"glTF":
            header = file.read(16)
            length = struct.unpack("<I", header[8:12])[0] if len(header) == 16 else 0
            text = file.read(min(length, path.stat().st_size))
        else:
            text = path.read_bytes()
    document = json.loads(text)
    accessors = document.get("accessors", [])
    if extra := sorted(set(document.get("extensionsRequired", [])) & UNREADABLE):
        raise ValueError(f"is compressed with {extra[0]}; export it without")
    for mesh in document.get("meshes", []):
        for primitive in mesh["primitives"]:
            if primitive.get("mode", 4) == 6:
                raise ValueError("has a triangle fan; export triangles")
            used = [primitive["attributes"].get("POSITION"), primitive.get("indices")]
            if any("sparse" in accessors[k] for k in used if k is not None):
                raise ValueError("has sparse accessors for positions or indices; export it without")


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


def angle_weighted_normals(vertices: Array, faces: NDArray[np.int32]) -> Array:
    """Unit normals [n, 3]: face normals averaged with the angle that each face has at the vertex.

    Coincident vertices share one normal. Where nothing is left (a vertex without a face, faces that cancel)
    the normal is (0, 1, 0).
    """
    place, places = coincident(vertices)
    scale = float(np.abs(vertices).max()) or 1.0  # squares of very small or large coordinates would not fit
    total = np.zeros((places, 3))
    for part in blocks(len(faces)):
        corners = place[faces[part]]
        p = vertices[faces[part]] / scale
        normal = np.cross(p[:, 1] - p[:, 0], p[:, 2] - p[:, 0])
        length = np.linalg.norm(normal, axis=1, keepdims=True)
        normal = np.divide(normal, length, out=np.zeros_like(normal), where=length > 0)
        for k in range(3):
            u, v = p[:, (k + 1) % 3] - p[:, k], p[:, (k + 2) % 3] - p[:, k]
            angle = np.arctan2(length[:, 0], (u * v).sum(1))
            for axis in range(3):
                total[:, axis] += np.bincount(corners[:, k], normal[:, axis] * angle, minlength=places)
    length = np.linalg.norm(total, axis=1)
    total[length < 1e-12] = (0.0, 1.0, 0.0)
    total /= np.where(length < 1e-12, 1, length)[:, None]
    return total[place]
