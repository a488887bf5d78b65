"""`coslobe spheres` as typed: files, JSON, statuses and messages."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.core.files import sha256
from coslobe.spheresets.balanced import COARSE, EFFORTS
from coslobe.spheresets.files import read_spheres, write_spheres
from coslobe.spheresets.model import MeshInfo, SphereSet, SphereTree
from coslobe.spheresets.tree import bounding_hierarchy


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, tmp_path_factory: pytest.TempPathFactory):
    """Runs the command in an empty folder; fits are short, the ground of shadows and pictures are coarse."""
    monkeypatch.setattr("coslobe.spheresets.preview.PIXELS", 64)
    monkeypatch.setattr("coslobe.spheresets.ground_shadow.GROUND_CELLS", 24)
    monkeypatch.setitem(EFFORTS, "fast", replace(COARSE, steps=60, rounds=1))
    # Such fits must not stand in for real ones in other tests.
    monkeypatch.setenv("COSLOBE_CACHE_DIR", str(tmp_path_factory.getbasetemp() / "short-fits"))
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
    monkeypatch.setitem(EFFORTS, "best", EFFORTS["fast"])  # the real one takes too long
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
        (["--export", "fbx"], 2, "no export 'fbx'"),
        (["--compare", "a.spheres.json"], 2, "--compare"),
        (["--compare", "a.spheres.json", "b.spheres.json"], 2, "a.spheres.json"),
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


@pytest.mark.parametrize("kind", ["sph", "glb"])
def test_an_export_lies_beside_the_output_and_never_replaces_a_mesh(run, ball_file, kind):
    result = run(ball_file, "-n", 2, "-o", "sets/two.spheres.json", "--export", kind, "--json")
    assert result.exit_code == 0, result.output
    exported = Path("sets", f"two.spheres.{kind}").absolute()
    assert json.loads(result.stdout)["export"] == str(exported)
    assert exported.stat().st_size > 0


@pytest.fixture
def pair(run, ball_file) -> list[str]:
    """Two sphere files of the ball, in the current folder: the ball itself, and three smaller ones in it."""
    for radii in ([1.0], [0.9, 0.8, 0.7]):
        spheres = np.column_stack([np.zeros((len(radii), 3)), radii])
        _, hierarchy = bounding_hierarchy(spheres)
        tree = SphereTree(
            levels=(SphereSet(spheres[:, :3], spheres[:, 3], np.zeros(len(radii))),),
            parents=(np.full(len(radii), -1, np.int32),),
            hierarchy=hierarchy,
            mesh=MeshInfo("ball.ply", sha256(ball_file), 642, 1280),
            method="balanced",
            quality="fast",
            mode="balanced",
            seed=0,
            seconds=1.5,
        )
        write_spheres(f"{len(radii)}.spheres.json", tree)
    return ["1.spheres.json", "3.spheres.json"]


def test_compare_prints_all_figures_side_by_side(run, ball_file, pair):
    result = run("--compare", *pair, ball_file)
    assert result.exit_code == 0, result.output
    lines = result.stdout.splitlines()
    assert lines[0] == "A  1.spheres.json: 1 sphere, balanced (fast, balanced), seed 0, 1.5 s"
    assert lines[1] == "B  3.spheres.json: 3 spheres, balanced (fast, balanced), seed 0, 1.5 s"
    assert max(map(len, lines)) <= 80
    cells = {line.split("  ")[0]: line.split() for line in lines[3:]}
    assert len([name for name in cells if name.startswith("shadow")]) == 9
    assert cells["silhouette_iou_mean"][2] == "*"
    assert cells["outside_volume"][-1] == "*"
    assert 0.8 < float(cells["silhouette_iou_mean"][3]) < 0.82 < 0.98 < float(cells["silhouette_iou_mean"][1])


def test_compare_as_json_is_one_document(run, ball_file, pair):
    result = run(ball_file, "--compare", *pair, "--json")
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert set(document) == {"mesh", "sets", "better"}
    assert document["mesh"] == str(ball_file)
    assert [one["file"] for one in document["sets"]] == [str(Path(name).absolute()) for name in pair]
    assert [one["count"] for one in document["sets"]] == [1, 3]
    assert document["sets"][0]["metrics"]["volume_iou"] > 0.98
    assert document["better"]["silhouette_iou_mean"] == "A"


def test_compare_warns_where_the_mesh_is_another(run, tmp_path, pair):
    other = tmp_path / "other.ply"
    trimesh.creation.icosphere(subdivisions=2).export(other)
    result = run("--compare", *pair, other)
    assert result.exit_code == 0
    assert "warning: 1.spheres.json: the spheres were fitted to another version" in result.stderr


@pytest.mark.parametrize("option", [["-n", 64], ["--seed", 0], ["-o", "x"], ["--export", "sph"]])
def test_compare_takes_no_option_of_a_fit(run, ball_file, option):
    result = run("--compare", ball_file, ball_file, ball_file, *option)
    assert result.exit_code == 2
    assert "--compare fits nothing" in result.stderr


INTERRUPTED = {"fit.Balanced.fit": 0, "fit.measure": 1, "preview.write_preview": 2}


@pytest.mark.parametrize(("during", "finished"), INTERRUPTED.items())
def test_an_interrupt_leaves_nothing_half_written(run, ball_file, tmp_path, monkeypatch, during, finished):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setenv("COSLOBE_CACHE_DIR", str(tmp_path / "cache"))
    monkeypatch.setattr(f"coslobe.spheresets.{during}", interrupted)
    result = run(ball_file, "-n", 2)
    assert result.exit_code == 130
    assert "interrupted" in result.stderr
    written = [*Path.cwd().iterdir(), *(tmp_path / "cache" / "spheres").iterdir()]
    assert [read_spheres(path).finest.count for path in written] == [2] * finished
