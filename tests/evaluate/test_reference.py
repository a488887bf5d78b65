"""Reference images of whole scenes: meshes against spheres, files, resuming."""

from contextlib import contextmanager

import numpy as np
import pytest

from coslobe.core.errors import InvalidInput
from coslobe.core.progress import Progress
from coslobe.evaluate.errors import compare
from coslobe.evaluate.reference import read_reference, render_references
from coslobe.render.assets import Assets
from coslobe.render.images import read_exr, write_exr
from coslobe.render.scene import load_scene


def make(scene, folder, *, occluders="mesh", samples=64, frames=(0,), overrides=(), **more):
    return render_references(
        load_scene(scene, overrides),
        folder,
        frames=frames,
        occluders=occluders,
        samples=samples,
        assets=Assets(None),
        **more,
    )


def test_a_fine_icosphere_and_its_ball_cast_the_same_shadow(ball_scene, tmp_path):
    """Both references use the same random directions, so what is left is the triangles' sag.

    It is below 2e-4 of the radius; it moves the shadow's edge and lets rays graze the terminator.
    """
    mesh = read_reference(make(ball_scene, tmp_path / "mesh")[0]["file"])
    ball = read_reference(make(ball_scene, tmp_path / "ball", occluders="spheres")[0]["file"])
    errors = compare(mesh.radiance[mesh.hit], ball.radiance[mesh.hit], mesh.variance[mesh.hit])
    assert errors.relative_rmse < 0.004
    assert abs(errors.bias) < 0.001
    # and there is a shadow to speak of, on the ground and on the ball
    lit = read_reference(
        make(ball_scene, tmp_path / "lit", overrides=["objects.ball.occludes=false"])[0]["file"]
    )
    assert mesh.radiance.sum() < 0.97 * lit.radiance.sum()
    ground = mesh.object == 0
    assert (mesh.radiance[ground] == 0).any()


def test_an_object_shades_itself_in_both_references(ball_scene, tmp_path):
    """Two balls of one mesh, the upper one between the lower one and the light."""
    pair = ["objects.ball.mesh=pair.ply", "objects.ball.spheres.file=pair.spheres.json"]
    mesh = read_reference(make(ball_scene, tmp_path / "mesh", overrides=pair)[0]["file"])
    balls = read_reference(
        make(ball_scene, tmp_path / "ball", occluders="spheres", overrides=pair)[0]["file"]
    )
    own = mesh.object == 1
    errors = compare(mesh.radiance[own], balls.radiance[own], mesh.variance[own])
    assert errors.relative_rmse < 0.02
    lit = read_reference(
        make(ball_scene, tmp_path / "lit", overrides=[*pair, "objects.ball.occludes=false"])[0]["file"]
    )
    assert mesh.radiance[own].sum() < 0.8 * lit.radiance[own].sum()


@pytest.mark.parametrize("per_pixel", [1, 4])
def test_the_variance_is_that_of_independent_frames(ball_scene, tmp_path, per_pixel):
    """Frames of a still scene differ by noise only."""
    still = ["animation=[]", "sequence.frames=8", f"image.samples={per_pixel}"]
    records = make(ball_scene, tmp_path, samples=32, frames=range(8), overrides=still)
    references = [read_reference(record["file"]) for record in records]
    seen = np.var([reference.radiance for reference in references], axis=0, ddof=1).sum()
    claimed = np.mean([reference.variance for reference in references], axis=0).sum()
    # A few pixels of the highlight hold most of it: other seeds gave ratios from 0.95 to 1.10.
    assert seen / claimed == pytest.approx(1, abs=0.25)


def test_samples_of_a_pixel_share_the_budget(ball_scene, tmp_path):
    overrides = ["image.samples=4"]
    (record,) = make(ball_scene, tmp_path, samples=64, overrides=overrides)
    reference = read_reference(record["file"])
    assert record["spp"] == 64
    assert set(np.unique(reference.samples)) <= {0, 16, 32, 48, 64}
    assert reference.samples.max() == 64
    edge = (reference.samples > 0) & (reference.samples < 64)  # partly background
    assert edge.any()


def test_odd_sample_counts_are_rounded_up_and_reported(ball_scene, tmp_path):
    (record,) = make(ball_scene, tmp_path, samples=7)
    assert record["spp"] == 8
    assert read_reference(record["file"]).samples.max() == 8


@pytest.mark.parametrize("occluders", ["mesh", "spheres"])
def test_resuming_keeps_files_and_gives_the_same_bytes(ball_scene, tmp_path, occluders):
    settings = {"occluders": occluders, "samples": 16, "frames": (0, 2)}
    once = make(ball_scene, tmp_path / "once", **settings)
    contents = [record["file"].read_bytes() for record in once]
    again = make(ball_scene, tmp_path / "once", **settings)
    assert [record["resumed"] for record in again] == [True, True]
    assert [record["seconds"] for record in again] == [record["seconds"] for record in once]
    once[0]["file"].unlink()
    once[1]["file"].write_bytes(b"broken")
    third = make(ball_scene, tmp_path / "once", **settings)
    assert [record["resumed"] for record in third] == [False, False]
    assert [record["file"].read_bytes() for record in third] == contents


@pytest.mark.parametrize(
    ("changed", "settings"),
    [
        (["lights.key.sphere.radius=0.31"], {}),
        (["materials.clay.phong.exponent=21"], {}),
        (["camera.fov=41"], {}),
        ([], {"samples": 32}),
        ([], {"occluders": "spheres"}),
        ([], {"bounces": 2}),
        ([], {"error": 0.1}),
    ],
)
def test_changed_settings_are_noticed(ball_scene, tmp_path, changed, settings):
    make(ball_scene, tmp_path, samples=16)
    (record,) = make(ball_scene, tmp_path, overrides=changed, **{"samples": 16, **settings})
    assert not record["resumed"]


