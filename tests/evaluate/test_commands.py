"""`coslobe reference`, `eval` and `demo` as commands: documents, messages and exit statuses."""

import json

import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_reference_prints_one_document(ball_scene, tmp_path):
    result = invoke("reference", ball_scene, "-o", tmp_path, "--frames", "1:3", "--spp", 4, "--json")
    assert result.exit_code == 0, result.output
    frames = json.loads(result.stdout)["frames"]
    assert [frame["index"] for frame in frames] == [1, 2]
    assert frames[0]["file"] == str(tmp_path / "reference" / "reference.0001.exr")
    assert (tmp_path / "reference" / "reference.0002.exr").is_file()
    assert all(frame["spp"] == 4 and frame["seconds"] > 0 for frame in frames)


def test_reference_samples_until_an_error_is_reached(ball_scene, tmp_path):
    arguments = ("reference", ball_scene, "-o", tmp_path, "--frames", 0, "--error", 0.03, "--bounces", 2)
    result = invoke(*arguments, "--json")
    assert result.exit_code == 0, result.output
    (frame,) = json.loads(result.stdout)["frames"]
    assert 0 < frame["error"] <= 0.03
    assert "standard error" in invoke(*arguments).stdout


def test_reference_exports_for_mitsuba(ball_scene, tmp_path):
    arguments = ("reference", ball_scene, "--export-mitsuba", tmp_path / "m", "--frames", "0:2")
    result = invoke(*arguments, "--json")
    assert result.exit_code == 0, result.output
    files = json.loads(result.stdout)["files"]
    assert files == [str(tmp_path / "m" / f"000{k}" / "scene.xml") for k in (0, 1)]
    assert {path.name for path in (tmp_path / "m" / "0000").iterdir()} == {
        "scene.xml",
        "render.py",
        "ball.ply",
    }
    assert "2 frames" in invoke(*arguments).stdout


def test_reference_in_words(ball_scene, tmp_path):
    arguments = ("reference", ball_scene, "-o", tmp_path, "--frames", 0, "--spp", 4)
    assert "4 samples per pixel" in invoke(*arguments).stdout
    assert "was there already" in invoke(*arguments).stdout


def test_the_default_folder_is_named_after_the_scene(ball_scene, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert invoke("reference", ball_scene, "--frames", 0, "--spp", 2).exit_code == 0
    assert (tmp_path / "out" / "scene" / "reference" / "reference.0000.exr").is_file()


def test_eval_prints_one_document(ball_scene, tmp_path, device):
    arguments = (
        "eval",
        ball_scene,
        "-o",
        tmp_path,
        "--frames",
        1,
        "--spp",
        16,
        "--device",
        device.info.index,
    )
    result = invoke(*arguments, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["results"] == str(tmp_path / "results.json")
    assert document["report"] == str(tmp_path / "report.html")
    (frame,) = document["frames"]
    assert frame["index"] == 1
    assert 0 < frame["relative_rmse_mesh"] < 0.1
    words = invoke(*arguments)
    assert "frame 1: error" in words.stdout
    assert str(tmp_path / "report.html") in words.stdout


@pytest.mark.parametrize("wrong", [["--error", "0"], ["--bounces", "0"], ["--error", "much"]])
def test_wrong_settings_of_a_reference(ball_scene, tmp_path, wrong):
    result = invoke("reference", ball_scene, "-o", tmp_path, *wrong)
    assert result.exit_code == 2
    assert wrong[0] in result.stderr


@pytest.mark.parametrize("command", ["reference", "eval"])
@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (["missing.yaml"], 2, "missing.yaml"),
        (["SCENE", "--spp", "0"], 2, "spp"),
        (["SCENE", "--frames", "9"], 2, "no such frame"),
        (["SCENE", "--set", "lights.kay.sphere.radius=1"], 2, "key"),
        (["SCENE", "--set", "lights.key.sphere.radius=-1"], 3, "must be >= 0"),
        (["SCENE", "--occluder", "mesh"], 2, "occluder"),
    ],
)
def test_wrong_arguments(ball_scene, tmp_path, command, arguments, status, message):
    arguments = [str(ball_scene) if argument == "SCENE" else argument for argument in arguments]
    result = invoke(command, *arguments, "-o", tmp_path)
    assert result.exit_code == status, result.output
    assert message in " ".join(result.stderr.split())
    assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []


def test_reference_needs_a_scene():
    assert invoke("reference").exit_code == 2


def test_a_folder_that_cannot_be_made_is_named(ball_scene, tmp_path):
    (tmp_path / "file").write_text("")
    result = invoke("reference", ball_scene, "-o", tmp_path / "file", "--frames", 0, "--spp", 2)
    assert result.exit_code == 1
    assert "cannot be written" in result.stderr


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("--paper", "--table1"), "do not go together"),
        (("--pareto", "--sweep", "ti"), "do not go together"),
        (("--paper", "--set", "image.width=8"), "takes no --set"),
        (("--table1", "--frames", "0"), "takes no --frames"),
    ],
)
def test_kinds_of_evaluations_are_asked_for_one_by_one(arguments, said):
    result = invoke("eval", *arguments)
    assert result.exit_code == 2
    assert said in result.stderr
