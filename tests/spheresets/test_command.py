"""`coslobe spheres` as typed: files, JSON, statuses and messages."""

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.spheresets.balanced import COARSE, EFFORTS
from coslobe.spheresets.files import read_spheres


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    """Runs the command in an empty folder, measuring shadows on a coarser ground."""
    monkeypatch.setattr("coslobe.spheresets.ground_shadow.GROUND_CELLS", 24)
    folder = tmp_path / "here"
    folder.mkdir()
    monkeypatch.chdir(folder)
    return lambda *arguments: CliRunner().invoke(app, ["spheres", *map(str, arguments)])


def test_files_appear_here_under_the_meshs_name(run, ball_file):
    result = run(ball_file, "-n", 5)
    assert result.exit_code == 0, result.output
    tree = read_spheres("ball.spheres.json")
    assert [level.count for level in tree.levels] == [4, 5]
    assert sorted(path.name for path in Path.cwd().iterdir()) == ["ball.spheres.json", "ball.spheres.png"]
    assert "silhouettes" in result.stdout
    assert "5 spheres in 2 levels" in result.stdout


def test_json_is_one_document_with_absolute_paths(run, ball_file):
    result = run(ball_file, "--count", 3, "-o", "other/set.spheres.json", "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert set(document) == {"file", "count", "metrics", "seconds"}
    assert document["file"] == str(Path.cwd() / "other" / "set.spheres.json")
    assert document["count"] == 3
    assert document["metrics"] == read_spheres(document["file"]).metrics
    assert set(document["metrics"]) == {
        "silhouette_iou_mean", "silhouette_iou_min", "volume_iou", "outside_volume", "uncovered_volume",
        "sum_outside_volume", "max_gap", "hausdorff_mesh_to_union", "hausdorff_union_to_mesh",
        "shadow_rmse", "shadow_rmse_no_contact", "shadow_bias",
    }  # fmt: skip
    assert Path("other/set.spheres.png").is_file()


def test_levels_seed_and_quality_reach_the_file(run, ball_file, monkeypatch):
    monkeypatch.setitem(EFFORTS, "best", COARSE)  # the real one takes longer than this test is worth
    assert run(ball_file, "-n", 6, "--levels", 1, "--seed", 5, "--quality", "best").exit_code == 0
    tree = read_spheres("ball.spheres.json")
    assert (len(tree.levels), tree.seed, tree.quality) == (1, 5, "best")


@pytest.mark.parametrize(
    ("arguments", "status", "complaint"),
    [
        (["--method", "convex"], 2, "no method 'convex'"),
        (["--mode", "around"], 2, "no mode 'around' with method balanced"),
        (["--quality", "good"], 2, "no quality 'good'"),
        (["-n", "0"], 2, "count must be >= 1 (got 0)"),
        (["-n", "many"], 2, "valid integer"),
        (["--levels", "0"], 2, "levels must be >= 1"),
        (["--seed", "-1"], 2, "greater than or equal to 0"),
        (["--no-such-option"], 2, "--no-such-option"),
        (["--device", "no such device"], 2, "no such device"),
    ],
)
def test_wrong_use_ends_with_status_2(run, ball_file, arguments, status, complaint):
    result = run(ball_file, *arguments)
    assert result.exit_code == status
    assert complaint in result.stderr
    assert not list(Path.cwd().iterdir())


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("mesh.xyz", b"1 2 3", "mesh.xyz: not a mesh file type that can be read"),
        ("mesh.ply", b"nonsense", "mesh.ply: cannot be read as a mesh"),
        ("flat.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "flat.obj: the mesh encloses no volume"),
        ("nan.obj", b"v 0 0 0\nv 1 0 nan\nv 0 1 0\nf 1 2 3\n", "nan.obj: vertex 1 is not finite"),
    ],
)
def test_meshes_that_cannot_be_used_end_with_status_3(run, tmp_path, name, content, complaint):
    path = tmp_path / name
    path.write_bytes(content)
    result = run(path)
    assert result.exit_code == 3
    assert complaint in result.stderr
    assert "try: " in result.stderr
    assert "Traceback" not in result.output


def test_a_missing_mesh_argument_is_wrong_use(run):
    assert run().exit_code == 2


@pytest.mark.parametrize("name", ["none.ply", "sample:cow"])
def test_a_mesh_that_is_not_there_is_wrong_use(run, name):
    result = run(name)
    assert result.exit_code == 2
    assert f"{name}: no such file" in result.stderr


def test_a_folder_that_cannot_be_written_is_named(run, ball_file):
    Path("file").write_text("in the way")
    result = run(ball_file, "-n", 1, "-o", "file/a.spheres.json")
    assert result.exit_code == 1
    assert "file/a.spheres.json: cannot be written" in result.stderr
