"""What the formats allow and exporters write; files that are cut short, lie, or are noise."""

import base64
import json
import struct
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.mesh import load_mesh
from coslobe.spheresets.polygons import split_polygons

CORNERS = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (0, 0, 1), (1, 0, 1), (1, 1, 1), (0, 1, 1)]
QUADS = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (3, 7, 6, 2), (0, 4, 7, 3), (1, 2, 6, 5)]
MIXED = [(0, 3, 2), (0, 2, 1), *QUADS[1:]]
VERTICES = "".join("v {} {} {}\n".format(*corner) for corner in CORNERS)


def load(folder: Path, name: str, content: str | bytes):
    path = folder / name
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return load_mesh(path)


def exported(part: trimesh.Trimesh, kind: str, **options) -> bytes:
    content: Any = part.export(file_type=kind, **options)
    return content.encode() if isinstance(content, str) else content


def volume(mesh) -> float:
    """Signed: positive where triangles are oriented outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("nd,nd->", a, np.cross(b, c)) / 6)


def ply(encoding: str, faces, *, number: str = "float", index: str = "vertex_indices") -> bytes:
    """A cube with colours on vertices, a second list and a flag on faces, and an element of no interest."""
    header = (
        f"ply\nformat {encoding} 1.0\ncomment by hand\nelement note 1\nproperty list uchar short words\n"
        f"element vertex 8\nproperty {number} x\nproperty {number} y\nproperty {number} z\n"
        "property uchar red\n"
        f"element face {len(faces)}\nproperty list uchar int {index}\nproperty list uchar float uv\n"
        "property uchar flag\nelement edge 0\nproperty int a\nend_header\n"
    )
    rows = [("Bhh", 2, 7, 8)]
    rows += [("dddB" if number == "double" else "fffB", *corner, 255) for corner in CORNERS]
    rows += [(f"B{len(f)}iB2fB", len(f), *f, 2, 0.5, 0.25, 9) for f in faces]
    if encoding == "ascii":
        return header.encode() + "".join(" ".join(map(str, row[1:])) + "\n" for row in rows).encode()
    order = ">" if "big" in encoding else "<"
    return header.encode() + b"".join(struct.pack(order + row[0], *row[1:]) for row in rows)


@pytest.mark.parametrize("faces", [QUADS, MIXED], ids=["quads", "mixed"])
@pytest.mark.parametrize("encoding", ["ascii", "binary_little_endian", "binary_big_endian"])
@pytest.mark.parametrize(("number", "index"), [("float", "vertex_indices"), ("double", "vertex_index")])
def test_ply(tmp_path, encoding, faces, number, index):
    mesh = load(tmp_path, "cube.ply", ply(encoding, faces, number=number, index=index))
    np.testing.assert_array_equal(mesh.vertices, CORNERS)
    assert len(mesh.faces) == 12
    assert volume(mesh) == pytest.approx(1)


def test_ply_normals(tmp_path):
    ball = trimesh.creation.icosphere(subdivisions=1)
    mesh = load(tmp_path, "ball.ply", exported(ball, "ply", vertex_normal=True))
    np.testing.assert_allclose(mesh.normals, ball.vertex_normals, atol=1e-6)


@pytest.mark.parametrize("kind", ["stl", "stl_ascii"])
def test_corners_of_stl_triangles_become_one_vertex(tmp_path, kind):
    mesh = load(tmp_path, "box.stl", exported(trimesh.creation.box(), kind))
    assert (len(mesh.vertices), len(mesh.faces)) == (8, 12)
    assert volume(mesh) == pytest.approx(1)


OBJ = {
    "quads": VERTICES + "".join("f {} {} {} {}\n".format(*(k + 1 for k in quad)) for quad in QUADS),
    "all kinds of corners": VERTICES + "vt 0 0\nvn 0 0 1\nf 1/1 4/1 3/1 2/1\nf 5/1/1 6/1/1 7/1/1 8/1/1\n"
    "f 1//1 2//1 6//1 5//1\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6\n",
    "groups, materials, comments, lines, Windows": "# a\nmtllib gone.mtl\no a\n"
    + VERTICES.replace("\n", "\r\n")
    + "g b\nusemtl x\ns off\nf 1 4 3 2\nf 5 6 7 8\n\nl 1 2\ng c\nf 1 2 6 5 # d\n"
    + "f 4 8 \\\n 7 3\nf 1 5 8 4\nusemtl y\nf 2 3 7 6\n",
    "colours and weights": "".join("v {} {} {} 1 0.5 0\n".format(*corner) for corner in CORNERS)
    + "".join("f {} {} {} {}\n".format(*(k + 1 for k in quad)) for quad in QUADS),
    # Each face follows its own corners and counts back from there.
    "negative indices": "".join(
        "".join("v {} {} {}\n".format(*CORNERS[k]) for k in quad) + "f -4 -3 -2 -1\n" for quad in QUADS
    ),
}  # fmt: skip


@pytest.mark.parametrize("kind", OBJ)
def test_obj(tmp_path, kind):
    mesh = load(tmp_path, "cube.obj", OBJ[kind])
    assert len(mesh.faces) == 12
    assert volume(mesh) == pytest.approx(1)


def test_obj_normals_split_a_vertex(tmp_path):
    text = VERTICES + "vn 0 0 -1\nvn 0 0 1\nvn 1 0 0\nf 1//1 4//1 3//1 2//1\nf 2//-1 3//-1 7//-1 6//-1\n"
    mesh = load(tmp_path, "sides.obj", text)
    assert len(mesh.vertices) == 8  # two faces of four corners each
    for face in mesh.faces:
        a, b, c = mesh.vertices[face]
        normal = np.cross(b - a, c - a)
        np.testing.assert_allclose(mesh.normals[face], np.tile(normal / np.linalg.norm(normal), (3, 1)))


def star(points: int) -> np.ndarray:
    angle = np.arange(2 * points) * np.pi / points
    return (
        np.stack([np.cos(angle), np.sin(angle)], axis=1)
        * np.where(np.arange(2 * points) % 2, 0.3, 1)[:, None]
    )


POLYGONS = {
    "hexagon": np.stack([np.cos(np.arange(6) * np.pi / 3), np.sin(np.arange(6) * np.pi / 3)], axis=1),
    "arrow": np.array([[0, 0], [2, 1], [0, 2], [0.7, 1]]),
    "arrow, turned": np.array([[2, 1], [0, 2], [0.7, 1], [0, 0]]),
    "L": np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]),
    "star": star(7),
    "comb": np.array([[0, 0], [6, 0], [6, 2], [5, 0.5], [4, 2], [3, 0.5], [2, 2], [1, 0.5], [0, 2]]),
    "corner on an edge": np.array([[0, 0], [1, 0], [2, 0], [2, 2], [1, 1], [0, 2]]),
}


@pytest.mark.parametrize("mirrored", [False, True])
@pytest.mark.parametrize("shape", POLYGONS)
def test_polygons_are_filled_once(shape, mirrored):
    """Triangles of one orientation whose areas add up to the polygon's cover it without overlaps."""
    flat = POLYGONS[shape][::-1] if mirrored else POLYGONS[shape]
    u, v = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0][:2]
    points = flat[:, :1] * u + flat[:, 1:] * v + [3, 4, 5]
    faces = split_polygons(points, np.arange(len(points)), np.array([len(points)]))
    assert faces.shape == (len(points) - 2, 3)
    a, b, c = (flat[faces[:, k]] for k in range(3))
    areas = ((b - a) * (c - a)[:, ::-1] * [1, -1]).sum(1) / 2
    x, y = flat.T
    whole = (x * np.roll(y, -1) - y * np.roll(x, -1)).sum() / 2
    assert areas.sum() == pytest.approx(whole)
    assert (areas * np.sign(whole) > -1e-12).all()


