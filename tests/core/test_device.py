"""Choosing, probing and using OpenCL devices."""

import json
import os
import re
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from coslobe.core import device as devices
from coslobe.core.errors import CoslobeError, NoDevice, UsageError

POCL_3 = "OpenCL 3.0 PoCL 3.0-rc2  Linux, Release, RELOC, LLVM 14.0.6, SLEEF, DISTRO, POCL_DEBUG"
POCL_5 = "OpenCL 3.0 PoCL 5.0+debian  Linux, None+Asserts, RELOC, SPIR, LLVM 16.0.6, SLEEF"
CUDA = "OpenCL 3.0 CUDA 12.2.79"


@pytest.fixture
def machine(monkeypatch):
    """Pretend to have the given (version, name, kind, usable) devices; returns the indices probed so far."""

    def pretend(*listed):
        raw = []
        for version, name, kind, ok in listed:
            platform = SimpleNamespace(name="Platform", version=version)
            raw.append(SimpleNamespace(platform=platform, name=name, kind=kind, ok=ok))
        probed = []

        def probe(index, device, *, fresh):
            probed.append(index)
            why = "" if device.ok else "the runtime crashed (signal 11)"
            width = 8 if device.ok else 0
            names = (device.platform.name, device.platform.version, device.name)
            return devices.DeviceInfo(index, *names, device.kind, width, device.ok, why)

        monkeypatch.setattr(devices, "raw_devices", lambda: tuple(raw))
        monkeypatch.setattr(devices, "_kind", lambda device: device.kind)
        monkeypatch.setattr(devices, "_probed", probe)
        return probed

    return pretend


THREE = (
    (POCL_3, "pthread-EPYC", "cpu", True),
    (POCL_5, "cpu-EPYC", "cpu", True),
    (CUDA, "RTX 3090", "gpu", True),
)


@pytest.mark.parametrize(
    ("wish", "index"),
    [
        (None, 2),  # a GPU before a CPU
        ("0", 0),
        ("1", 1),
        ("epyc", 1),  # any case; of several runtimes the newest
        ("PoCL 3.0", 0),
        ("3090", 2),  # no such index, so a part of a name
        ("platform opencl 3.0 cuda", 2),  # across platform and version
    ],
)
def test_wish(machine, wish, index):
    probed = machine(*THREE)
    assert devices.select(wish).index == index
    assert probed == [index]  # probing takes seconds: only what is wanted


def test_without_a_gpu_the_newest_cpu_runtime(machine):
    machine(*THREE[:2])
    assert devices.select().index == 1


def test_unusable_devices_are_passed_over(machine):
    machine(THREE[0], (*THREE[1][:3], False), (*THREE[2][:3], False))
    assert devices.select().index == 0
    assert devices.select("EPYC").index == 0


def test_unknown_device(machine):
    probed = machine(*THREE)
    with pytest.raises(UsageError, match="--device radeon: no device") as caught:
        devices.select("radeon")
    assert all(name in str(caught.value.hint) for _, name, _, _ in THREE)
    assert not probed


@pytest.mark.parametrize("wish", [None, "0"])
def test_no_device_at_all(machine, wish):
    machine()
    with pytest.raises(NoDevice, match="no OpenCL device found") as caught:
        devices.select(wish)
    assert "apt-get install pocl-opencl-icd" in str(caught.value.hint)


def test_wished_device_is_not_usable(machine):
    machine(THREE[0], (*THREE[1][:3], False))
    with pytest.raises(NoDevice, match=r"\[1\] cpu-EPYC: the runtime crashed \(signal 11\)"):
        devices.select("1")


@pytest.mark.parametrize(
    ("version", "release"),
    [
        (POCL_3, (3, 0)),
        (POCL_5, (5, 0)),
        (CUDA, (12, 2, 79)),
        ("OpenCL 3.0 LINUX", (3, 0)),
        ("OpenCL 1.2 pocl 1.1 None+Asserts, LLVM 6.0.0", (1, 1)),
        ("something else", ()),
    ],
)
def test_release(version, release):
    assert devices._release(version) == release


