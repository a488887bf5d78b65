"""Frames in order: ranges, resuming, what is written, and what an error or an interruption leaves behind."""

import json
import os
import shutil
import stat
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from PIL import Image

from coslobe.core.errors import CoslobeError, UsageError
from coslobe.core.files import TEMPORARY_PREFIX
from coslobe.core.progress import Progress
from coslobe.render import frames as frame_renderer
from coslobe.render import sequence
from coslobe.render.images import read_exr, srgb
from coslobe.render.methods.base import Shading
from coslobe.render.plan import check_layers, preview, select_frames
from coslobe.render.scene import load_scene
from coslobe.render.video import write_video


@dataclass
class Spy:
    """Stands in for a lighting method: paints normals, counts what it is asked."""

    made: int = 0
    gbuffers: list = field(default_factory=list)
    blockers: list = field(default_factory=list)
    break_at: int | None = None  # the call that returns NaN

    def create(self, name, device, progress):
        assert name == "cosine_lobes"
        self.made += 1
        return self

    def prepare(self, scene):
        pass

    def shade(self, scene, gbuffer, blockers, layers=()):
        self.gbuffers.append(gbuffer)
        self.blockers.append(blockers)
        radiance = np.abs(gbuffer.shading_normal).astype(np.float32)
        if len(self.gbuffers) - 1 == self.break_at:
            radiance[len(radiance) // 2] = np.nan
        count = np.full(len(radiance), 7, np.uint32)
        made = {name: radiance if name == "irradiance" else count for name in layers}
        return Shading(radiance, 0.25, build_seconds=2.0**-20, skipped={"leaves": 2}, layers=made)

    @property
    def calls(self) -> int:
        return len(self.gbuffers)


@dataclass
class FakeDevice:
    """What sequences want to know of a device; nothing is computed on it here."""

    class info:  # noqa: N801
        platform, version, name, vector_width = "P", "1", "D", 8

    def describe(self):
        return {"name": "D"}


@pytest.fixture
def spy(monkeypatch: pytest.MonkeyPatch) -> Spy:
    spy = Spy()
    monkeypatch.setattr(frame_renderer, "create_method", spy.create)
    monkeypatch.setattr(sequence, "find_ffmpeg", lambda: None)
    return spy


def render(scene: Path, out: Path, *overrides: str, frames=None, **options):
    scene_file = load_scene(scene, overrides)
    indices = select_frames(frames, scene_file.frames)
    return sequence.render_sequence(scene_file, out, frames=indices, device=FakeDevice(), **options)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


# --- ranges -------------------------------------------------------------------------------------------------


@given(
    st.integers(1, 40),
    st.none() | st.integers(-50, 50),
    st.none() | st.integers(-50, 50),
    st.none() | st.integers(-5, 5),
    st.booleans(),
)
def test_ranges_are_python_slices(count, start, stop, step, colon):
    def text(number):
        return "" if number is None else str(number)

    written = f"{text(start)}:{text(stop)}" + (f":{text(step)}" if step is not None or colon else "")
    if step == 0 or not (expected := list(range(count))[start:stop:step]):
        with pytest.raises(UsageError):
            select_frames(written, count)
    else:
        assert select_frames(written, count) == expected


@pytest.mark.parametrize(("text", "expected"), [("0", [0]), ("7", [7]), ("-1", [9]), ("-10", [0])])
def test_one_number_is_one_frame(text, expected):
    assert select_frames(text, 10) == expected


@pytest.mark.parametrize(
    "text", ["10", "-11", "", "a", "1.5", "1:2:3:4", "0:5:0", "5:5", "1 2", "²", "9" * 5000]
)
def test_bad_ranges_are_usage_errors_that_say_which_frames_there_are(text):
    with pytest.raises(UsageError) as error:
        select_frames(text, 10)
    assert error.value.exit_status == 2
    assert "0 to 9" in str(error.value.hint)


def test_layers_are_ordered_and_checked():
    assert check_layers(["depth", "object", "depth"]) == ("object", "depth")
    with pytest.raises(UsageError, match="did you mean normal"):
        check_layers(["normals"])
    assert check_layers(["normal", "products", "irradiance"]) == ("irradiance", "products", "normal")


# --- what is written ----------------------------------------------------------------------------------------


def test_frames_manifest_and_document(tiny_scene, tmp_path, spy):
    out = tmp_path / "out"
    document = render(tiny_scene, out, frames="1:4:2", layers=("object", "normal", "position", "depth"))
    names = [f"beauty.{index:04d}.{suffix}" for index in (1, 3) for suffix in ("exr", "png")]
    assert sorted(contents(out / "frames")) == names
    assert (document["build_seconds"], document["skipped"], document["device"]) == (
        2.0**-19,
        {"leaves": 2},
        {"name": "D"},
    )
    frame = document["frames"][0]
    assert set(frame) == {
        "index",
        "file",
        "points",
        "kernel_seconds",
        "gbuffer_seconds",
        "seconds",
        "resumed",
    }
    assert (frame["index"], frame["kernel_seconds"], frame["resumed"]) == (1, 0.25, False)
    assert frame["points"] == len(spy.gbuffers[0])
    assert frame["seconds"] >= frame["gbuffer_seconds"] > 0

    layers, attributes = read_exr(out / "frames" / "beauty.0001.exr")
    gbuffer = spy.gbuffers[0].gbuffer
    expected = gbuffer.image(np.abs(gbuffer.shading_normal).astype(np.float32))
    np.testing.assert_array_equal(layers["beauty"], expected.astype(np.float32))
    assert set(layers) == {"beauty", "object", "normal", "position", "depth"}
    covered = layers["depth"] > 0
    assert covered.sum() == frame["points"]
    assert set(np.unique(layers["object"])) == {-1, 0, 1}
    np.testing.assert_array_equal(layers["object"] >= 0, covered)
    np.testing.assert_allclose(np.linalg.norm(layers["normal"][covered], axis=-1), 1, atol=1e-6)
    on_plane = layers["object"] == 0
    np.testing.assert_allclose(layers["position"][on_plane][:, 1], 0, atol=1e-6)
    camera = np.array([-1, 1.2, 1.5])
    distance = np.linalg.norm(layers["position"][covered] - camera, axis=-1)
    np.testing.assert_allclose(distance, layers["depth"][covered], rtol=1e-6)  # single precision

    with Image.open(out / "frames" / "beauty.0001.png") as picture:
        np.testing.assert_array_equal(np.asarray(picture), np.rint(srgb(expected) * 255))

    manifest = json.loads((out / "manifest.json").read_text())
    assert [entry["index"] for entry in manifest["frames"]] == [1, 3]
    assert manifest["frames"][0]["settings_sha256"] == attributes["config_sha256"]
    assert manifest["frames"][0]["seconds"] == frame["seconds"]
    inputs = {Path(entry["file"]).name for entry in manifest["inputs"]}
    assert inputs == {"tiny.yaml", "cube.obj", "cube.spheres.json"}
    assert all(
        len(entry["sha256"]) == 64 and Path(entry["file"]).is_absolute() for entry in manifest["inputs"]
    )


def test_frames_do_not_depend_on_the_range_the_run_or_the_place(tiny_scene, tmp_path, spy):
    render(tiny_scene, tmp_path / "all")
    render(tiny_scene, tmp_path / "some", frames="2")
    moved = tmp_path / "moved"
    shutil.copytree(tiny_scene.parent, moved)
    render(moved / tiny_scene.name, tmp_path / "elsewhere", frames="2")
    everything = contents(tmp_path / "all" / "frames")
    for folder in ("some", "elsewhere"):
        for name, data in contents(tmp_path / folder / "frames").items():
            assert data == everything[name]


def test_visibility_is_traced_again_only_when_it_changes(tiny_scene, tmp_path, spy):
    render(tiny_scene, tmp_path / "still", "animation.0.target=materials.clay.phong.exponent")
    assert len({id(gbuffer) for gbuffer in spy.gbuffers}) == 1
    spy.gbuffers.clear()
    render(tiny_scene, tmp_path / "moving")
    assert len({id(gbuffer) for gbuffer in spy.gbuffers}) == 4


def test_pixels_that_are_not_finite_stop_the_run_and_are_not_written(tiny_scene, tmp_path, spy):
    spy.break_at = 2
    with pytest.raises(
        CoslobeError, match=r"beauty.0002.exr: not written: 1 pixels of beauty are not finite"
    ):
        render(tiny_scene, tmp_path)
    finished = ["beauty.0000.exr", "beauty.0000.png", "beauty.0001.exr", "beauty.0001.png"]
    assert sorted(contents(tmp_path / "frames")) == finished
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    assert [entry["index"] for entry in manifest["frames"]] == [0, 1]


# --- resuming -----------------------------------------------------------------------------------------------


def resumed(document) -> list[bool]:
    return [frame["resumed"] for frame in document["frames"]]


def test_finished_frames_are_left_alone(tiny_scene, tmp_path, spy):
    first = render(tiny_scene, tmp_path, frames="0:2")
    before = contents(tmp_path / "frames")
    manifest = json.loads((tmp_path / "manifest.json").read_text())
    second = render(tiny_scene, tmp_path)
    assert resumed(second) == [True, True, False, False]
    assert spy.calls == 4
    assert before.items() <= contents(tmp_path / "frames").items()
    entry = second["frames"][0]
    assert entry["kernel_seconds"] is entry["gbuffer_seconds"] is entry["seconds"] is None
    assert entry["points"] == first["frames"][0]["points"]
    kept = json.loads((tmp_path / "manifest.json").read_text())["frames"][:2]
    assert kept == manifest["frames"]  # with the seconds that they took

    spy.made = 0
    assert resumed(render(tiny_scene, tmp_path)) == [True] * 4
    assert spy.made == 0  # with nothing to do, no method is prepared
    assert resumed(render(tiny_scene, tmp_path, resume=False)) == [False] * 4


def change_mesh(scene: Path) -> None:
    mesh = scene.parent / "cube.obj"
    mesh.write_text(mesh.read_text().replace("0.4", "0.5"))


def change_spheres(scene: Path) -> None:
    spheres = scene.parent / "cube.spheres.json"
    spheres.write_text(spheres.read_text().replace("0.25", "0.24"))


def change_order(scene: Path) -> None:
    lines = scene.read_text().splitlines()
    ground = next(i for i, line in enumerate(lines) if line.startswith("  ground:"))
    lines[ground], lines[ground + 1] = lines[ground + 1], lines[ground]
    scene.write_text("\n".join(lines))


def test_pictures_and_tables_are_inputs(tiny_scene, tmp_path, spy):
    """Their contents count; a table's only through the numbers that are taken from it."""
    picture, table = tiny_scene.parent / "wood.png", tiny_scene.parent / "fits.csv"
    Image.new("L", (2, 2), 90).save(picture)
    table.write_text(
        "name,kd_r,kd_g,kd_b,ks_r,ks_g,ks_b,Cxy,Cz,sharpness\na,0,0,0,1,1,1,-1,1,9\nb,0,0,0,1,1,1,-1,1,9\n"
    )
    overrides = (
        "materials.floor.lambert.albedo={texture: wood.png}",
        "materials.clay={lafortune: {fit: fits.csv, name: a}}",
    )

    def again() -> list[bool]:
        return resumed(render(tiny_scene, tmp_path, *overrides, frames="0"))

    assert again() == [False]
    assert again() == [True]
    inputs = {
        Path(part["file"]).name for part in json.loads((tmp_path / "manifest.json").read_text())["inputs"]
    }
    assert {"wood.png", "fits.csv"} <= inputs
    table.write_text(table.read_text().replace("b,0", "b,1"))
    assert again() == [True]
    table.write_text(table.read_text().replace("a,0", "a,1"))
    assert again() == [False]
    Image.new("L", (2, 2), 91).save(picture)
    assert again() == [False]


def test_textures_are_looked_up_again_only_when_pictures_change(tiny_scene, tmp_path, spy):
    Image.new("L", (2, 2), 90).save(tiny_scene.parent / "wood.png")
    texture = "materials.floor={phong: {kd: 0, ks: 1, exponent: {texture: wood.png, scale: 9}}}"
    render(
        tiny_scene,
        tmp_path,
        texture,
        "animation.0.target=materials.floor.phong.exponent.scale",
        "animation.1={target: camera.fov, keys: {0: 40}}",
    )
    assert len({id(gbuffer) for gbuffer in spy.gbuffers}) == 1
    assert len(spy.gbuffers[0].texels) == 1


@pytest.mark.parametrize("change", [change_mesh, change_spheres, change_order])
def test_changed_files_are_noticed(tiny_scene, tmp_path, spy, change):
    render(tiny_scene, tmp_path, frames="0")
    change(tiny_scene)
    assert resumed(render(tiny_scene, tmp_path, frames="0")) == [False]


@pytest.mark.parametrize(
    "override",
    [
        "image.samples=4",
        "camera.fov=41",
        "materials.floor.lambert.albedo=0.6",
        "shading.mask.depth=4",
        "lights.key.sphere.radius=0.21",
        "objects.cube.normals=flat",
    ],
)
def test_changed_settings_are_noticed(tiny_scene, tmp_path, spy, override):
    render(tiny_scene, tmp_path, frames="0")
    assert resumed(render(tiny_scene, tmp_path, override, frames="0")) == [False]
    assert resumed(render(tiny_scene, tmp_path, override, frames="0")) == [True]


def test_only_frames_that_differ_are_rendered_again(tiny_scene, tmp_path, spy):
    render(tiny_scene, tmp_path)
    document = render(
        tiny_scene, tmp_path, "sequence.frames=5", "animation.0.keys={0: 0, 2: 30, 3: 45, 4: 90}"
    )
    assert resumed(document) == [True, True, True, True, False]  # 45 / 3 = 30 / 2: the same to the last bit


def test_other_layers_and_devices_are_noticed(tiny_scene, tmp_path, spy, monkeypatch):
    render(tiny_scene, tmp_path, frames="0")
    assert resumed(render(tiny_scene, tmp_path, frames="0", layers=("depth",))) == [False]
    monkeypatch.setattr(FakeDevice.info, "vector_width", 4)
    assert resumed(render(tiny_scene, tmp_path, frames="0", layers=("depth",))) == [False]


@pytest.mark.parametrize("damage", ["no preview", "no picture", "truncated", "not ours", "garbage"])
def test_damaged_frames_are_rendered_again(tiny_scene, tmp_path, spy, damage):
    from coslobe.render.images import write_exr

    render(tiny_scene, tmp_path, frames="0")
    good = contents(tmp_path / "frames")
    exr = tmp_path / "frames" / "beauty.0000.exr"
    if damage == "no preview":
        exr.with_suffix(".png").unlink()
    elif damage == "no picture":
        exr.unlink()
    elif damage == "truncated":
        exr.write_bytes(exr.read_bytes()[:200])
    elif damage == "not ours":
        write_exr(exr, {"beauty": np.zeros((2, 2, 3))}, {})
    else:
        exr.write_bytes(b"garbage" * 100)
    assert resumed(render(tiny_scene, tmp_path, frames="0")) == [False]
    assert contents(tmp_path / "frames") == good


@pytest.mark.parametrize("suffix", ["exr", "png"])
def test_what_cannot_be_replaced_is_one_clear_error(tiny_scene, tmp_path, spy, suffix):
    (tmp_path / "frames" / f"beauty.0000.{suffix}").mkdir(parents=True)
    with pytest.raises(CoslobeError, match=rf"beauty.0000.{suffix}: cannot be "):
        render(tiny_scene, tmp_path, frames="0")


def test_leftovers_of_a_killed_run_are_removed(tiny_scene, tmp_path, spy):
    frames = tmp_path / "frames"
    frames.mkdir()
    for folder in (tmp_path, frames):
        (folder / f"{TEMPORARY_PREFIX}x.exr").write_text("half")
    render(tiny_scene, tmp_path, frames="0")
    assert not list(tmp_path.rglob(f"{TEMPORARY_PREFIX}*"))


class Interrupting(Progress):
    """Interrupts the run when the given number of frames is done."""

    def __init__(self, after: int) -> None:
        self.left = after

    def task(self, name, total):
        from contextlib import contextmanager

        @contextmanager
        def task():
            def advance(amount=1.0, note=""):
                assert note.endswith(" frames/s")
                self.left -= amount
                if self.left <= 0:
                    raise KeyboardInterrupt

            yield advance

        return task()


@pytest.mark.parametrize("after", [1, 3])
def test_an_interrupted_run_is_completed_to_the_same_bytes(tiny_scene, tmp_path, spy, after):
    with pytest.raises(KeyboardInterrupt):
        render(tiny_scene, tmp_path / "a", progress=Interrupting(after))
    done = len(list((tmp_path / "a" / "frames").glob("*.exr")))
    assert done >= after  # the frames behind may have become complete in the meantime
    manifest = json.loads((tmp_path / "a" / "manifest.json").read_text())
    assert [entry["index"] for entry in manifest["frames"]] == list(range(done))
    assert resumed(render(tiny_scene, tmp_path / "a")) == [True] * done + [False] * (4 - done)
    render(tiny_scene, tmp_path / "b")
    assert contents(tmp_path / "a" / "frames") == contents(tmp_path / "b" / "frames")


def test_preview_says_what_would_be_done_and_does_nothing(tiny_scene, tmp_path, spy):
    render(tiny_scene, tmp_path, frames="1")
    before = contents(tmp_path / "frames")
    plan = preview(load_scene(tiny_scene), tmp_path, frames=[0, 1, 2], device=FakeDevice())
    assert [(frame["index"], frame["resumed"]) for frame in plan["frames"]] == [
        (0, False),
        (1, True),
        (2, False),
    ]
    assert plan["points"] == 21 * 16
    assert [entry["object"] for entry in plan["spheres"]] == ["cube"]
    assert "cube.spheres.json" in plan["spheres"][0]["source"]
    assert contents(tmp_path / "frames") == before
    assert spy.calls == 1


# --- video --------------------------------------------------------------------------------------------------


def fake_ffmpeg(folder: Path, script: str) -> str:
    """A program in ffmpeg's place."""
    path = folder / "ffmpeg"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(path.stat().st_mode | stat.S_IXUSR)
    return str(path)


def test_pictures_are_piped_to_ffmpeg_in_order(tmp_path):
    pictures = [tmp_path / f"{name}.png" for name in "ba"]
    for picture in pictures:
        picture.write_text(picture.stem)
    video = tmp_path / "sequence.mp4"
    # The last argument is the output; the arguments before it and the input are kept in it.
    ffmpeg = fake_ffmpeg(tmp_path, 'for out; do :; done; echo "$@" > "$out"; cat >> "$out"')
    write_video(video, pictures, 23.976, ffmpeg)
    text = video.read_text()
    assert "-framerate 23.976" in text
    assert "-pix_fmt yuv420p" in text
    assert text.endswith("ba")


def test_a_failing_ffmpeg_is_quoted_and_leaves_nothing(tmp_path):
    picture = tmp_path / "a.png"
    picture.write_bytes(b"x" * 10**6)  # more than a pipe holds
    ffmpeg = fake_ffmpeg(tmp_path, "echo first >&2; echo codec missing >&2; exit 1")
    with pytest.raises(CoslobeError, match="codec missing"):
        write_video(tmp_path / "v.mp4", [picture], 30, ffmpeg)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.png", "ffmpeg"]


@pytest.mark.parametrize("script", [None, "exit 1"])
def test_a_missing_or_failing_ffmpeg_does_not_fail_a_run(tiny_scene, tmp_path, spy, monkeypatch, script):
    ffmpeg = fake_ffmpeg(tmp_path, script) if script else None
    monkeypatch.setattr(sequence, "find_ffmpeg", lambda: ffmpeg)
    document = render(tiny_scene, tmp_path / "out")
    assert len(document["frames"]) == 4
    assert not (tmp_path / "out" / "sequence.mp4").exists()


@pytest.mark.skipif(shutil.which("ffmpeg") is None, reason="ffmpeg is not installed")
def test_odd_sizes_make_a_video(tiny_scene, tmp_path, spy, monkeypatch):
    monkeypatch.setattr(sequence, "find_ffmpeg", lambda: shutil.which("ffmpeg"))
    render(tiny_scene, tmp_path)
    assert os.path.getsize(tmp_path / "sequence.mp4") > 500
