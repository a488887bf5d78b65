"""Frames in parts and in stages: the same pictures, whatever the parts."""

import time
from functools import partial

import numpy as np
import pytest

from coslobe.render import camera, frames
from coslobe.render.assets import Assets
from coslobe.render.frames import _together
from coslobe.render.images import read_exr
from coslobe.render.picture import Picture
from coslobe.render.scene import load_scene
from coslobe.render.sequence import render_sequence
from coslobe.render.visible import Viewer

LAYERS = ("irradiance", "object", "normal", "position", "depth")


def pictures(scene, out, device, layers=()):
    document = render_sequence(scene, out, frames=[0, 2], device=device, layers=layers)
    return document, [read_exr(frame["file"])[0] for frame in document["frames"]]


@pytest.mark.parametrize(
    "changes",
    [["image.samples=4"], ["shading.at=vertices", "objects.ground.plane.resolution=9"]],
    ids=["pixels", "vertices"],
)
def test_pictures_do_not_depend_on_the_parts(tiny_scene, tmp_path, device, monkeypatch, changes):
    scene = load_scene(tiny_scene, changes)
    whole, expected = pictures(scene, tmp_path / "whole", device, LAYERS)
    monkeypatch.setattr(frames, "bands", partial(camera.bands, rays=300))
    parts, found = pictures(scene, tmp_path / "parts", device, LAYERS)
    for one, other in zip(found, expected, strict=True):
        assert set(one) == {"beauty", *LAYERS}
        for name in one:
            np.testing.assert_array_equal(one[name], other[name], err_msg=name)
    assert [frame["points"] for frame in parts["frames"]] == [frame["points"] for frame in whole["frames"]]
    for name in ("pairs", "fully_lit", "penumbra", "fully_dark", "below_horizon"):
        assert parts["skipped"][name] == pytest.approx(whole["skipped"][name])


def test_a_time_budget_is_kept_by_what_a_sample_of_tiles_takes(tiny_scene, tmp_path, device, monkeypatch):
    asked = []

    def spy(method, scene, sample, share, blockers):
        asked.append((len(sample), share))
        shading = scene.shading.model_copy(update={"threshold": 1e9})
        return scene.model_copy(update={"shading": shading})

    monkeypatch.setattr(frames, "within_budget", spy)
    scene = load_scene(tiny_scene, ["image.width=128", "image.height=128", "shading.time_budget=1"])
    document, (picture, _) = pictures(scene, tmp_path, device)
    n, share = asked[0]
    assert n / document["frames"][0]["points"] == pytest.approx(share, rel=0.3)  # one block in sixteen
    assert len(asked) == 2
    assert picture["beauty"].max() == 0  # rendered at the threshold that was found: nothing is left


def test_only_layers_are_compressed(tiny_scene, tmp_path, device):
    """Shaded float32 pixels shrink by little, and compressing them takes longer than shading."""
    import OpenEXR

    for layers, compression in (((), OpenEXR.NO_COMPRESSION), (("object",), OpenEXR.ZIP_COMPRESSION)):
        document, _ = pictures(load_scene(tiny_scene), tmp_path, device, layers)
        with OpenEXR.File(str(document["frames"][0]["file"]), header_only=True) as file:
            assert file.header()["compression"] == compression


def test_seconds_add_up_to_the_run(tiny_scene, tmp_path, device):
    """Frames overlap, so each counts from the completion of the former."""
    scene = load_scene(tiny_scene)
    start = time.perf_counter()
    document = render_sequence(scene, tmp_path, frames=range(4), device=device)
    wall = time.perf_counter() - start
    seconds = [frame["seconds"] for frame in document["frames"]]
    assert min(seconds) >= 0
    assert 0 < sum(seconds) <= wall


def test_reports_of_parts_are_put_together():
    parts = [(100, {"pairs": 100, "lit": 0.5, "spheres": 8}), (300, {"pairs": 300, "lit": 0.1, "spheres": 8})]
    assert _together(parts) == pytest.approx({"pairs": 400, "lit": 0.2, "spheres": 8})
    assert _together([(0, {"points": 0, "lights": 2})] * 2) == {"points": 0, "lights": 2}


def test_samples_are_averaged_and_the_first_that_hits_stands_for_indices(tiny_scene):
    scene = load_scene(tiny_scene, ["image.samples=4"]).at(0)
    viewer = Viewer(Assets(None))
    picture = Picture(scene.image)
    for part in camera.bands(scene.image, 500):
        visible = viewer.visible(scene, part)
        gbuffer = visible.gbuffer
        picture.add(visible, {"beauty": gbuffer.position}, {"object": visible.object, "depth": gbuffer.depth})
    whole = viewer.visible(scene, camera.Part(0, 21 * 16)).gbuffer
    np.testing.assert_allclose(picture.layers["beauty"], whole.image(whole.position), atol=1e-6)
    objects = whole.first_image(whole.object.astype(np.float32), background=-1)
    np.testing.assert_array_equal(picture.layers["object"], objects)
    assert set(np.unique(objects)) == {-1, 0, 1}
    depth = whole.first_image(whole.depth, background=0)
    np.testing.assert_allclose(picture.layers["depth"], depth, rtol=1e-6)
    assert picture.points == len(whole)