def gltf(**changes) -> dict:
    """A tetrahedron in two primitives; as it is, and in a child of a node twice as large and moved."""
    positions = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], np.float32).tobytes()
    indices = np.array([0, 2, 1, 0, 1, 3, 0, 3, 2, 1, 2, 3], np.uint16).tobytes()
    data = base64.b64encode(positions + indices).decode()
    position = {
        "bufferView": 0,
        "componentType": 5126,
        "count": 4,
        "type": "VEC3",
        "min": [0] * 3,
        "max": [1] * 3,
    }
    half = {"bufferView": 1, "componentType": 5123, "count": 6, "type": "SCALAR"}
    parts = [{"attributes": {"POSITION": 0}, "indices": k} for k in (1, 2)]
    return {
        "asset": {"version": "2.0"},
        "scene": 0,
        "scenes": [{"nodes": [0, 1]}],
        "nodes": [{"mesh": 0}, {"children": [2], "translation": [5, 0, 0]}, {"mesh": 0, "scale": [2, 2, 2]}],
        "meshes": [{"primitives": parts}],
        "accessors": [position, half, {**half, "byteOffset": 12}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": 0, "byteLength": 48},
            {"buffer": 0, "byteOffset": 48, "byteLength": 24},
        ],
        "buffers": [{"byteLength": 72, "uri": f"data:application/octet-stream;base64,{data}"}],
        **changes,
    }


def test_gltf_with_nodes_and_primitives(tmp_path):
    mesh = load(tmp_path, "two.gltf", json.dumps(gltf()))
    assert len(mesh.faces) == 8
    assert volume(mesh) == pytest.approx(1 / 6 + 8 / 6)
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [7, 2, 2]])


def test_gltf_with_a_buffer_beside_it(tmp_path):
    document = gltf()
    uri = document["buffers"][0]["uri"]
    (tmp_path / "data.bin").write_bytes(base64.b64decode(uri.split(",")[1]))
    document["buffers"][0]["uri"] = "data.bin"
    assert volume(load(tmp_path, "beside.gltf", json.dumps(document))) == pytest.approx(9 / 6)


def test_rest_poses_of_animated_files(data):
    """Joints and morph targets are left alone; the figures are those of the data sheet."""
    for name, triangles in (("Fox.glb", 576), ("MorphStressTest.gltf", 2412), ("greenman.glb", 356)):
        assert len(load_mesh(data / "meshes" / name).faces) == triangles


