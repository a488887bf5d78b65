"""`coslobe eval --table1`: what parts of the shading kernel take, as in Table 1 of the 2009 paper."""

import csv
import io
import statistics
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from coslobe import configs
from coslobe.core.device import Device
from coslobe.core.files import write_json, write_text
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.cpu_time import TimedDevice
from coslobe.evaluate.provenance import provenance
from coslobe.evaluate.report.table1 import write_table1_report
from coslobe.render.assets import Assets, Blockers, world_blockers
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.methods.cosine_lobes import CosineLobes
from coslobe.render.scene import Scene, load_scene

STAGES = {
    "a": "reflectance lobes",
    "b": "lighting lobes",
    "c": "mask construction",
    "d": "mask lobes",
    "e": "integration",
}

SCENES = {
    "14": ("fig14", 0),
    "18": ("fig18", 0),
    "17(a)": ("fig17", 0),
    "17(b)": ("fig17", 1),
    "17(c)": ("fig17", 2),
}
"""Scene file and frame of each row of the table."""

PAPER = {
    "14": (29.6, 15.5, 0.0, 0.0, 54.9),
    "18": (0.3, 0.2, 82.7, 6.1, 10.7),
    "17(a)": (2.6, 2.7, 76.2, 8.1, 10.4),
    "17(b)": (1.5, 1.5, 63.0, 15.8, 18.2),
    "17(c)": (0.7, 0.7, 54.0, 20.3, 24.3),
}
"""Percent by stage, from Table 1 of Meunier et al. 2009."""

BUILDS = {
    "paper": ("POINTS", "REFLECTANCE", "CAPS", "MASK", "LEAVES", "LIGHT_LOBES", "INTEGRATION"),
    "accurate": ("POINTS", "REFLECTANCE", "CAPS", "MASK", "LEAVES", "INTEGRATION"),
}
"""Staged builds of each estimator, in the order in which its kernel works (kernels/stages.cl)."""

STAGE_OF = {
    "REFLECTANCE": "a",
    "CAPS": "b",
    "MASK": "c",
    "LEAVES": "d",
    "LIGHT_LOBES": "b",
    "INTEGRATION": "e",
}
"""The stage that each build adds; the first, which reads and writes points, is not one of the paper's."""

MAPPING = {
    "paper": {
        "a": "the lobes that the reflectance has at the point",
        "b": "the light as a cap, and the lobe that stands for it",
        "c": "lists of near blockers, their outlines in the mask, the horizon",
        "d": "the quadtree's shadow leaves, exponents and weights of their lobes",
        "e": "products with the light, products with the leaves, sums",
    },
    "accurate": {
        "a": "the lobes that the reflectance has at the point",
        "b": "the light as a cap: there is no lobe for it",
        "c": "lists of near blockers, their outlines in the mask, the horizon",
        "d": "the mask's lit cells, their number and moments: there are no lobes for them",
        "e": "lobes over the cap by table, sums over lit cells, masks of sharp lobes' own",
    },
}

ROUNDS = (15, 101)
ENOUGH_SECONDS = 4.0
"""Rounds of a scene's builds end when they took this long, within these bounds."""


def measure_table1(device: Device, progress: Progress = SILENT) -> dict[str, Any]:
    """Processor time of each stage of the shading kernel, for the scenes of Table 1 and both estimators.

    Returns
    -------
    dict
        rows: one per scene, estimator and stage: percent of the five stages, seconds, and the paper's
        percent. totals: one per scene and estimator: points, rounds, points_seconds (starting the kernel,
        reading and writing points), stage_seconds (of each stage), sum_seconds (of all that),
        fused_seconds (the kernel as it is used). mapping: what each estimator does in a stage. device:
        what it was measured on.
    """
    assets, timed = Assets(device, progress), TimedDevice(device.info)
    rows, totals = [], []
    with progress.task("stages of the kernel", len(SCENES) * len(BUILDS)) as advance:
        for name, (file, frame) in SCENES.items():
            for estimator in BUILDS:
                scene = load_scene(configs.path(file), (f"shading.estimator={estimator}",)).at(frame)
                gbuffer, blockers = trace_gbuffer(scene, assets), world_blockers(scene, assets)
                total = measure_stages(scene, gbuffer, blockers, timed)
                totals.append({"scene": name, "estimator": estimator, **total})
                rows += _rows(name, estimator, total["stage_seconds"])
                advance()
    return {"rows": rows, "totals": totals, "mapping": MAPPING, "device": device.describe()}


def measure_stages(scene: Scene, gbuffer: GBuffer, blockers: Blockers, device: TimedDevice) -> dict[str, Any]:
    """Processor time of each stage for one picture: from medians of staged builds, which take turns.

    A later build cannot take less than an earlier one; where noise says so, the stage took nothing.
    """
    builds = BUILDS[scene.shading.estimator]
    methods = [CosineLobes(device, stage="FUSED")]
    methods += [CosineLobes(device, stage=f"UP_TO_{build}") for build in builds]
    for method in methods:
        method.shade(scene, gbuffer, blockers)
    times: list[list[float]] = []
    start = time.perf_counter()
    fewest, most = ROUNDS
    while len(times) < fewest or (len(times) < most and time.perf_counter() - start < ENOUGH_SECONDS):
        times.append([_seconds(method, scene, gbuffer, blockers, device) for method in methods])
    fused, *staged = (statistics.median(column) for column in zip(*times, strict=True))
    upto = np.maximum.accumulate(staged)
    stages = dict.fromkeys(STAGES, 0.0)
    for build, seconds in zip(builds[1:], np.diff(upto), strict=True):
        stages[STAGE_OF[build]] += float(seconds)
    return {
        "points": len(gbuffer),
        "rounds": len(times),
        "points_seconds": float(upto[0]),
        "stage_seconds": stages,
        "sum_seconds": float(upto[-1]),
        "fused_seconds": fused,
    }


def _seconds(
    method: CosineLobes, scene: Scene, gbuffer: GBuffer, blockers: Blockers, device: TimedDevice
) -> float:
    method.shade(scene, gbuffer, blockers)
    return device.seconds


def _rows(scene: str, estimator: str, seconds: Mapping[str, float]) -> list[dict[str, Any]]:
    whole = sum(seconds.values()) or 1.0
    return [
        {
            "scene": scene,
            "estimator": estimator,
            "stage": stage,
            "percent": 100 * seconds[stage] / whole,
            "seconds": seconds[stage],
            "paper_percent": paper,
        }
        for stage, paper in zip(STAGES, PAPER[scene], strict=True)
    ]


def write_table1(
    out_dir: Path, *, device: Device, command: str, progress: Progress = SILENT
) -> dict[str, Any]:
    """Measure; write results.json, results.csv and report.html into `out_dir`.

    Returns
    -------
    dict
        What `measure_table1` returns, what it was measured on, and the files' paths.
    """
    document = {
        "format": "coslobe-table1/1",
        "command": command,
        **provenance(),
        **measure_table1(device, progress),
    }
    results = out_dir / "results.json"
    write_json(results, document)
    write_text(out_dir / "results.csv", _csv(document["rows"]))
    return {**document, "results": results, "report": write_table1_report(results)}


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
