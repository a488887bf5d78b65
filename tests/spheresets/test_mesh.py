"""Meshes from files: formats, placement, normals, and messages about files that cannot be used."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.mesh import angle_weighted_normals, load_mesh

CUBE = """\
v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6
"""


def volume(mesh) -> float:
    """Signed: positive where triangles are oriented outwards."""
    a, b, c = (mesh.vertices[mesh.faces[:, k]] for k in range(3))
    return float(np.einsum("nd,nd->", a, np.cross(b, c)) / 6)


def test_quads_become_triangles(tmp_path: Path):
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    mesh = load_mesh(path)
    assert mesh.faces.shape == (12, 3)
    assert mesh.faces.dtype == np.int32
    assert mesh.name == "cube"
    assert volume(mesh) == pytest.approx(1.0)
    np.testing.assert_array_equal(mesh.bounds, [[0, 0, 0], [1, 1, 1]])


def test_a_corner_normal_does_not_depend_on_how_faces_are_split(tmp_path: Path):
    """Angle weights: each of the three faces at a cube's corner counts a right angle, one triangle or two."""
    path = tmp_path / "cube.obj"
    path.write_text(CUBE)
    mesh = load_mesh(path)
    np.testing.assert_allclose(mesh.normals, (mesh.vertices - 0.5) / np.sqrt(0.75), atol=1e-12)


@pytest.mark.parametrize("suffix", [".ply", ".obj", ".stl", ".glb", ".gltf"])
def test_every_format_gives_the_same_solid(tmp_path: Path, suffix: str):
    source = trimesh.creation.icosphere(subdivisions=2).apply_translation([3, 1, -2])
    path = tmp_path / f"ball{suffix}"
    (trimesh.Scene(source) if suffix == ".gltf" else source).export(path)
    mesh = load_mesh(path)
    assert len(mesh.faces) == len(source.faces)
    # float32 in STL, glTF and binary PLY
    assert volume(mesh) == pytest.approx(source.volume, rel=1e-5)
    np.testing.assert_allclose(mesh.bounds, source.bounds, atol=1e-5)
    outwards = ((mesh.vertices - [3, 1, -2]) * mesh.normals).sum(1)
    assert outwards.min() > 0.99
    np.testing.assert_allclose(np.linalg.norm(mesh.normals, axis=1), 1, atol=1e-12)


def test_gltf_nodes_are_put_in_place(tmp_path: Path):
    """A mirrored, stretched node keeps outward triangles and normals that are orthogonal to its surface."""
    scene = trimesh.Scene()
    scene.add_geometry(trimesh.creation.box([1, 1, 1]), node_name="here")
    stretched = np.diag([-2.0, 1.0, 0.5, 1.0])
    stretched[:3, 3] = [5, 0, 0]
    ball = trimesh.creation.icosphere(subdivisions=3)
    ball.vertex_normals  # noqa: B018 - computing them makes trimesh export them
    scene.add_geometry(ball, node_name="there", transform=stretched)
    path = tmp_path / "two.glb"
    scene.export(path, include_normals=True)
    mesh = load_mesh(path)
    np.testing.assert_allclose(mesh.bounds, [[-0.5, -1, -0.5], [7, 1, 0.5]], atol=1e-6)
    assert volume(mesh) == pytest.approx(1 + ball.volume, rel=1e-6)
    far = mesh.vertices[:, 0] > 2
    gradient = (mesh.vertices[far] - [5, 0, 0]) / [4, 1, 0.25]
    gradient /= np.linalg.norm(gradient, axis=1, keepdims=True)
    # the icosphere's vertex normals are face averages: within about a degree of the ellipsoid's
    assert (mesh.normals[far] * gradient).sum(1).min() > 0.999


def test_normals_of_the_file_are_kept_at_unit_length(tmp_path: Path):
    path = tmp_path / "triangle.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 3 4\nf 1//1 2//1 3//1\n")
    np.testing.assert_allclose(load_mesh(path).normals, np.tile([0, 0.6, 0.8], (3, 1)))


def test_normals_without_length_are_replaced(tmp_path: Path):
    path = tmp_path / "triangle.obj"
    path.write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nvn 0 0 0\nvn 0 3 4\nf 1//1 2//2 3//2\n")
    normals = load_mesh(path).normals
    assert sorted(normals[:, 2].round(6)) == [0.8, 0.8, 1.0]


def test_coincident_vertices_share_a_normal():
    """Seams of texture coordinates and STL files do not show as creases."""
    cube = trimesh.creation.box()
    vertices = cube.vertices[cube.faces].reshape(-1, 3)
    normals = angle_weighted_normals(vertices, np.arange(36).reshape(-1, 3))
    np.testing.assert_allclose(
        normals, vertices / np.linalg.norm(vertices, axis=1, keepdims=True), atol=1e-12
    )


def test_sample_bunny_stands_centred_on_the_ground():
    mesh = load_mesh("sample:bunny")
    lower, upper = mesh.bounds
    assert (upper - lower).max() == pytest.approx(1)
    assert lower[1] == 0
    np.testing.assert_allclose((lower + upper)[[0, 2]], 0, atol=1e-12)
    assert mesh.name == "bunny"
    assert len(mesh.faces) == 56172


BROKEN = {
    "suffix": ("mesh.xyz", b"1 2 3", "not a mesh file type"),
    "empty obj": ("mesh.obj", b"", "mesh.obj: "),
    "points only": ("mesh.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "mesh.obj: "),
    "no numbers": ("mesh.obj", b"v a b c\nf 1 1 1\n", "mesh.obj: "),
    "garbage ply": ("mesh.ply", b"\x00\x01\x02 not a ply", "cannot be read as a mesh"),
    "cut ply": (
        "mesh.ply",
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n0 0 0\n",
        "mesh.ply: ",
    ),
    "garbage glb": ("mesh.glb", b"glTF but not really", "cannot be read as a mesh"),
    "not a number": ("mesh.obj", b"v 0 0 nan\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "vertex 0 is not finite"),
    "infinite": ("mesh.obj", b"v 0 0 0\nv 1 inf 0\nv 0 1 0\nf 1 2 3\n", "is not finite"),
    "one point": ("mesh.obj", b"v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n", "all triangles are one point"),
    "index": (
        "mesh.ply",
        b"ply\nformat ascii 1.0\nelement vertex 3\nproperty float x\nproperty float y\nproperty float z\n"
        b"element face 1\nproperty list uchar int vertex_indices\nend_header\n"
        b"0 0 0\n1 0 0\n0 1 0\n3 0 1 7\n",
        "refers to vertex 7, but the file has 3",
    ),
}


@pytest.mark.parametrize("defect", BROKEN)
def test_broken_files_are_refused_with_the_reason(tmp_path: Path, defect: str):
    name, content, complaint = BROKEN[defect]
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match=complaint) as caught:
        load_mesh(path)
    assert str(path) in str(caught.value)
    assert caught.value.hint


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(InvalidInput, match=r"missing.ply: cannot be read \(No such file"):
        load_mesh(tmp_path / "missing.ply")
