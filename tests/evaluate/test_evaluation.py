"""The whole of `coslobe eval`: renders, references, errors, files, and the report page."""

import csv
import json
import re
import shutil

import numpy as np
import pytest

from coslobe.evaluate import evaluation
from coslobe.evaluate.report import write_report
from coslobe.evaluate.report.tables import skip_table
from coslobe.evaluate.verdicts import percent
from coslobe.render.images import read_exr, write_exr
from coslobe.render.scene import load_scene

SAMPLES = 256


@pytest.fixture(scope="module")
def evaluated(ball_scene, device, tmp_path_factory):
    """The ball scene, two of its three frames compared: the returned document and the folder."""
    folder = tmp_path_factory.mktemp("eval")
    return run(ball_scene, folder, device), folder


def run(scene, folder, device, **overrides):
    settings = {"frames": (0, 2), "rendered": range(3), "samples": SAMPLES, **overrides}
    return evaluation.evaluate(
        load_scene(scene), folder, device=device, command="coslobe eval scene.yaml", **settings
    )


def test_the_renderer_agrees_with_the_reference_on_the_same_spheres(evaluated):
    """One sphere, Lambert and Phong: within 0.5 % besides the reference's noise."""
    document, _ = evaluated
    for frame in document["frames"]:
        excess = frame["relative_rmse_spheres"] ** 2 - frame["noise_spheres"] ** 2
        assert excess < 0.005**2
        assert abs(frame["bias_spheres"]) < 0.001
        assert 0 < frame["noise_spheres"] < 0.01
        assert set(frame["objects"]) == {"ground", "ball"}


def test_an_injected_fault_is_seen(evaluated, ball_scene, device, tmp_path):
    """A picture 2 % too bright on one object shows as that bias there, and nowhere else."""
    document, made = evaluated
    folder = shutil.copytree(made, tmp_path / "faulty")
    path = folder / "frames" / "beauty.0000.exr"
    layers, attributes = read_exr(path)
    reference, _ = read_exr(folder / "reference" / "reference.0000.exr")
    ball = reference["object"] == 1
    layers["beauty"][ball] *= 1.02
    write_exr(path, layers, attributes)
    frame = run(ball_scene, folder, device)["frames"][0]
    before = document["frames"][0]["objects"]
    after = frame["objects"]
    assert after["ball"]["bias_mesh"] - before["ball"]["bias_mesh"] == pytest.approx(0.02, rel=0.01)
    for name in ("relative_rmse_mesh", "bias_spheres", "psnr_mesh"):  # of pixels, not of neighbourhoods
        assert after["ground"][name] == before["ground"][name]


def test_results_hold_what_the_contract_names(evaluated):
    document, folder = evaluated
    assert set(document) == {"results", "report", "frames"}
    assert not any("pictures" in frame for frame in document["frames"])  # whose paths are relative
    results = json.loads((folder / "results.json").read_text())
    assert [frame["index"] for frame in results["frames"]] == [0, 2]
    for frame in results["frames"]:
        names = {"relative_rmse_mesh", "relative_rmse_spheres", "bias_mesh", "mean_abs_mesh", "points"}
        assert names <= set(frame)
        assert frame["kernel_seconds"] > 0
        assert frame["spp"] == SAMPLES
    assert [frame["index"] for frame in results["render"]["frames"]] == [0, 1, 2]
    assert {verdict["grade"] for verdict in results["verdicts"]} <= {"good", "fair", "poor", "info"}
    for name in ("relative_rmse_mesh", "noise_spheres"):
        values = [frame[name] for frame in results["frames"]]
        assert results["mean"][name] == pytest.approx(np.mean(values))


def test_figures_are_named_and_there(evaluated):
    _, folder = evaluated
    names = {path.name for path in (folder / "figures").iterdir()}
    kinds = (
        *("comparison", "zones", "part_geometry", "part_visibility", "part_lobes"),
        *("error_mesh", "error_spheres", "reference_mesh", "reference_spheres"),
    )
    assert names == {f"{kind}.{index:04d}.png" for kind in kinds for index in (0, 2)}


def test_the_table_is_in_long_form(evaluated):
    document, folder = evaluated
    with open(folder / "results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    (row,) = (
        row
        for row in rows
        if (row["frame"], row["object"], row["reference"], row["metric"]) == ("2", "ball", "mesh", "bias")
    )
    ball = document["frames"][1]["objects"]["ball"]
    assert float(row["value"]) == ball["bias_mesh"]
    assert float(row["noise_floor"]) == ball["noise_floor"]["mesh"]["bias"]
    assert len({tuple(row.values())[:5] for row in rows}) == len(rows)  # nothing twice
    assert {row["zone"] for row in rows} == {"", "lit", "penumbra", "umbra"}


def test_a_second_run_keeps_everything_and_its_times(evaluated, ball_scene, device):
    document, folder = evaluated
    frames = {path: path.stat().st_mtime_ns for path in folder.rglob("*.exr")}
    again = run(ball_scene, folder, device)
    assert {path: path.stat().st_mtime_ns for path in folder.rglob("*.exr")} == frames
    assert again["frames"] == document["frames"]


def test_the_report_is_self_contained(evaluated):
    _, folder = evaluated
    page = (folder / "report.html").read_text()
    assert "default-src 'none'" in page  # nothing is loaded, whatever the page says
    assert re.findall(r'(?:src|href)="(?!data:image/(?:png|jpeg);base64,)', page) == []
    assert re.findall(r"url\(|@import|https?://", page) == []
    assert page.count("data:image/png") == 18  # nine pictures for each of two frames
    assert page.count("data:image/jpeg") == 3  # the sequence
    for text in ("Frame 2", "relative RMSE", "coslobe eval scene.yaml", "ground", "ball"):
        assert text in page


def test_texts_in_the_report_are_escaped(evaluated, tmp_path):
    _, folder = evaluated
    evil = "<script>alert('x')</script>\"><img src=x onerror=alert(1)>"
    results = json.loads((folder / "results.json").read_text())
    for frame in results["frames"]:
        frame["objects"] = {evil: frame["objects"]["ball"]}
        for picture in frame["pictures"]:
            picture["label"] = evil
            picture["file"] = str(folder / picture["file"])
            picture["exr"] = picture["exr"] and str(folder / picture["exr"])
    results["scene"]["name"] = results["scene"]["file"] = results["command"] = evil
    results["render"]["device"]["name"] = results["versions"]["numpy"] = evil
    results["verdicts"][0] |= {"title": evil, "text": evil}
    (tmp_path / "results.json").write_text(json.dumps(results))
    page = write_report(tmp_path / "results.json").read_text()
    assert evil not in page
    assert "<img src=x" not in page
    assert page.count("<script>") == 1  # our own
    assert "&lt;script&gt;alert" in page


def test_one_frame_and_no_surface(ball_scene, device, tmp_path):
    scene = ball_scene.with_name("empty.yaml")
    text = ball_scene.read_text().replace("  ground: {", "  ground: {visible: false, ")
    scene.write_text(text.replace("mesh: ball.ply", "visible: false\n    mesh: ball.ply"))
    document = run(scene, tmp_path, device, frames=(0,), rendered=None, samples=4)
    (frame,) = document["frames"]
    assert frame["points"] == 0
    assert frame["relative_rmse_mesh"] is None
    assert "Nothing to judge" in document["report"].read_text()


def test_what_was_skipped_is_a_table_of_what_the_renderer_reports():
    table = skip_table({"fully_lit": 0.25, "spheres_tested_per_pair": 3.0, "pairs": 4096})
    assert [cell.text for _, cell in table.rows] == [percent(0.25), "3.0"]
