"""`coslobe eval --pareto`: error against time of coslobe, Embree and Mitsuba 3, in one run on one machine."""

import csv
import io
import statistics
import time
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.errors import CoslobeError
from coslobe.core.files import write_json, write_text
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.embree_front import embree_front
from coslobe.evaluate.errors import compare
from coslobe.evaluate.fronts import best_speedups, with_speedups
from coslobe.evaluate.integration import Estimate
from coslobe.evaluate.mitsuba_front import mitsuba_front
from coslobe.evaluate.pareto_bench import Bench, fitted, set_up
from coslobe.evaluate.provenance import provenance
from coslobe.evaluate.report.pareto import write_pareto_report
from coslobe.evaluate.truth import cached_truth
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.methods import create_method

COUNTS = (16, 64, 256, 1024)
DEPTHS = (2, 3, 4, 5)
RUNS = 7
WARM_UP = 1

ERRORS = {"lambert": 1e-3, "phong 50": 4e-3, "phong 1000": 1e-2}
ERROR = 2e-3
"""Standard error of the references, relative to their mean, by material and of others: well below the errors
that are compared."""

NEAR = 1e-3
"""So far above the ground does Mitsuba's camera begin to see in the scene whose meshes are hidden from it."""


def measure_fronts(
    scene: Path | None,
    out_dir: Path,
    *,
    overrides: Sequence[str] = (),
    frame: str | None = None,
    counts: Sequence[int] = COUNTS,
    devices: Sequence[Device],
    command: str,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Measure all renderers; write results.json, results.csv, report.html and figures/*.png.

    Without a `scene`, a bunny on a plane, of which only the plane is shaded, in three materials. `frame` is
    as `--frames` has it; of several the first is taken. `counts` are the numbers of spheres that are tried.

    Returns
    -------
    dict
        rows, speedups and what they were measured on (docs/benchmarks.md).

    Raises
    ------
    CoslobeError
        The scene has no lit point, or a file cannot be used or written.
    """
    assets = Assets(devices[0], progress)
    bench = set_up(scene, tuple(overrides), frame, assets)
    truths = {
        name: cached_truth(
            bench.scene(name),
            bench.gbuffer.some(bench.known),
            assets,
            "mesh",
            ERRORS.get(name, ERROR),
            progress,
        )
        for name in bench.materials
    }
    for name, truth in truths.items():
        if not truth.radiance.any():
            raise CoslobeError(
                f"{bench.path}: {name}: no point is lit", "compare a frame that shows some light"
            )
    rows: list[dict[str, Any]] = []
    notes: list[str] = []
    for device in devices:
        rows += _coslobe_rows(bench, truths, counts, device, progress)
    rows += _embree_rows(bench, truths, progress)
    try:
        rows += _mitsuba_rows(bench, truths, progress)
    except CoslobeError as error:
        notes.append(str(error))
        progress.say(str(error))
    rows = with_speedups(rows)
    document = {
        "format": "coslobe-pareto/1",
        "command": command,
        **provenance(),
        "scene": {"file": bench.path, "overrides": list(overrides), "frame": bench.frame},
        "points": len(bench.gbuffer.position),
        "known_points": len(bench.known),
        "contact_share": float(1 - bench.apart.mean()),
        "noise": {name: _noise(truth) for name, truth in truths.items()},
        "devices": [device.describe() for device in devices],
        "rows": rows,
        "speedups": best_speedups(rows),
        "notes": notes,
    }
    results = out_dir / "results.json"
    write_json(results, document)
    write_text(out_dir / "results.csv", _csv(rows))
    report = write_pareto_report(results)
    return {**document, "results": results, "report": report}


def _settings(counts: Sequence[int | None]) -> Iterator[tuple[int | None, str, int]]:
    """(spheres, estimator, depth): all for `accurate`; a line through the grid either way for `paper`."""
    for count in counts:
        yield from ((count, "accurate", depth) for depth in DEPTHS)
        depths = DEPTHS if count in (256, None) else DEPTHS[-1:]
        yield from ((count, "paper", depth) for depth in depths)


def _coslobe_rows(
    bench: Bench,
    truths: Mapping[str, Estimate],
    counts: Sequence[int | None],
    device: Device,
    progress: Progress,
) -> Iterator[dict[str, Any]]:
    method = create_method("cosine_lobes", device, progress)
    scene = bench.scene(next(iter(bench.materials)))
    settings = list(_settings(counts if fitted(scene) else (None,)))
    with progress.task(f"coslobe on {device.info.version}", len(settings) * len(bench.materials)) as advance:
        for material in bench.materials:
            for count, estimator, depth in settings:
                scene = bench.scene(material, count)
                shading = scene.shading.model_copy(
                    update={
                        "estimator": estimator,
                        "mask": scene.shading.mask.model_copy(update={"depth": depth}),
                    }
                )
                scene = scene.model_copy(update={"shading": shading})
                blockers = world_blockers(scene, bench.assets)
                runs = []
                for _ in range(WARM_UP + RUNS):
                    start, cpu = time.perf_counter(), time.process_time()
                    shaded = method.shade(scene, bench.gbuffer, blockers)
                    wall, cpu = time.perf_counter() - start, time.process_time() - cpu
                    runs.append((shaded.kernel_seconds, wall, cpu))
                seconds, wall, cpu = (statistics.median(run[k] for run in runs[WARM_UP:]) for k in range(3))
                image = shaded.radiance.astype(np.float64)
                spheres = cached_truth(
                    scene,
                    bench.gbuffer.some(bench.few),
                    bench.assets,
                    "spheres",
                    ERRORS.get(material, ERROR),
                    progress,
                )
                yield {
                    "renderer": "coslobe",
                    "material": material,
                    "setting": {"estimator": estimator, "depth": depth, "spheres": len(blockers.radii)},
                    "device": device.info.name,
                    "runtime": device.info.version,
                    "seconds": seconds,
                    "wall_seconds": wall,
                    "cpu_seconds": cpu,
                    "points": len(image),
                    **_errors(bench, image[bench.known], truths[material]),
                    "relative_rmse_spheres": _rmse(image[bench.few], spheres),
                    "noise_spheres": _noise(spheres),
                    "skipped": shaded.skipped,
                }
                advance()


def _embree_rows(
    bench: Bench, truths: Mapping[str, Estimate], progress: Progress
) -> Iterator[dict[str, Any]]:
    scenes = {name: bench.scene(name) for name in bench.materials}
    for count, timing in embree_front(scenes, bench.gbuffer, bench.known, bench.assets, progress):
        for material, radiance in timing.radiance.items():
            yield {
                "renderer": "embree",
                "material": material,
                "setting": {"rays": count},
                "device": "host",
                "runtime": "Embree through Open3D",
                **timing.medians(),
                "points": timing.points,
                **_errors(bench, radiance, truths[material]),
                "relative_rmse_spheres": None,
            }


def _mitsuba_rows(
    bench: Bench, truths: Mapping[str, Estimate], progress: Progress
) -> Iterator[dict[str, Any]]:
    scene = bench.scene(next(iter(bench.materials)))
    origin, target = (np.asarray(getattr(scene.camera.look_at, end)) for end in ("origin", "target"))
    near = float(np.linalg.norm(target - origin)) - NEAR if bench.ground_only else None
    pixels = bench.gbuffer.pixel[bench.known]
    for material, changes in bench.materials.items():
        overrides = (*bench.overrides, *changes, "image.samples=1")
        for found, pictures in mitsuba_front(
            bench.path, overrides, bench.frame, progress, near_clip=near, name=f"Mitsuba, {material}"
        ):
            seconds = statistics.median(found["seconds"])
            if seconds <= 0:  # below what the primary rays' time varies
                continue
            yield {
                "renderer": "mitsuba",
                "material": material,
                "setting": {"samples": found["samples"]},
                "device": "host",
                "runtime": f"Mitsuba 3, {found['variant']}",
                "seconds": seconds,
                "cpu_seconds": statistics.median(found["cpu_seconds"]),
                "points": len(bench.gbuffer.position),
                **_own_errors(bench, pictures.reshape(2, -1, 3)[1, pixels], truths[material]),
                "relative_rmse_spheres": None,
                "bias": float(
                    pictures.reshape(2, -1, 3)[0, pixels].sum() / truths[material].radiance.sum() - 1
                ),
            }


def _own_errors(bench: Bench, variance: NDArray, truth: Estimate) -> dict[str, float]:
    """Of a picture whose mean counts as the truth: Mitsuba's pixels are areas, those of all others points."""
    mean = truth.radiance.mean()
    return {
        "relative_rmse_mesh": float(np.sqrt(variance.mean()) / mean),
        "relative_rmse_mesh_no_contact": float(np.sqrt(variance[bench.apart].mean()) / mean),
    }


def _errors(bench: Bench, image: NDArray, truth: Estimate) -> dict[str, float]:
    apart = bench.apart
    found = compare(image[apart], truth.radiance[apart], truth.variance[apart])
    scale = truth.radiance[apart].mean() / truth.radiance.mean()  # in units of the whole picture's mean
    return {
        "relative_rmse_mesh": _rmse(image, truth),
        "relative_rmse_mesh_no_contact": (found.relative_rmse or 0.0) * float(scale),
    }


def _rmse(image: NDArray, truth: Estimate) -> float:
    return compare(image, truth.radiance, truth.variance).relative_rmse or 0.0


def _noise(truth: Estimate) -> float:
    return compare(truth.radiance, truth.radiance, truth.variance).noise or 0.0


def _csv(rows: Sequence[Mapping[str, Any]]) -> str:
    """One line per row; what only some renderers have is empty for the others."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    settings = ("spheres", "estimator", "depth", "rays", "samples")
    values = (
        "seconds",
        "wall_seconds",
        "cpu_seconds",
        "points",
        "relative_rmse_mesh",
        "relative_rmse_mesh_no_contact",
        "relative_rmse_spheres",
    )
    rivals = ("embree", "mitsuba")
    writer.writerow(
        ["renderer", "material", "device", "runtime", *settings, *values, *(f"speedup_{r}" for r in rivals)]
    )
    for row in rows:
        writer.writerow(
            [
                *(row[name] for name in ("renderer", "material", "device", "runtime")),
                *(row["setting"].get(name) for name in settings),
                *(row.get(name) for name in values),
                *(row.get("speedup", {}).get(rival, {}).get("speedup") for rival in rivals),
            ]
        )
    return text.getvalue()
