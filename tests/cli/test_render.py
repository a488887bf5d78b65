"""`coslobe render` as typed: outputs, exit statuses, one JSON document on stdout."""

import json
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app

COSLOBE = Path(sys.executable).with_name("coslobe")


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Runs a command in-process in an empty folder."""
    folder = tmp_path / "work"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return lambda *words: CliRunner().invoke(app, [str(word) for word in words])


def test_frames_go_to_the_default_folder_and_the_speed_is_told(run, tiny_scene):
    result = run("render", tiny_scene, "--frames", "0:2")
    assert result.exit_code == 0, result.stderr
    first, *video = result.stdout.splitlines()
    assert re.fullmatch(r"2 rendered \(\d+\.\d\d frames/s\): out/tiny/frames", first)
    assert video == (["video: out/tiny/sequence.mp4"] if shutil.which("ffmpeg") else [])
    frames = sorted(path.name for path in Path("out/tiny/frames").iterdir())
    assert frames == ["beauty.0000.exr", "beauty.0000.png", "beauty.0001.exr", "beauty.0001.png"]
    assert Path("out/tiny/manifest.json").is_file()

    again = run("render", tiny_scene).stdout.splitlines()[0]
    assert re.fullmatch(r"2 rendered \(\d+\.\d\d frames/s\), 2 up to date: out/tiny/frames", again)
    last = run("render", tiny_scene).stdout.splitlines()[0]
    assert last == "0 rendered, 4 up to date: out/tiny/frames"


def test_json_is_one_document_with_the_contracts_keys(tiny_scene, tmp_path):
    command = [
        COSLOBE,
        "render",
        tiny_scene,
        "-o",
        "here",
        "--frames",
        "3",
        "--layers",
        "object, depth",
        "--json",
    ]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    document = json.loads(done.stdout)
    assert set(document) == {"frames", "device", "build_seconds", "skipped"}
    (frame,) = document["frames"]
    assert frame["index"] == 3
    assert frame["file"] == str(tmp_path / "here" / "frames" / "beauty.0003.exr")
    assert Path(frame["file"]).is_file()
    assert 0 < frame["kernel_seconds"] < frame["seconds"]
    assert 0 < frame["points"] <= 21 * 16
    assert frame["resumed"] is False
    assert {"index", "platform", "version", "name"} <= set(document["device"])


def test_pictures_hold_light_and_shadow(run, tiny_scene):
    """The cube's shadow lies on the ground: some ground points are lit, some are much darker."""
    from coslobe.render.images import read_exr

    assert run("render", tiny_scene, "--frames", "0", "--layers", "object").exit_code == 0
    layers, _ = read_exr(Path("out/tiny/frames/beauty.0000.exr"))
    ground = layers["beauty"][layers["object"] == 0].sum(axis=-1)
    assert ground.min() < 0.2 * ground.max()
    assert not layers["beauty"][layers["object"] == -1].any()


def test_the_same_settings_give_the_same_bytes(run, tiny_scene):
    for folder in ("a", "b"):
        assert run("render", tiny_scene, "--frames", "1", "-o", folder).exit_code == 0
    for name in ("beauty.0001.exr", "beauty.0001.png"):
        assert Path("a/frames", name).read_bytes() == Path("b/frames", name).read_bytes()


def test_dry_run_writes_nothing(run, tiny_scene):
    result = run("render", tiny_scene, "--dry-run", "--frames", "1:")
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [
        "to render: 3 frames (1, 2, 3) -> out/tiny/frames",
        "up to date: no frame",
        "shaded points: up to 336 per frame",
        f"spheres of cube: read from {tiny_scene.parent / 'cube.spheres.json'}",
    ]
    assert not Path("out").exists()
    document = json.loads(run("render", tiny_scene, "--dry-run", "--json", "--frames", "1:").stdout)
    assert [frame["index"] for frame in document["frames"]] == [1, 2, 3]


# What is typed after `coslobe render`, the exit status, and a part of what stderr says.
FAILURES = {
    "no such file": (["missing.yaml"], 2, "missing.yaml"),
    "a folder": (["."], 2, "is a directory"),
    "unknown option": (["SCENE", "--sample", "4"], 2, "--sample"),
    "bad range": (["SCENE", "--frames", "9"], 2, "frames 0 to 3"),
    "bad path": (["SCENE", "--set", "lights.kee.sphere.radius=1"], 2, "did you mean key?"),
    "bad layer": (["SCENE", "--layers", "dept"], 2, "did you mean depth?"),
    "bad device": (["SCENE", "--device", "no such device"], 2, "no such device"),
    "bad estimator": (["SCENE", "--estimator", "exact"], 2, "--estimator"),
    "bad value": (["SCENE", "--set", "camera.fov=0"], 3, "camera.fov: must be > 0 (got 0)"),
    "no such mesh": (["SCENE", "--set", "objects.cube.mesh=a.ply"], 3, "no such file"),
    "cannot write": (["SCENE", "-o", "file/out"], 1, "cannot be written"),
}


@pytest.mark.parametrize(("words", "status", "message"), FAILURES.values(), ids=FAILURES.keys())
def test_failures_end_with_their_status_and_say_what_to_do(run, tiny_scene, words, status, message):
    Path("file").touch()
    result = run("render", *[tiny_scene if word == "SCENE" else word for word in words])
    assert result.exit_code == status
    assert message in " ".join(result.stderr.split())
    assert result.stdout == ""
    assert "Traceback" not in result.stderr


def test_without_a_device_the_status_is_4(tiny_scene, tmp_path):
    environment = {**os.environ, "OCL_ICD_VENDORS": str(tmp_path / "missing")}  # where runtimes register
    command = [COSLOBE, "render", tiny_scene, "-o", tmp_path / "out"]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 4
    assert "apt-get install pocl-opencl-icd" in done.stderr
    assert not (tmp_path / "out").exists()