def without(document: dict, **first_primitive) -> dict:
    document["meshes"][0]["primitives"][0].update(first_primitive)
    return document


ACCESSOR = gltf()["accessors"][0]
STL = exported(trimesh.creation.icosphere(subdivisions=1), "stl")
PLY = ply("binary_little_endian", MIXED)
REFUSED = {
    "ply of a billion vertices": (
        "a.ply", PLY.replace(b"vertex 8", b"vertex 1000000000"), "holds less than the 1,000,000,000 items of"
    ),
    "ascii ply of a billion faces": (
        "a.ply", ply("ascii", QUADS).replace(b"face 6", b"face 999999999"), "holds less than the 999,999,999"
    ),
    "ply without an end": ("a.ply", b"ply\nformat ascii 1.0\ncomment\n", "header does not end"),
    "ply with an unknown type": ("a.ply", PLY.replace(b"float x", b"quad x"), "unknown type 'quad'"),
    "ply with a wrong index": ("a.ply", PLY.replace(b"vertex 8", b"vertex 7"), "cannot be read"),
    "cut ply": ("a.ply", PLY[:-20], "ends within 'face'"),
    "cut stl": ("a.stl", STL[:-20], "announces 80 triangles, holds 79.6"),
    "cut stl that begins with solid": ("a.stl", b"solid" + STL[5:-20], "announces 80 triangles"),
    "stl of four billion triangles": ("a.stl", STL[:80] + b"\xff" * 4 + STL[84:], "announces 4,294,967,295"),
    "obj index 0": ("a.obj", VERTICES + "f 0 1 2\n", "line 9: index 0 does not exist"),
    "obj index too far back": ("a.obj", VERTICES + "f -9 1 2\n", "line 9: index -9 does not exist"),
    "obj index too high": ("a.obj", VERTICES + "f 1 2 9\n", "refers to vertex 9, but the file has 8"),
    "obj word": ("a.obj", "v 0 0 zero\n", "line 1: 'zero' is no number"),
    "obj half a vertex": ("a.obj", "v 0 0\n", "line 1: 2 coordinates where three are needed"),
    "gltf with sparse positions": (
        "a.gltf", json.dumps(gltf(accessors=[{**ACCESSOR, "sparse": {}}, *gltf()["accessors"][1:]])), "sparse"
    ),
    "gltf with draco": (
        "a.gltf", json.dumps(gltf(extensionsRequired=["KHR_draco_mesh_compression"])), "KHR_draco"
    ),
    "gltf with fans": ("a.gltf", json.dumps(without(gltf(), mode=6)), "triangle fan"),
    "gltf that holds itself": (
        "a.gltf", json.dumps(gltf(nodes=[{}, {"children": [2]}, {"children": [1], "mesh": 0}])), "Iteration"
    ),
    "gltf of a trillion vertices": (
        "a.gltf", json.dumps(gltf(accessors=[{**ACCESSOR, "count": 10**12}] * 3)), "cannot be read"
    ),
    "gltf without its buffer": (
        "a.gltf", json.dumps(gltf(buffers=[{"byteLength": 72, "uri": "gone.bin"}])), "gone.bin"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", REFUSED)
def test_files_that_lie_are_refused_with_the_reason(tmp_path, case):
    name, content, complaint = REFUSED[case]
    with pytest.raises(InvalidInput, match=complaint) as caught:
        load(tmp_path, name, content)
    assert caught.value.hint


WHOLE = {
    "a.ply": [PLY, ply("ascii", MIXED), ply("binary_big_endian", QUADS)],
    "a.obj": [text.encode() for text in OBJ.values()],
    "a.stl": [STL, exported(trimesh.creation.box(), "stl_ascii")],
    "a.glb": [exported(trimesh.creation.box(), "glb")],
    "a.gltf": [json.dumps(gltf()).encode()],
}


@st.composite
def spoilt_files(draw):
    """A file that is noise, or a good one that is cut short, changed in places, or both."""
    name = draw(st.sampled_from(list(WHOLE)))
    if draw(st.integers(0, 4)) == 0:
        return name, draw(st.binary(max_size=300))
    content = bytearray(draw(st.sampled_from(WHOLE[name])))
    for _ in range(draw(st.integers(0, 4))):
        content[draw(st.integers(0, len(content) - 1))] = draw(st.integers(0, 255))
    return name, bytes(content[: draw(st.integers(0, len(content)))] if draw(st.booleans()) else content)


@settings(
    max_examples=300, deadline=None, suppress_health_check=[HealthCheck.too_slow, HealthCheck.data_too_large]
)
@given(spoilt_files())
def test_spoilt_files_are_read_or_refused(tmp_path_factory, spoilt):
    name, content = spoilt
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # numbers that overflow
        try:
            mesh = load(tmp_path_factory.getbasetemp(), name, content)
        except InvalidInput:
            return
    assert np.isfinite(mesh.vertices).all()
    assert mesh.faces.min() >= 0
    assert mesh.faces.max() < len(mesh.vertices)
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-9)
