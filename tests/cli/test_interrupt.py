"""A run that is interrupted by a signal: its status, what it leaves, and that the next run completes it."""

import json
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from coslobe.core.files import TEMPORARY_PREFIX
from coslobe.render.images import read_exr

COSLOBE = Path(sys.executable).with_name("coslobe")
FRAMES = 2000  # more than can be rendered before the signal


def frames_of(folder: Path) -> list[Path]:
    return sorted((folder / "frames").glob("beauty.*.exr"))


def finished(folder: Path, scene: Path, last: int) -> dict:
    """The document of a run over the frames 0 to `last`."""
    command = [COSLOBE, "render", scene, "-o", folder, "--frames", f"0:{last + 1}", "--json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=True)
    return json.loads(done.stdout)


@pytest.mark.parametrize(
    ("sent", "status"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["INT", "TERM"]
)
def test_finished_frames_survive_and_the_next_run_completes_them(tiny_scene, tmp_path, sent, status):
    text = tiny_scene.read_text().replace("frames: 4", f"frames: {FRAMES}")
    tiny_scene.write_text(text.replace("3: ", f"{FRAMES}: "))
    out = tmp_path / "out"
    process = subprocess.Popen([COSLOBE, "render", tiny_scene, "-o", out], stderr=subprocess.PIPE, text=True)
    deadline = time.monotonic() + 120
    while len(frames_of(out)) < 4:  # the last one may still lack its preview
        assert process.poll() is None, process.stderr.read()
        assert time.monotonic() < deadline
        time.sleep(0.02)
    process.send_signal(sent)
    _, complaint = process.communicate(timeout=60)

    assert process.returncode == status
    assert "finished files are kept" in complaint
    assert "Traceback" not in complaint
    assert not list(out.rglob(f"{TEMPORARY_PREFIX}*"))
    kept = {path.name: path.read_bytes() for path in frames_of(out)}
    for path in frames_of(out):
        assert read_exr(path)[0]["beauty"].shape == (16, 21, 3)
    manifest = json.loads((out / "manifest.json").read_text())
    whole = [entry["index"] for entry in manifest["frames"]]
    assert whole == list(range(len(whole)))
    assert len(whole) >= 3

    document = finished(out, tiny_scene, last=len(whole) + 1)
    resumed = [frame["resumed"] for frame in document["frames"]]
    assert resumed[: len(whole)] == [True] * len(whole)
    assert resumed[-1] is False
    fresh = finished(tmp_path / "fresh", tiny_scene, last=2)
    for frame in fresh["frames"]:
        name = Path(frame["file"]).name
        assert Path(frame["file"]).read_bytes() == kept[name] == (out / "frames" / name).read_bytes()
