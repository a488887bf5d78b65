"""`coslobe eval --pareto`: small runs of all renderers, and that they light the same points alike."""

import csv
import json

import numpy as np
import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.core.errors import CoslobeError
from coslobe.evaluate import mitsuba_front as mitsuba
from coslobe.evaluate import pareto
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.embree_front import embree_front, stratified
from coslobe.evaluate.errors import compare
from coslobe.evaluate.occlusion import mesh_occluders
from coslobe.evaluate.sampling import strata
from coslobe.evaluate.truth import cached_truth
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import load_scene

SMALL = ("image.width=24", "image.height=20", "materials.clay={lambert: {albedo: 0.5}}")


def at(path, *overrides):
    return load_scene(path, (*SMALL, *overrides)).at(0)


@pytest.mark.parametrize("count", [1, 2, 8, 64])
def test_every_cell_of_the_grid_gets_one_sample(count):
    u, v = stratified(count, 5, np.random.default_rng(0))
    rows = 2 ** (int(np.log2(count)) // 2)
    cell = np.floor(u * rows) * (count // rows) + np.floor(v * (count // rows))
    assert (np.sort(cell, axis=1) == np.arange(count)).all()


def test_embree_meets_the_reference_and_its_error_falls(ball_scene):
    """As an independent estimate of the same light, it differs by its own noise only."""
    scene = at(ball_scene)
    assets = Assets(None)
    gbuffer = trace_gbuffer(scene, assets)
    known = np.random.default_rng(0).permutation(len(gbuffer.position))[:200]
    truth = direct_light(scene, gbuffer.some(known), mesh_occluders(scene, assets), strata(4096), (0,))
    found = dict(embree_front({"scene": scene}, gbuffer, known, assets, rays=(1, 16, 1024)))
    errors = [
        compare(timing.radiance["scene"], truth.radiance, truth.variance).relative_rmse or 0.0
        for timing in found.values()
    ]
    assert errors[0] > 3 * errors[1] > 9 * errors[2]
    assert errors[2] < 0.005  # 1024 stratified rays; measured: 0.2 %
    assert all(timing.points == len(gbuffer.position) for timing in found.values())
    assert all(len(timing.seconds) >= 7 and min(timing.seconds) > 0 for timing in found.values())


def test_a_truth_is_made_once_and_by_content(ball_scene, monkeypatch):
    scene = at(ball_scene, "image.width=6", "image.height=5")
    assets = Assets(None)
    gbuffer = trace_gbuffer(scene, assets)
    first = cached_truth(scene, gbuffer, assets, "mesh", 0.05)
    monkeypatch.setattr("coslobe.evaluate.truth.direct_sources", None)  # not called again
    again = cached_truth(scene, gbuffer, assets, "mesh", 0.05)
    assert np.array_equal(first.radiance, again.radiance)
    assert np.array_equal(first.variance, again.variance)
    brighter = at(ball_scene, "image.width=6", "image.height=5", "lights.key.sphere.radiance=31")
    with pytest.raises(TypeError):
        cached_truth(brighter, gbuffer, assets, "mesh", 0.05)


def test_pareto_end_to_end(ball_scene, tmp_path, device, monkeypatch):
    monkeypatch.setattr(pareto, "ERROR", 0.01)
    monkeypatch.setattr(pareto, "DEPTHS", (3, 5))

    def invented(scene, overrides, frame, progress, *, near_clip, name):
        assert near_clip is None
        for samples in (1, 4):
            yield (
                {"variant": "invented", "samples": samples, "seconds": [samples], "cpu_seconds": [samples]},
                np.full((2, 20, 24, 3), 0.01 / samples),
            )

    monkeypatch.setattr(pareto, "mitsuba_front", invented)
    sets = [argument for change in SMALL for argument in ("--set", change)]
    arguments = ["eval", str(ball_scene), "--pareto", *sets, "-o", str(tmp_path), "--json"]
    result = CliRunner().invoke(app, [*arguments, "--device", str(device.info.index)])
    assert result.exit_code == 0, result.output
    document = json.loads(result.stdout)
    assert document["rows"] == json.loads((tmp_path / "results.json").read_text())["rows"]
    keys = {"renderer", "material", "setting", "device", "seconds", "points"}
    keys |= {"relative_rmse_mesh", "relative_rmse_spheres"}
    assert all(keys <= set(row) for row in document["rows"])
    assert {row["renderer"] for row in document["rows"]} == {"coslobe", "embree", "mitsuba"}
    ours = [row for row in document["rows"] if row["renderer"] == "coslobe"]
    assert {(row["setting"]["estimator"], row["setting"]["depth"]) for row in ours} == {
        (estimator, depth) for estimator in ("accurate", "paper") for depth in (3, 5)
    }
    assert {row["setting"]["spheres"] for row in ours} == {1}
    assert all(0 < row["seconds"] <= row["wall_seconds"] for row in ours)
    assert {found["against"] for found in document["speedups"]} == {"embree", "mitsuba"}
    wanted = {"against", "material", "spheres", "device", "at_error", "speedup"}
    assert all(wanted <= set(found) for found in document["speedups"])
    with (tmp_path / "results.csv").open() as file:
        assert len(list(csv.DictReader(file))) == len(document["rows"])
    page = (tmp_path / "report.html").read_text()
    assert '<svg class="plot"' in page
    assert "http" not in page.replace("http-equiv", "")
    assert (tmp_path / "figures" / "fronts.scene.png").is_file()


def test_mitsuba_in_a_process_of_its_own(ball_scene, monkeypatch):
    """A variant that fails gives way to the next; more samples vary less."""
    pytest.importorskip("mitsuba", reason="mitsuba is not installed")
    monkeypatch.setattr(mitsuba, "VARIANTS", ("no_such_variant", "scalar_rgb"))
    found = list(mitsuba.mitsuba_front(ball_scene, SMALL, 0, samples=(1, 16)))
    assert [row["samples"] for row, _ in found] == [1, 16]
    assert all(row["variant"] == "scalar_rgb" and len(row["seconds"]) == mitsuba.RUNS for row, _ in found)
    few, many = (pictures for _, pictures in found)
    assert few.shape == (2, 20, 24, 3)
    assert many[1].mean() < few[1].mean() / 8  # variances; independent samples would give 1/16
    assert many[0].mean() == pytest.approx(few[0].mean(), rel=0.1)


def test_a_mitsuba_that_cannot_be_had_is_named(ball_scene, monkeypatch):
    monkeypatch.setattr(mitsuba, "VARIANTS", ("no_such_variant",))
    with pytest.raises(CoslobeError, match="Mitsuba"):
        list(mitsuba.mitsuba_front(ball_scene, SMALL, 0, samples=(1,)))


def test_a_picture_without_light_is_refused(ball_scene, tmp_path):
    dark = ["--set", "lights.key.sphere.radiance=0"]
    arguments = ["eval", str(ball_scene), "--pareto", *dark, "-o", str(tmp_path)]
    result = CliRunner().invoke(app, [*arguments, "--set", "image.width=4", "--set", "image.height=4"])
    assert result.exit_code == 1
    assert "no point is lit" in result.stderr
