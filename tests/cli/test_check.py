"""`coslobe check` and `coslobe schema`."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app


def run(*words):
    return CliRunner().invoke(app, [str(word) for word in words])


def test_a_valid_scene_is_summed_up(tiny_scene: Path):
    result = run("check", tiny_scene)
    assert result.exit_code == 0, result.stderr
    lines = result.stdout.splitlines()
    assert lines[0] == f"{tiny_scene}: valid"
    assert "object     ground: plane of size 2, material floor" in lines
    cube = tiny_scene.parent / "cube.obj"
    assert f"object     cube: {cube}, 8 vertices, 12 triangles, 1 spheres, material clay" in lines
    assert "animation  lights.key.sphere.center: 2 keys, frames 0 to 3" in lines
    assert len(lines) < 24  # one screen


def test_all_errors_are_listed_with_their_places(tiny_scene: Path):
    text = tiny_scene.read_text().replace("fov: 40", "fov: 0").replace("radius: 0.2", "raduis: 0.2")
    tiny_scene.write_text(text)
    result = run("check", tiny_scene)
    assert result.exit_code == 3
    assert result.stdout == ""
    for message in (
        f"{tiny_scene}:2:66: camera.fov: must be > 0 (got 0)",
        f"{tiny_scene}:9:9: lights.key.sphere.radius: required, but missing",
        f"{tiny_scene}:9:43: lights.key.sphere.raduis: unknown key; did you mean radius?",
    ):
        assert message in result.stderr


def test_later_frames_are_checked_too(tiny_scene: Path):
    key = "{0: [0, 0.2, 1], 3: [0, 0.2, 0]}"
    text = tiny_scene.read_text().replace("objects.cube.transform.rotate_y, keys: {0: 0, 3: 45}", "X")
    tiny_scene.write_text(text.replace("X", f"camera.look_at.origin, keys: {key}"))
    result = run("check", tiny_scene)
    assert result.exit_code == 3
    assert "origin and target must differ, at frame 3" in result.stderr


@pytest.mark.parametrize(("name", "text"), [("cube.obj", "v 1 2"), ("cube.spheres.json", "{}")])
def test_broken_files_are_found(tiny_scene: Path, name: str, text: str):
    (tiny_scene.parent / name).write_text(text)
    result = run("check", tiny_scene)
    assert result.exit_code == 3
    assert name in result.stderr
    assert "Traceback" not in result.stderr


def test_the_schema_is_one_json_document():
    result = run("schema")
    assert result.exit_code == 0
    schema = json.loads(result.stdout)
    assert schema["$schema"].startswith("https://json-schema.org/")
    assert "threshold" in schema["$defs"]["Shading"]["properties"]