@pytest.fixture
def child(tmp_path, monkeypatch):
    """Let a shell script stand for the interpreter that runs the self-test: $3 is the index, $4 the width."""

    def stand_in(script):
        path = tmp_path / "interpreter"
        path.write_text(f"#!/bin/sh\n{script}\n")
        path.chmod(0o755)
        monkeypatch.setattr(devices.sys, "executable", str(path))

    return stand_in


@pytest.mark.parametrize(
    ("script", "complaint"),
    [
        ("exit 0", None),
        ("kill -SEGV $$", "the runtime crashed (signal 11)"),
        ("kill -ABRT $$", "the runtime crashed (signal 6)"),
        ("echo first >&2; echo last words >&2; exit 1", "last words"),
        ("exit 7", "exit status 7"),
        ("exec sleep 20", "no answer within 0.3 s"),
    ],
)
def test_failures_of_the_child_are_reported(child, monkeypatch, script, complaint):
    monkeypatch.setattr(devices, "PROBE_SECONDS", 0.3 if "sleep" in script else 20)
    child(script)
    assert devices._child_complaint(0, 8) == complaint


def test_narrower_vectors_where_the_widest_crash(child):
    child('[ "$4" = 16 ] && kill -SEGV $$; exit 0')
    verdict = devices._probe(0, "cpu", POCL_5)
    assert verdict == {
        "vector_width": 8,
        "ok": True,
        "why": "16-wide vectors: the runtime crashed (signal 11)",
    }


def test_nothing_works(child):
    child("kill -SEGV $$")
    verdict = devices._probe(0, "cpu", POCL_5)
    assert (verdict["vector_width"], verdict["ok"]) == (0, False)
    assert all(f"{width}-wide vectors: the runtime crashed" in verdict["why"] for width in (16, 8, 4))


def test_old_pocl_is_not_asked_for_what_hangs_it(child, tmp_path):
    child(f'echo "$4" >> {tmp_path}/widths; exit 1')
    assert not devices._probe(0, "cpu", POCL_3)["ok"]
    assert (tmp_path / "widths").read_text().split() == ["8", "4"]


@pytest.mark.parametrize(
    "text", ["", "{", "[]", '{"ok": true}', '{"vector_width": 8, "ok": true, "more": 1}']
)
def test_damaged_cache_entries_are_ignored(tmp_path, text):
    path = tmp_path / "verdict.json"
    path.write_text(text)
    assert devices._cached_verdict(path) is None


def test_real_devices_are_found_again_from_the_cache(monkeypatch):
    found = devices.devices()
    if not found:
        pytest.skip("no OpenCL device")
    monkeypatch.setattr(devices, "_probe", lambda *_: pytest.fail("probed again"))
    assert devices.devices() == found
    for info in found:
        assert info.vector_width in ((4, 8, 16) if info.ok else (0,))


def test_user_cache_that_cannot_be_written_hides_no_device(tmp_path):
    """PoCL lists no device then, unless it is given another folder: see cache.user_folder."""
    count = len(devices.raw_devices())
    if not count:
        pytest.skip("no OpenCL device")
    (tmp_path / "file").write_text("")
    code = "from coslobe.core.device import raw_devices; print(len(raw_devices()))"
    nowhere = str(tmp_path / "file" / "cache")
    environment = os.environ | {"HOME": nowhere, "XDG_CACHE_HOME": nowhere}
    command = [sys.executable, "-W", "ignore", "-c", code]
    child = subprocess.run(command, env=environment, capture_output=True, text=True, check=False)
    assert child.stdout.strip() == str(count), child.stderr


# What follows runs on every usable device.

POINTS = np.dtype([("position", np.float32, (3,)), ("object", np.int32), ("bits", np.uint32)])


def test_struct_declaration():
    assert devices.struct_declaration("Point", POINTS) == (
        "typedef struct {\n    float position[3];\n    int object;\n    uint bits;\n} Point;\n"
    )


