"""Atomic files: whole or not at all, ordinary permissions; JSON that says what it cannot hold."""

import hashlib
import json
import os
from pathlib import Path

import numpy as np
import pytest

from coslobe.core import files
from coslobe.core.errors import CoslobeError, InvalidInput


@pytest.mark.parametrize("failure", [ValueError, KeyboardInterrupt, OSError])
def test_failure_leaves_the_old_file_and_nothing_else(tmp_path, failure):
    target = tmp_path / "frame.exr"
    target.write_text("old")
    expected = CoslobeError if failure is OSError else failure
    with pytest.raises(expected), files.atomic_path(target) as temporary:  # noqa: PT012
        temporary.write_text("half of the n")
        raise failure
    assert [path.name for path in tmp_path.iterdir()] == ["frame.exr"]
    assert target.read_text() == "old"


def test_temporary_is_beside_the_target_with_its_suffix(tmp_path):
    target = tmp_path / "new" / "folder" / "frame.exr"
    with files.atomic_path(target) as temporary:
        assert temporary.parent == target.parent
        assert temporary.suffix == ".exr"
        assert not target.exists()
        temporary.write_text("new")
    assert target.read_text() == "new"
    assert list(target.parent.iterdir()) == [target]


@pytest.mark.parametrize("mask", [0o022, 0o027, 0o077])
def test_permissions_follow_the_umask(tmp_path, mask):
    before = os.umask(mask)
    try:
        files.write_text(tmp_path / "a.txt", "text")
        assert os.umask(mask) == mask  # asking for the mask does not change it
    finally:
        os.umask(before)
    assert (tmp_path / "a.txt").stat().st_mode & 0o777 == 0o666 & ~mask


def test_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(CoslobeError, match=r"file/a\.txt: cannot be written") as caught:
        files.write_text(tmp_path / "file" / "a.txt", "text")
    assert caught.value.hint


def test_target_that_is_a_folder(tmp_path):
    (tmp_path / "a.txt").mkdir()
    with pytest.raises(CoslobeError, match=r"a\.txt: cannot be written"):
        files.write_text(tmp_path / "a.txt", "text")
    assert [path.name for path in tmp_path.iterdir()] == ["a.txt"]


def test_leftovers_of_a_killed_run_are_removed(tmp_path):
    (tmp_path / f"{files.TEMPORARY_PREFIX}xyz.exr").write_text("half")
    (tmp_path / "beauty.0000.exr").write_text("whole")
    files.remove_leftovers(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["beauty.0000.exr"]


def test_json_of_numpy_values_and_paths(tmp_path):
    document = {"n": np.int32(3), "x": np.float64(0.5), "v": np.arange(2), "path": Path("a.exr")}
    files.write_json(tmp_path / "a.json", document)
    loaded = json.loads((tmp_path / "a.json").read_text())
    assert loaded == {"n": 3, "x": 0.5, "v": [0, 1], "path": str(Path.cwd() / "a.exr")}


@pytest.mark.parametrize(("value", "error"), [(float("nan"), ValueError), (object(), TypeError)])
def test_json_refuses_what_it_cannot_hold(tmp_path, value, error):
    with pytest.raises(error):
        files.write_json(tmp_path / "a.json", {"value": value})
    assert not list(tmp_path.iterdir())


def test_sha256_and_unreadable_files(tmp_path):
    path = tmp_path / "a.bin"
    path.write_bytes(b"coslobe" * 1000)
    assert files.sha256(path) == hashlib.sha256(path.read_bytes()).hexdigest()
    assert files.read_bytes(path, "mesh file") == path.read_bytes()
    with pytest.raises(InvalidInput, match=r"none: cannot be read \(No such file"):
        files.sha256(tmp_path / "none")
    with pytest.raises(InvalidInput, match=r"none: mesh file cannot be read \(No such file"):
        files.read_bytes(tmp_path / "none", "mesh file")
