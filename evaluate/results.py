"""Means over frames, and the long form of all numbers for data frames."""

import csv
import io
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from coslobe.evaluate.comparison import KINDS
from coslobe.evaluate.metrics import METRICS
from coslobe.evaluate.split import PARTS

TIMES = ("seconds", "kernel_seconds", "gbuffer_seconds")

COLUMNS = ("frame", "object", "zone", "reference", "metric", "value", "noise_floor")


def mean_over_frames(frames: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Means of every metric, noise and part of the error; None where a frame has none."""
    names = [f"{name}_{kind}" for name in (*METRICS, "noise") for kind in KINDS]
    mean: dict[str, Any] = {name: _mean([frame[name] for frame in frames]) for name in names}
    mean["noise_floor"] = {
        kind: {name: _mean([frame["noise_floor"][kind][name] for frame in frames]) for name in METRICS}
        for kind in KINDS
    }
    mean["split"] = {name: _mean([frame["split"][name] for frame in frames]) for name in PARTS}
    return mean


def long_form(frames: Sequence[Mapping[str, Any]]) -> str:
    """CSV with `COLUMNS`: one row per frame, object or zone ("": the whole picture), reference and metric.

    A metric's noise floor stands beside it; parts of the error are metrics "split_...".
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(COLUMNS)
    for frame in frames:
        for name, zone, part in _regions(frame):
            place = (frame["index"], name, zone)
            for kind in KINDS:
                for metric in METRICS:
                    floor = part["noise_floor"][kind][metric]
                    writer.writerow([*place, kind, metric, part[f"{metric}_{kind}"], floor])
            for metric in PARTS:
                writer.writerow([*place, "mesh", f"split_{metric}", part["split"][metric], None])
        place = (frame["index"], "", "")
        for metric in (*TIMES, "points"):
            writer.writerow([*place, "", metric, frame[metric], None])
        for kind in KINDS:
            writer.writerow([*place, kind, "seconds", frame[f"reference_seconds_{kind}"], None])
    return text.getvalue()


def _regions(frame: Mapping[str, Any]) -> Iterator[tuple[str, str, Mapping[str, Any]]]:
    yield "", "", frame
    for name, part in frame["objects"].items():
        yield name, "", part
    for name, part in frame["zones"].items():
        yield "", name, part


def _mean(values: Sequence[float | None]) -> float | None:
    known = [value for value in values if value is not None]
    return float(np.mean(known)) if known and len(known) == len(values) else None
