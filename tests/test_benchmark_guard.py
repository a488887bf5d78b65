"""The guard of `make bench`, on invented numbers."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "benchmarks"))
import guard

RECORDED = {"cpu": {"a": 1.0, "b": 2.0, "gone": 3.0}, "gpu": {"a": 1.0}}


def test_costs_may_grow_by_fifteen_per_cent():
    assert guard.regressions({"cpu": {"a": 1.149, "b": 0.1}}, RECORDED) == []
    (found,) = guard.regressions({"cpu": {"a": 1.151, "b": 2.0}}, RECORDED)
    assert (found.device, found.name) == ("cpu", "a")
    assert "1.15 instead of 1 (+15 %)" in str(found)


def test_what_is_new_cannot_regress():
    assert guard.regressions({"cpu": {"new": 9.0}, "another": {"a": 9.0}}, RECORDED) == []


def test_recording_replaces_what_was_measured_and_keeps_the_rest(tmp_path):
    path = tmp_path / "ratios.json"
    assert guard.read(path) == {}
    guard.record(path, RECORDED)
    guard.record(path, {"cpu": {"a": 0.5}})
    assert guard.read(path) == {"cpu": {**RECORDED["cpu"], "a": 0.5}, "gpu": {"a": 1.0}}