class Interrupts(Progress):
    """Somebody who stops the work after some blocks, and hears what was reported."""

    def __init__(self, after: int) -> None:
        self.after = after
        self.reports: list[float] = []

    @contextmanager
    def task(self, name, total):
        def advance(amount=1.0, note=""):
            reports.append(amount)
            if len(reports) > self.after:
                raise KeyboardInterrupt

        reports = self.reports
        yield advance


@pytest.mark.parametrize("settings", [{"error": 0.02}, {"bounces": 2}])
def test_an_interrupted_frame_goes_on_where_it_was(ball_scene, tmp_path, monkeypatch, settings):
    monkeypatch.setattr("coslobe.evaluate.checkpoint.INTERVAL", 0.0)  # after every block
    whole = make(ball_scene, tmp_path / "whole", **settings)[0]["file"].read_bytes()
    folder = tmp_path / "parts"
    with pytest.raises(KeyboardInterrupt):
        make(ball_scene, folder, progress=Interrupts(after=4), **settings)
    (partial,) = folder.glob("*.partial.npz")
    assert not (folder / "reference.0000.exr").exists()
    going_on = Interrupts(after=10**9)
    (record,) = make(ball_scene, folder, progress=going_on, **settings)
    assert going_on.reports[0] > 0  # what was done before
    assert record["file"].read_bytes() == whole
    assert not partial.exists()


def test_what_is_left_of_other_settings_or_broken_is_not_used(ball_scene, tmp_path, monkeypatch):
    monkeypatch.setattr("coslobe.evaluate.checkpoint.INTERVAL", 0.0)
    whole = make(ball_scene, tmp_path / "whole", samples=16)[0]["file"].read_bytes()
    for leave in ("other", "broken"):
        folder = tmp_path / leave
        with pytest.raises(KeyboardInterrupt):
            make(ball_scene, folder, samples=32, progress=Interrupts(after=3))
        (partial,) = folder.glob("*.partial.npz")
        if leave == "broken":
            partial.write_bytes(partial.read_bytes()[:100])
        (record,) = make(ball_scene, folder, samples=16)
        assert record["file"].read_bytes() == whole
        assert not partial.exists()


def test_the_error_asked_for_is_that_of_the_file(ball_scene, tmp_path):
    (record,) = make(ball_scene, tmp_path, samples=1 << 16, error=0.005)
    reference = read_reference(record["file"])
    assert 0.001 < reference.error <= 0.005
    assert record["error"] == reference.error
    assert record["spp"] == pytest.approx(reference.samples[reference.hit].mean(), abs=0.06)
    assert len(np.unique(reference.samples[reference.hit])) > 3
    same = read_reference(make(ball_scene, tmp_path / "same", samples=1024)[0]["file"])
    errors = compare(reference.radiance[same.hit], same.radiance[same.hit], same.variance[same.hit])
    expected = np.hypot(reference.error, same.error)
    assert errors.relative_rmse == pytest.approx(expected, rel=0.3)  # heavy tails of the highlight


def test_bounces_only_add_light(ball_scene, tmp_path):
    once, twice, thrice = (
        read_reference(make(ball_scene, tmp_path / str(n), bounces=n)[0]["file"]) for n in (1, 2, 3)
    )
    means = [part.radiance[part.hit].mean() for part in (once, twice, thrice)]
    assert means[0] * 1.005 < means[1] < means[2] < means[0] * 1.2
    # The same random directions for direct light: what is added is nowhere less than nothing.
    assert np.all(twice.radiance >= once.radiance)
    assert np.all(twice.variance >= once.variance)


def test_how_coslobe_shades_does_not_change_the_truth(ball_scene, tmp_path):
    make(ball_scene, tmp_path, samples=16)
    (record,) = make(ball_scene, tmp_path, samples=16, overrides=["shading.mask.depth=3"])
    assert record["resumed"]


def test_layers_of_the_file(ball_scene, tmp_path):
    (record,) = make(ball_scene, tmp_path, samples=16)
    layers, attributes = read_exr(record["file"])
    assert set(layers) == {"beauty", "variance", "spp", "object"}
    assert attributes["occluders"] == "mesh"
    reference = read_reference(record["file"])
    np.testing.assert_array_equal(reference.hit, reference.object >= 0)
    np.testing.assert_array_equal(reference.radiance[~reference.hit], 0)


def test_a_picture_is_not_taken_for_a_reference(tmp_path):
    write_exr(tmp_path / "beauty.exr", {"beauty": np.zeros((4, 4, 3))}, {})
    with pytest.raises(InvalidInput, match="no layer"):
        read_reference(tmp_path / "beauty.exr")


def test_hidden_objects_and_empty_scenes(ball_scene, tmp_path):
    (record,) = make(ball_scene, tmp_path / "a", samples=8, overrides=["objects.ball.visible=false"])
    reference = read_reference(record["file"])
    assert set(np.unique(reference.object)) <= {-1, 0}
    overrides = ["objects.ball.visible=false", "objects.ground.visible=false"]
    (record,) = make(ball_scene, tmp_path / "b", samples=8, overrides=overrides)
    assert not read_reference(record["file"]).hit.any()
    (record,) = make(ball_scene, tmp_path / "c", samples=8, overrides=["lights={}"])
    np.testing.assert_array_equal(read_reference(record["file"]).radiance, 0)
