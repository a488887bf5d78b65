"""`coslobe eval --table1`: staged builds of the kernel, and what their times say."""

import csv
import json
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.evaluate import table1
from coslobe.evaluate.report.table1 import table1_html
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.methods.cosine_lobes import CosineLobes
from coslobe.render.scene import load_scene


def test_the_published_rows_are_whole():
    """All of the paper's rows add up to 100 %, within the rounding of five numbers to a decimal."""
    assert set(table1.PAPER) == set(table1.SCENES)
    for row in table1.PAPER.values():
        assert sum(row) == pytest.approx(100, abs=0.25)


@pytest.mark.parametrize("estimator", ["paper", "accurate"])
def test_a_build_of_all_stages_lights_as_the_kernel_does(ball_scene, device, estimator):
    """What keeps a stage from being optimised away changes no light; a build that ends earlier gives none."""
    changes = ("image.width=24", "image.height=20", f"shading.estimator={estimator}")
    scene = load_scene(ball_scene, changes).at(0)
    assets = Assets(device)
    gbuffer, blockers = trace_gbuffer(scene, assets), world_blockers(scene, assets)

    def shade(stage):
        return CosineLobes(device, stage=stage).shade(scene, gbuffer, blockers)

    fused, staged = shade("FUSED"), shade("UP_TO_INTEGRATION")
    assert fused.skipped["penumbra"] > 0
    # The same operations, which a compiler may contract in other places: a few units in the last place.
    np.testing.assert_allclose(staged.radiance, fused.radiance, rtol=1e-5, atol=1e-6)
    assert not shade("UP_TO_MASK").radiance.any()


TIMES = {
    "FUSED": 9.0,
    "UP_TO_POINTS": 1.0,
    "UP_TO_REFLECTANCE": 1.5,
    "UP_TO_CAPS": 2.0,
    "UP_TO_MASK": 5.0,
    "UP_TO_LEAVES": 4.5,  # by noise
    "UP_TO_LIGHT_LOBES": 6.0,
    "UP_TO_INTEGRATION": 10.0,
}


class Scripted:
    """A method whose builds take these times."""

    def __init__(self, device, *, stage):
        self.device, self.stage = device, stage

    def shade(self, scene, gbuffer, blockers):
        self.device.seconds = TIMES[self.stage]


def test_stages_are_what_builds_add(ball_scene, monkeypatch):
    """Both of the light's builds count as lighting; a stage that seems to take less than none takes none."""
    monkeypatch.setattr(table1, "CosineLobes", Scripted)
    monkeypatch.setattr(table1, "ROUNDS", (3, 3))
    scene = load_scene(ball_scene, ("shading.estimator=paper",)).at(0)
    found = table1.measure_stages(scene, cast(Any, range(7)), cast(Any, None), cast(Any, SimpleNamespace()))
    assert found["stage_seconds"] == {"a": 0.5, "b": 0.5 + 1.0, "c": 3.0, "d": 0.0, "e": 4.0}
    assert (found["points_seconds"], found["sum_seconds"], found["fused_seconds"]) == (1.0, 10.0, 9.0)
    assert (found["points"], found["rounds"]) == (7, 3)


def test_table1_end_to_end(ball_scene, tmp_path, device, monkeypatch):
    monkeypatch.setattr(table1, "SCENES", {"17(b)": ("fig17", 0)})
    monkeypatch.setattr(table1, "ROUNDS", (3, 3))
    monkeypatch.setattr(table1.configs, "path", lambda name: ball_scene)
    wish = ["--device", str(device.info.index)]
    result = CliRunner().invoke(app, ["eval", "--table1", "-o", str(tmp_path), "--json", *wish])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    rows = document["rows"]
    assert rows == json.loads((tmp_path / "results.json").read_text())["rows"]
    assert [row["stage"] for row in rows] == [*"abcde"] * 2
    assert [row["paper_percent"] for row in rows] == [1.5, 1.5, 63.0, 15.8, 18.2] * 2
    for total in document["totals"]:
        own = [row for row in rows if row["estimator"] == total["estimator"]]
        assert sum(row["percent"] for row in own) == pytest.approx(100)
        whole = total["points_seconds"] + sum(row["seconds"] for row in own)
        assert whole == pytest.approx(total["sum_seconds"])
        assert total["fused_seconds"] > 0
    with (tmp_path / "results.csv").open() as file:
        assert [row["stage"] for row in csv.DictReader(file)] == [row["stage"] for row in rows]
    page, fragment = (tmp_path / "report.html").read_text(), table1_html(document)
    for text in ("published", "63.0", "mask lobes, “accurate”", document["mapping"]["accurate"]["b"]):
        assert text in page
        assert text in fragment
    assert "http" not in page.replace("http-equiv", "")


def test_a_scene_of_ones_own_is_refused(ball_scene):
    result = CliRunner().invoke(app, ["eval", str(ball_scene), "--table1"])
    assert result.exit_code == 2
    assert "leave the scene out" in result.stderr
