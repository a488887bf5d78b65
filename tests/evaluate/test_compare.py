"""Comparing two runs: what counts as worse, what as noise, and the exit status for other people's CI."""

import copy
import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.core.errors import InvalidInput
from coslobe.evaluate.compare import Thresholds, compare_results
from coslobe.evaluate.comparison import KINDS
from coslobe.evaluate.metrics import METRICS


def part(error: float = 0.02, ssim: float = 0.99) -> dict:
    """Numbers of a picture or a part of it, with a noise of a tenth of a per cent."""
    values = {f"{name}_{kind}": error for name in METRICS for kind in KINDS}
    values |= {f"ssim_{kind}": ssim for kind in KINDS} | {f"temporal_{kind}": None for kind in KINDS}
    floor = dict.fromkeys(METRICS, 0.001) | {"ssim": 0.9999, "psnr": 60.0}
    return {**values, "noise_floor": dict.fromkeys(KINDS, floor)}


def results(**changes) -> dict:
    frame = {"index": 3, **part(), "kernel_seconds": 0.01, "gbuffer_seconds": 0.1, "seconds": 0.2}
    frame |= {"objects": {"ball": part()}, "zones": {"lit": part()}}
    return {"format": "coslobe-results/1", "frames": [frame | changes]}


@pytest.fixture
def compared(tmp_path):
    """Compare two documents through their files."""

    def compare(first: dict, second: dict, **thresholds):
        paths = [tmp_path / "a.json", tmp_path / "b.json"]
        for path, document in zip(paths, (first, second), strict=True):
            path.write_text(json.dumps(document))
        return compare_results(*paths, Thresholds(**thresholds))

    return compare


def verdict(document: dict, metric: str, place: str = "frame 3") -> str:
    (found,) = (
        change for change in document["changes"] if (change["place"], change["metric"]) == (place, metric)
    )
    return found["verdict"]


def test_a_run_holds_against_itself(compared):
    document = compared(results(), results())
    assert document["holds"]
    assert {change["verdict"] for change in document["changes"]} == {"same"}


@pytest.mark.parametrize(
    ("metric", "value", "expected"),
    [
        ("relative_rmse_mesh", 0.0209, "worse"),
        ("relative_rmse_mesh", 0.022, "beyond"),
        ("relative_rmse_mesh", 0.018, "better"),
        ("bias_spheres", -0.03, "beyond"),  # farther from right, on the other side
        ("bias_spheres", -0.02, "same"),
        ("ssim_mesh", 0.5, "beyond"),
        ("ssim_mesh", 0.999, "better"),
        ("kernel_seconds", 0.05, "worse"),  # times are not judged unless that is asked for
        ("temporal_mesh", 0.5, "noise"),  # there was none to compare with
    ],
)
def test_what_is_worse(compared, metric, value, expected):
    document = compared(results(), results(**{metric: value}))
    assert verdict(document, metric) == expected
    assert document["holds"] == (expected != "beyond")


def test_times_are_judged_when_asked_for(compared):
    slow = results(kernel_seconds=0.013)
    assert not compared(results(), slow, time=0.25)["holds"]
    assert compared(results(), slow, time=0.35)["holds"]


def test_changes_within_the_noise_do_not_count(compared):
    quiet = {"relative_rmse_mesh": 0.0005}
    document = compared(results(**quiet), results(relative_rmse_mesh=0.001))
    assert verdict(document, "relative_rmse_mesh") == "noise"
    assert document["holds"]


def test_parts_of_a_picture_count_and_may_not_be_missing(compared):
    other = results()
    other["frames"][0]["objects"]["ball"] = part(error=0.5)
    document = compared(results(), other)
    assert verdict(document, "relative_rmse_mesh", "frame 3, ball") == "beyond"
    assert document["changes"][0]["verdict"] == "beyond"  # the worst comes first
    del other["frames"][0]["objects"]["ball"]
    document = compared(results(), other)
    assert not document["holds"]
    assert any("ball" in name for name in document["missing"])


def test_rows_are_matched_by_what_they_are(compared):
    row = {
        "value": 2,
        "seed": 0,
        "frame": 0,
        "relative_rmse_mesh": 0.1,
        "noise_mesh": 0.001,
        "kernel_seconds": 1.0,
    }
    first = {"format": "coslobe-sweep/1", "rows": [row, row | {"value": 3}]}
    second = copy.deepcopy(first)
    second["rows"].reverse()
    assert compared(first, second)["holds"]
    second["rows"][0]["relative_rmse_mesh"] = 0.2
    document = compared(first, second)
    assert verdict(document, "relative_rmse_mesh", "value 3, seed 0, frame 0") == "beyond"


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"format": "coslobe-results/1"}', '{"format": 1, "rows": []}']
)
def test_files_that_hold_no_results(tmp_path, text):
    path = tmp_path / "a.json"
    path.write_text(text)
    with pytest.raises(InvalidInput, match=r"a\.json: holds no results"):
        compare_results(path, path, Thresholds())


def test_kinds_and_scenes_must_match(compared, tmp_path):
    sweep = {"format": "coslobe-sweep/1", "rows": []}
    with pytest.raises(InvalidInput, match=r"b\.json: format: coslobe-sweep/1"):
        compared(results(), sweep)
    with pytest.raises(InvalidInput, match="nothing in common"):
        compared(results(), results(index=4, objects={}, zones={}))
    with pytest.raises(InvalidInput, match="cannot be read"):
        compare_results(Path("missing.json"), Path("missing.json"), Thresholds())


def test_the_command_ends_with_status_1_where_it_does_not_hold(tmp_path):
    paths = [str(tmp_path / name) for name in ("a.json", "b.json")]
    for path, error in zip(paths, (0.02, 0.03), strict=True):
        Path(path).write_text(json.dumps(results(relative_rmse_mesh=error)))

    def run(*arguments):
        return CliRunner().invoke(app, ["eval", "--compare", *arguments])

    assert run(paths[0], paths[0]).exit_code == 0
    failed = run(*paths)
    assert failed.exit_code == 1
    assert "beyond" in failed.stdout
    assert "+50.0 %" in failed.stdout
    assert "does not hold" in failed.stdout
    assert run(*paths, "--worse", "0.6").exit_code == 0
    document = json.loads(run(*paths, "--json").stdout)
    assert document["holds"] is False
    assert run(paths[0], "missing.json").exit_code in (2, 3)
    assert run(paths[0]).exit_code == 2
