"""Files for other programs, read back by readers that share nothing with the writers."""

import json
import struct
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coslobe.spheresets.export import write_glb, write_sph
from coslobe.spheresets.model import MeshInfo, SphereSet, SphereTree
from coslobe.spheresets.tree import bounding_hierarchy


def tree_of(spheres: np.ndarray) -> SphereTree:
    order, hierarchy = bounding_hierarchy(spheres)
    spheres = spheres[order]
    return SphereTree(
        levels=(SphereSet(spheres[:, :3], spheres[:, 3], np.zeros(len(spheres))),),
        parents=(np.full(len(spheres), -1, np.int32),),
        hierarchy=hierarchy,
        mesh=MeshInfo("a.ply", "0" * 64, 3, 1),
        method="balanced",
        quality="fast",
        mode="balanced",
        seed=0,
        seconds=0.0,
    )


def random_spheres(count: int, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.normal(100, 10, (count, 3)), rng.uniform(0.1, 3, count)])


def read_sph(path: Path) -> tuple[int, list[list[list[float] | None]]]:
    """Branching, and per level the spheres at its places (None: unused), as Bradshaw's README has it."""
    words = path.read_text().split()
    levels, branch = int(words[0]), int(words[1])
    numbers = [float(word) for word in words[2:]]
    places = [numbers[k : k + 5] for k in range(0, len(numbers), 5)]
    found, width = [], 1
    for _ in range(levels):
        row, places = places[:width], places[width:]
        assert len(row) == width
        found.append([sphere[:4] if sphere[3] >= 0 else None for sphere in row])
        width *= branch
    assert places == []
    return branch, found


@settings(max_examples=40, deadline=None)
@given(count=st.integers(1, 300), seed=st.integers(0, 9))
def test_sph_is_a_bounded_tree_whose_last_level_is_the_set(tmp_path_factory, count, seed):
    path = tmp_path_factory.getbasetemp() / "a.sph"
    spheres = random_spheres(count, seed)
    tree = tree_of(spheres)
    write_sph(path, tree)
    branch, levels = read_sph(path)
    last = [sphere for sphere in levels[-1] if sphere]
    assert sorted(last) == sorted(spheres.tolist())
    assert levels[0][0] == [*tree.hierarchy.centers[0], tree.hierarchy.radii[0]]
    assert 1 < len(levels) <= max(np.ceil(np.log(count) / np.log(4) - 1e-9), 1) + 1
    assert sum(map(len, levels)) <= max(6 * count, 5)
    for above, below in pairwise(levels):
        for n, sphere in enumerate(above):
            children = below[branch * n : branch * n + branch]
            assert (sphere is None) == (not any(children))  # nobody is lost, nobody without a parent
            for child in filter(None, children):
                assert np.linalg.norm(np.subtract(child[:3], sphere[:3])) + child[3] <= sphere[3] + 1e-9


def test_sph_of_ten_thousand_stays_small(tmp_path):
    write_sph(tmp_path / "a.sph", tree_of(random_spheres(10_000)))
    branch, levels = read_sph(tmp_path / "a.sph")
    assert (branch, len(levels)) == (4, 8)
    assert (tmp_path / "a.sph").stat().st_size < 3e6


def read_glb(path: Path) -> tuple[dict, dict[str, np.ndarray]]:
    """The document and the arrays of the first mesh, by the glTF 2.0 specification."""
    data = path.read_bytes()
    assert data[:4] == b"glTF"
    version, total, size = struct.unpack_from("<3I", data, 4)
    assert (version, total) == (2, len(data))
    document, binary = json.loads(data[20 : 20 + size]), data[28 + size :]
    (primitive,) = document["meshes"][0]["primitives"]
    arrays = {}
    for name, index in {**primitive["attributes"], "indices": primitive["indices"]}.items():
        accessor = document["accessors"][index]
        view = document["bufferViews"][accessor["bufferView"]]
        kind = {5121: np.uint8, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}[accessor["componentType"]]
        width = {"SCALAR": 1, "VEC3": 3, "VEC4": 4}[accessor["type"]]
        start = view.get("byteOffset", 0) + accessor.get("byteOffset", 0)
        arrays[name] = np.frombuffer(binary, kind, accessor["count"] * width, start).reshape(-1, width)
    return document, arrays


@pytest.mark.parametrize(("count", "triangles"), [(1, 5120), (79, 1280), (313, 320), (1251, 80)])
def test_glb_is_one_mesh_of_balls(tmp_path, count, triangles):
    path = tmp_path / "a.spheres.glb"
    tree = tree_of(random_spheres(count))
    write_glb(path, tree)
    document, arrays = read_glb(path)
    assert [node["name"] for node in document["nodes"] if "mesh" in node] == ["spheres"]

    corners = arrays["POSITION"].reshape(count, -1, 3)
    offset = corners - tree.finest.centers[:, None]
    distance = np.linalg.norm(offset, axis=2)
    # float32 at coordinates of 100 holds 8e-6 of radii from 0.1 on
    np.testing.assert_allclose(distance / tree.finest.radii[:, None], 1, atol=3e-4)
    normals = arrays["NORMAL"].reshape(offset.shape)
    np.testing.assert_allclose(normals, offset / distance[..., None], atol=3e-4)

    faces = arrays["indices"].reshape(count, triangles, 3)
    assert (faces // corners.shape[1] == np.arange(count)[:, None, None]).all()
    a, b, c = np.moveaxis(arrays["POSITION"][faces], 2, 0)
    outwards = np.einsum("nfk,nfk->nf", np.cross(b - a, c - a), a - tree.finest.centers[:, None])
    assert (outwards > 0).all()


def test_glb_has_a_colour_per_ball_and_no_metal(tmp_path):
    write_glb(tmp_path / "a.glb", tree_of(random_spheres(3)))
    document, arrays = read_glb(tmp_path / "a.glb")
    colors = arrays["COLOR_0"].reshape(3, -1, 4)
    assert (colors == colors[:, :1]).all()
    assert len(np.unique(colors[:, 0], axis=0)) == 3
    (material,) = document["materials"]
    assert material["pbrMetallicRoughness"]["metallicFactor"] == 0
    assert document["meshes"][0]["primitives"][0]["material"] == 0
