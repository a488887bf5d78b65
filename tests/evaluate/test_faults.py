"""Faults turn a verdict red: each is a scene that differs from what the references see."""

import json
import re
import shutil

import pytest

from coslobe.core.device import Device, devices
from coslobe.evaluate import evaluation
from coslobe.render.scene import load_scene
from coslobe.render.sequence import render_sequence

SAMPLES = 256

LIGHT = "center: [1.0, 2.2, 0.6], radius: 0.3"


def smaller_radius(text: str) -> str:
    return text.replace("radius: 0.3", "radius: 0.294")  # 2 %


def no_cosine(text: str) -> str:
    """BRDF times cosine without the cosine: a lobe of exponent 0, which is constant over the hemisphere."""
    return re.sub(
        r"lambert: \{albedo: \[0.8, 0.7, 0.6\]\}",
        "phong_1975: {kd: 0, ks: [0.2546, 0.2228, 0.1910], exponent: 0}",
        text,
    )


def swapped_axes(text: str) -> str:
    return text.replace("center: [1.0, 2.2, 0.6]", "center: [0.6, 2.2, 1.0]")


def dropped_sphere(text: str) -> str:
    return text.replace("file: pair.spheres.json", "file: fewer.spheres.json")


FAULTS = {
    smaller_radius: "Light is integrated",
    no_cosine: "Light is integrated",
    swapped_axes: "Light is integrated",
    dropped_sphere: "A place is wrong",
}


@pytest.fixture(scope="module")
def scenes(ball_scene, tmp_path_factory):
    """The scene of two balls, and its sphere file without the second of them."""
    folder = tmp_path_factory.mktemp("faults")
    for name in ("pair.ply", "pair.spheres.json"):
        shutil.copy(ball_scene.parent / name, folder)
    spheres = json.loads((folder / "pair.spheres.json").read_text())
    for part in ("centers", "radii", "parents", "outside"):
        spheres["levels"][-1][part] = spheres["levels"][-1][part][:1]
    hierarchy = spheres["hierarchy"]
    hierarchy["child_count"] = [1]
    (folder / "fewer.spheres.json").write_text(json.dumps(spheres))
    text = ball_scene.read_text().replace("ball.ply", "pair.ply").replace("ball.spheres", "pair.spheres")
    text = text.replace("width: 48, height: 40", "width: 96, height: 80")
    assert LIGHT in text
    (folder / "scene.yaml").write_text(text)
    return folder


def verdicts_of(scenes, folder, device, text: str, monkeypatch) -> dict[str, str]:
    """Grades by title where the renderer is given `text` and the references the true scene."""
    faulty = scenes / "faulty.yaml"
    faulty.write_text(text)

    def render(scene_file, *arguments, **options):
        return render_sequence(load_scene(faulty), *arguments, **options)

    monkeypatch.setattr(evaluation, "render_sequence", render)
    document = evaluation.evaluate(
        load_scene(scenes / "scene.yaml"), folder, frames=(0,), samples=SAMPLES, device=device, command="eval"
    )
    results = json.loads(document["results"].read_text())
    return {verdict["title"]: verdict["grade"] for verdict in results["verdicts"]}


@pytest.fixture(scope="module")
def first_device():
    """One is enough: faults are in what it is given."""
    found = next((info for info in devices() if info.ok), None)
    if found is None:
        pytest.skip("no usable OpenCL device")
    return Device(found)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("evaluated")  # where references are made once


def test_without_a_fault_every_verdict_is_good(scenes, folder, first_device, monkeypatch):
    grades = verdicts_of(scenes, folder, first_device, (scenes / "scene.yaml").read_text(), monkeypatch)
    assert set(grades.values()) == {"good", "info"}


@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.__name__)
def test_a_fault_turns_a_verdict_red(scenes, folder, first_device, monkeypatch, fault):
    text = (scenes / "scene.yaml").read_text()
    assert fault(text) != text
    grades = verdicts_of(scenes, folder, first_device, fault(text), monkeypatch)
    red = [title for title, grade in grades.items() if grade == "poor"]
    assert any(title.startswith(FAULTS[fault]) for title in red), grades