def test_structs_have_one_layout_on_host_and_device(device):
    source = """__kernel void turn(__global Point *p, __global uint *size) {
        const int i = get_global_id(0);
        p[i].position[2] += SHIFT; p[i].object = -p[i].object; p[i].bits ^= 1u; size[i] = sizeof(Point);
    }"""
    points = np.zeros(37, POINTS)
    points["position"] = np.arange(37 * 3).reshape(37, 3)
    points["object"] = np.arange(37)
    points["bits"] = np.arange(37) << 20
    units = [("point.h", devices.struct_declaration("Point", POINTS)), ("turn.cl", source)]
    program = device.build(units, {"SHIFT": 0.1})
    buffer, size = device.upload(points), device.allocate(4 * 37)
    launch = device.launch(program.turn, 37, None, buffer, size)
    result = device.download(buffer, points.shape, POINTS)
    expected = points.copy()
    expected["position"][:, 2] += np.float32(0.1)
    expected["object"] *= -1
    expected["bits"] ^= 1
    np.testing.assert_array_equal(result, expected)
    assert (device.download(size, (37,), np.uint32) == POINTS.itemsize).all()
    assert launch.name == "turn"
    assert launch.seconds > 0


@pytest.mark.parametrize(
    "dtype",
    [
        np.dtype([("x", np.float64)]),
        np.dtype([("x", np.float32), ("small", np.int16)]),
        np.dtype({"names": ["a", "b"], "formats": [np.float32] * 2, "offsets": [0, 8]}),
    ],
)
def test_structs_that_could_differ_are_refused(dtype):
    with pytest.raises(TypeError, match=r"^Point"):
        devices.struct_declaration("Point", dtype)


def test_programs_are_built_once_per_variant(device):
    units = [("set.cl", "__kernel void set(__global int *x) { x[get_global_id(0)] = VALUE; }")]
    one, two = device.build(units, {"VALUE": 1}), device.build(units, {"VALUE": 2})
    assert device.build(units, {"VALUE": 1}) is one
    assert two is not one
    buffer = device.allocate(64 * 4)
    for program, value in ((one, 1), (two, 2)):
        device.launch(program.set, 64, 16, buffer)
        np.testing.assert_array_equal(device.download(buffer, (64,), np.int32), value)


def test_write_replaces_and_empty_arrays_pass(device):
    buffer = device.upload(np.arange(6, dtype=np.float32))
    device.write(buffer, np.arange(12, dtype=np.float32)[::2])  # not contiguous on the host
    np.testing.assert_array_equal(device.download(buffer, (2, 3), np.float32), [[0, 2, 4], [6, 8, 10]])
    empty = device.upload(np.empty((0, 3), np.float32))
    assert device.download(empty, (0, 3), np.float32).shape == (0, 3)


def test_build_errors_name_unit_and_line(device):
    units = [("good.cl", "// first\n// second\n"), ("bad.cl", "__kernel void f() {\n  nonsense = 1;\n}")]
    with pytest.raises(CoslobeError, match=r"kernels do not build") as caught:
        device.build(units, {})
    assert re.search(r"bad\.cl\D*2\b", str(caught.value))
    assert device.info.name in str(caught.value)


def test_description_is_plain_data(device):
    assert json.loads(json.dumps(device.describe())) == device.describe()


@given(st.floats(width=32, allow_nan=False, allow_infinity=False))
def test_float_literals_give_back_the_same_float32(value):
    literal = devices._literal(float(value))
    assert literal.endswith("f")
    assert re.search(r"[.e]", literal)  # 1f is no literal of C
    assert np.float32(literal[:-1]) == np.float32(value)


@pytest.mark.parametrize(
    ("value", "literal"),
    [
        (3, "3"),
        (-3, "-3"),
        (True, "1"),
        (np.float32(0.1), "0.1f"),
        (np.inf, "INFINITY"),
        (-np.inf, "-INFINITY"),
        (1e39, "INFINITY"),  # beyond float32
    ],
)
def test_literals(value, literal):
    assert devices._literal(value) == literal


def test_nan_is_no_literal():
    with pytest.raises(ValueError, match="not a number"):
        devices._literal(np.nan)
