"""`coslobe devices`."""

import json
from dataclasses import replace

import pytest
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.core import device

GOOD = device.DeviceInfo(0, "Portable [CL]", "OpenCL 3.0 PoCL 5.0", "cpu-EPYC", "cpu", 16, True, "")
NARROW = replace(GOOD, index=1, vector_width=8, why="16-wide vectors: the runtime crashed (signal 11)")
BROKEN = replace(GOOD, index=2, name="cpu-old", vector_width=0, ok=False, why="4-wide vectors: wrong bits")
KEYS = ["index", "platform", "version", "name", "vector_width", "ok", "why"]


@pytest.fixture
def devices(monkeypatch):
    """Run the command where the given devices are found."""

    def run(found, *options):
        monkeypatch.setattr(
            device, "devices", lambda *, fresh: list(found) if fresh else pytest.fail("no test")
        )
        return CliRunner().invoke(app, ["devices", *options])

    return run


def test_list(devices):
    result = devices([GOOD, NARROW, BROKEN])
    assert result.exit_code == 0
    assert result.stdout.splitlines() == [
        "[0] cpu-EPYC (Portable [CL], OpenCL 3.0 PoCL 5.0): ok, 16 floats wide",
        "[1] cpu-EPYC (Portable [CL], OpenCL 3.0 PoCL 5.0): ok, 8 floats wide",
        "    16-wide vectors: the runtime crashed (signal 11)",
        "[2] cpu-old (Portable [CL], OpenCL 3.0 PoCL 5.0): not usable",
        "    4-wide vectors: wrong bits",
    ]


def test_json(devices):
    result = devices([GOOD, BROKEN], "--json")
    assert result.exit_code == 0
    good, broken = json.loads(result.stdout)
    assert list(good) == list(broken) == KEYS
    assert good == {key: getattr(GOOD, key) for key in KEYS}
    assert (broken["ok"], broken["why"]) == (False, BROKEN.why)


@pytest.mark.parametrize("found", [[], [BROKEN]])
def test_without_a_usable_device_it_says_how_to_get_one(devices, found):
    result = devices(found, "--json")
    assert result.exit_code == 4
    assert len(json.loads(result.stdout)) == len(found)
    assert "apt-get install pocl-opencl-icd" in result.stderr
    assert "pip install pocl-binary-distribution" in result.stderr


def test_real_devices():
    result = CliRunner().invoke(app, ["devices", "--json"])
    found = json.loads(result.stdout)
    assert result.exit_code == (0 if any(info["ok"] for info in found) else 4)
    assert [info["index"] for info in found] == list(range(len(found)))
    for info in found:
        assert info["vector_width"] in ((4, 8, 16) if info["ok"] else (0,))
