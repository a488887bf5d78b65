"""Sphere files: nothing is lost on the way, and what is wrong in one is named."""

import json
from copy import deepcopy
from pathlib import Path

import numpy as np
import pytest

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.files import mismatch, read_spheres, write_spheres
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.model import MeshInfo, SphereSet, SphereTree
from coslobe.spheresets.tree import bounding_hierarchy, parents

METRICS = {"silhouette_iou_mean": 0.95, "shadow_rmse": [0.05, 0.02, 0.01]}


def tree() -> SphereTree:
    rng = np.random.default_rng(0)
    coarse, fine = rng.normal(size=(4, 4)), rng.normal(size=(9, 4))
    coarse[:, 3], fine[:, 3] = np.abs(coarse[:, 3]), np.abs(fine[:, 3])
    order, hierarchy = bounding_hierarchy(fine)
    fine = fine[order]
    return SphereTree(
        levels=tuple(SphereSet(s[:, :3], s[:, 3], rng.random(len(s))) for s in (coarse, fine)),
        parents=(np.full(4, -1, np.int32), parents(fine, coarse)),
        hierarchy=hierarchy,
        mesh=MeshInfo("bunny.ply", "ab" * 32, 28088, 56172),
        method="balanced",
        quality="fast",
        mode="balanced",
        seed=3,
        seconds=4.2,
        metrics=METRICS,
    )


def test_round_trip(tmp_path: Path):
    before, path = tree(), tmp_path / "bunny.spheres.json"
    write_spheres(path, before)
    after = read_spheres(path)
    for one, two in zip(before.levels, after.levels, strict=True):
        for name in ("centers", "radii", "outside"):
            np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    for one, two in zip(before.parents, after.parents, strict=True):
        np.testing.assert_array_equal(one, two)
        assert two.dtype == np.int32
    for name, values in vars(before.hierarchy).items():
        np.testing.assert_array_equal(values, getattr(after.hierarchy, name))
    for name in ("mesh", "method", "quality", "mode", "seed", "seconds", "metrics"):
        assert getattr(before, name) == getattr(after, name)
    assert after.finest is after.levels[-1]


def test_the_file_is_plain_json_with_the_contracts_keys(tmp_path: Path):
    write_spheres(tmp_path / "a.spheres.json", tree())
    document = json.loads((tmp_path / "a.spheres.json").read_text())
    assert list(document) == [
        "format", "mesh", "method", "quality", "mode", "seed", "seconds", "levels", "hierarchy", "metrics",
    ]  # fmt: skip
    assert document["format"] == "coslobe-spheres/1"
    assert set(document["levels"][0]) == {"centers", "radii", "parents", "outside"}
    assert set(document["hierarchy"]) == {"centers", "radii", "first_child", "child_count"}


def change(*path, to):
    """An edit of the document: the value at `path` becomes `to`; `to=...` removes it."""

    def edit(document):
        for step in path[:-1]:
            document = document[step]
        if to is ...:
            del document[path[-1]]
        else:
            document[path[-1]] = to

    return edit


BROKEN = {
    "format": (change("format", to="coslobe-spheres/2"), r'format: must be "coslobe-spheres/1" \(got'),
    "missing key": (change("levels", to=...), "levels: is missing"),
    "no level": (change("levels", to=[]), "levels: must hold at least one level"),
    "level type": (change("levels", 0, to=3), r"levels\[0\]: must be an object"),
    "no spheres": (change("levels", 1, "radii", to=[]), r"levels\[1\].radii: must hold at least one"),
    "radius": (change("levels", 1, "radii", 2, to=0), r"levels\[1\].radii\[2\]: must be > 0 \(got 0"),
    "not finite": (change("levels", 1, "radii", 2, to=float("nan")), r"radii: must be 9 finite numbers"),
    "count": (change("levels", 1, "centers", 8, to=...), r"levels\[1\].centers: must be 9 x 3 finite"),
    "columns": (change("levels", 0, "centers", 1, to=[1, 2]), r"levels\[0\].centers: must be 4 x 3"),
    "text": (change("levels", 0, "radii", 0, to="one"), r"levels\[0\].radii: must be 4 finite numbers"),
    "outside": (change("levels", 0, "outside", 1, to=-0.5), r"outside\[1\]: must be >= 0 \(got -0.5"),
    "root": (change("levels", 0, "parents", 2, to=0), r"levels\[0\].parents\[2\]: must be -1"),
    "parent": (change("levels", 1, "parents", 2, to=4), r"parents\[2\]: must be from 0 to 3 \(got 4"),
    "half": (change("levels", 1, "parents", 2, to=0.5), r"parents: must be whole numbers"),
    "child": (change("hierarchy", "first_child", 0, to=99), r"first_child\[0\]: children must lie within"),
    "mesh": (change("mesh", "sha256", to=5), r"mesh.sha256: has the wrong type \(int\)"),
    "seed": (change("seed", to="zero"), r"seed: has the wrong type \(str\)"),
}  # fmt: skip


@pytest.mark.parametrize("defect", BROKEN)
def test_broken_files_are_refused_with_the_place(tmp_path: Path, defect: str):
    edit, complaint = BROKEN[defect]
    path = tmp_path / "a.spheres.json"
    write_spheres(path, tree())
    document = deepcopy(json.loads(path.read_text()))
    edit(document)
    path.write_text(json.dumps(document))
    with pytest.raises(InvalidInput, match=complaint) as caught:
        read_spheres(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "coslobe spheres" in caught.value.hint


@pytest.mark.parametrize(
    ("content", "complaint"), [(b"", "is not JSON"), (b"{", "is not JSON"), (b"[1]", "format: must be")]
)
def test_other_files_are_refused(tmp_path: Path, content: bytes, complaint: str):
    path = tmp_path / "a.spheres.json"
    path.write_bytes(content)
    with pytest.raises(InvalidInput, match=complaint):
        read_spheres(path)


def test_a_missing_file_is_named(tmp_path: Path):
    with pytest.raises(InvalidInput, match="sphere file cannot be read"):
        read_spheres(tmp_path / "none.spheres.json")


def test_spheres_of_another_mesh_are_noticed():
    def mesh(sha256):
        return Mesh(np.zeros((3, 3)), np.zeros((1, 3), np.int32), np.zeros((3, 3)), "bunny.ply", sha256)

    assert mismatch(tree(), mesh("ab" * 32)) is None
    warning = mismatch(tree(), mesh("cd" * 32))
    assert warning is not None
    assert "another version of bunny.ply" in warning
