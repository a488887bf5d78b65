"""`coslobe eval --sweep`: error, time, products and leaves over one parameter of a scene."""

import csv
import io
import json
import statistics
from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.files import write_json, write_text
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import library_versions
from coslobe.evaluate.direct import Estimate, direct_light
from coslobe.evaluate.errors import compare
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.report.sweep import write_sweep_report
from coslobe.evaluate.sampling import strata
from coslobe.evaluate.sweep_figures import write_pictures, write_plot
from coslobe.evaluate.sweep_scenes import SWEEPS, Sweep, knee, parse_values, with_seed
from coslobe.render.assets import Assets, Blockers, world_blockers
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.methods import create_method
from coslobe.render.methods.base import Method
from coslobe.render.scene import Scene, SceneFile

REPEATS = 7  # timed launches; the median counts

MOST_FRAMES = 2

MEASURES = (
    "relative_rmse_spheres",
    "relative_rmse_mesh",
    "noise_spheres",
    "noise_mesh",
    "kernel_seconds",
    "products",
    "leaves",
)

COLUMNS: tuple[str, ...] = ("value", "seed", "frame", "points", *MEASURES)


def sweep_frames(count: int) -> list[int]:
    """The frames that a sweep looks at where none are named: the first and the last of `count`."""
    n = min(count, MOST_FRAMES)
    return [round(i * (count - 1) / max(n - 1, 1)) for i in range(n)]


def run_sweep(
    name: str,
    scene_file: SceneFile,
    out_dir: Path,
    *,
    values: str | None,
    frames: Sequence[int],
    seeds: int,
    samples: int,
    device: Device,
    command: str,
    beside: SceneFile | None = None,
    progress: Progress = SILENT,
) -> dict[str, Any]:
    """Sweep the parameter `name` of `SWEEPS`; write results.json, results.csv, report.html and figures/*.png.

    Every value is rendered for `seeds` seeds of the sphere fits and of the references, and all `frames`.
    The frames of the scene `beside` are shown with it, as they are.

    Returns
    -------
    dict
        results, report, sweep, rows (as `COLUMNS`), summary (means per value) and knee (a value or None).

    Raises
    ------
    UsageError
        A value cannot be had.
    CoslobeError
        A picture holds values that are not finite.
    """
    sweep = SWEEPS[name]
    chosen = parse_values(sweep, values)
    bench = _Bench(sweep, scene_file, samples, device, progress)
    shots = []
    with progress.task(f"sweep of {sweep.label}", len(chosen) * len(frames) * seeds) as advance:
        for frame in frames:
            for seed in range(seeds):
                shots += bench.shots(chosen, frame, seed, advance)
    rows = [shot.row for shot in shots]
    summary = _summary(rows)
    error = "own_mesh" if name == "spheres" else "own_spheres"
    bend = _knee(summary, error)
    shown = [shot for shot in shots if shot.row["seed"] == 0]
    document = {
        "format": "coslobe-sweep/1",
        "made": datetime.now(UTC).isoformat(timespec="seconds"),
        "command": command,
        "sweep": name,
        "label": sweep.label,
        "scene": {"file": scene_file.path, "name": scene_file.name, "settings": scene_file.data},
        "samples": samples,
        "seeds": seeds,
        "frames": list(frames),
        "rows": rows,
        "summary": summary,
        "knee": bend,
        "knee_of": error,
        "pictures": write_pictures(out_dir, name, shown, bend, _plain(beside, device, progress)),
        "device": device.describe(),
        "versions": library_versions(),
    }
    results = out_dir / "results.json"
    write_json(results, document)
    write_text(out_dir / "results.csv", _csv(rows))
    write_plot(out_dir / "figures" / f"sweep_{name}.png", json.loads(results.read_text()))
    report = write_sweep_report(results)
    return {"results": results, "report": report} | {
        key: document[key] for key in ("sweep", "rows", "summary", "knee")
    }


@dataclass(frozen=True)
class Shot:
    """One value, frame and seed.

    Attributes
    ----------
    row : dict
        See `COLUMNS`.
    radiance : float64 [h, w, 3]
    products : float64 [h, w]
        Lobe products per shaded point.
    """

    row: dict[str, Any]
    radiance: NDArray
    products: NDArray


@dataclass(frozen=True)
class _Setting:
    """What one value gives to shade."""

    value: float
    scene: Scene
    gbuffer: GBuffer
    blockers: Blockers


class _Bench:
    """Renders and path-traces the settings of a sweep; what does not change is made once."""

    def __init__(
        self, sweep: Sweep, scene_file: SceneFile, samples: int, device: Device, progress: Progress
    ) -> None:
        self._sweep, self._scene_file, self._progress = sweep, scene_file, progress
        self._samples = samples
        self._assets = Assets(device, progress)
        self._method: Method = create_method(scene_file.description.shading.method, device, progress)

    def shots(self, values: Sequence[float], frame: int, seed: int, advance: Any) -> list[Shot]:
        """All values at one frame and seed; launches take turns, so that a busy machine slows all alike."""
        start = with_seed(self._scene_file.at(frame), seed)
        settings = [self._setting(start, value) for value in values]
        times: list[list[float]] = [[] for _ in settings]
        for _ in range(REPEATS):
            for setting, seconds in zip(settings, times, strict=True):
                shading = self._method.shade(setting.scene, setting.gbuffer, setting.blockers)
                seconds.append(shading.kernel_seconds)
        shots = []
        mesh = spheres = None
        for setting, seconds in zip(settings, times, strict=True):
            if mesh is None or self._sweep.moves_reference:
                mesh = self._reference(setting, "mesh", frame, seed)
            if spheres is None or self._sweep.moves_reference or self._sweep.name == "spheres":
                spheres = self._reference(setting, "spheres", frame, seed)
            shots.append(self._shot(setting, statistics.median(seconds), frame, seed, mesh, spheres))
            advance()
        return shots

    def _setting(self, start: Scene, value: float) -> _Setting:
        scene = self._sweep.apply(start, value)
        self._method.prepare(scene)
        setting = _Setting(
            value, scene, trace_gbuffer(scene, self._assets), world_blockers(scene, self._assets)
        )
        self._method.shade(setting.scene, setting.gbuffer, setting.blockers)  # builds the program
        return setting

    def _reference(self, setting: _Setting, kind: str, frame: int, seed: int) -> Estimate:
        occluders = (mesh_occluders if kind == "mesh" else sphere_occluders)(setting.scene, self._assets)
        grid = strata(max(self._samples // self._sweep.lights(setting.value), 2))
        return direct_light(setting.scene, setting.gbuffer, occluders, grid, (seed, frame))

    def _shot(
        self,
        setting: _Setting,
        seconds: float,
        frame: int,
        seed: int,
        mesh: Estimate,
        spheres: Estimate,
    ) -> Shot:
        layers = ("products", "mask_leaves")
        shading = self._method.shade(setting.scene, setting.gbuffer, setting.blockers, layers)
        row: dict[str, Any] = {
            "value": setting.value,
            "seed": seed,
            "frame": frame,
            "points": len(shading.radiance),
        }
        for kind, truth in (("spheres", spheres), ("mesh", mesh)):
            what = f"{self._sweep.label} {setting.value:g}, frame {frame} ({kind})"
            errors = compare(shading.radiance, truth.radiance, truth.variance, what)
            row[f"relative_rmse_{kind}"], row[f"noise_{kind}"] = errors.relative_rmse, errors.noise
        row["kernel_seconds"] = seconds
        for name, layer in (("products", "products"), ("leaves", "mask_leaves")):
            row[name] = float(shading.layers[layer].mean()) if row["points"] else 0.0
        image = setting.gbuffer.image
        return Shot(
            row,
            image(shading.radiance.astype(np.float64)),
            image(shading.layers["products"].astype(np.float64)[:, None])[..., 0],
        )


def _plain(scene_file: SceneFile | None, device: Device, progress: Progress) -> dict[str, NDArray]:
    """The frames of a scene by what they show, with nothing measured: radiance [h, w, 3]."""
    if scene_file is None:
        return {}
    assets = Assets(device, progress)
    method = create_method(scene_file.description.shading.method, device, progress)
    pictures = {}
    for frame in range(scene_file.frames):
        scene = scene_file.at(frame)
        method.prepare(scene)
        gbuffer = trace_gbuffer(scene, assets)
        shading = method.shade(scene, gbuffer, world_blockers(scene, assets))
        label = f"{scene_file.name}, t_i = {scene.shading.threshold:g}"
        pictures[label] = gbuffer.image(shading.radiance.astype(np.float64))
    return pictures


def _summary(rows: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Per value the means of `MEASURES` over seeds and frames, and what follows from them.

    range_... is the spread of the errors, own_... their root mean square without the references' noise, and
    products_saved the share of the first value's products that are not made.
    """
    summary = []
    for value in sorted({row["value"] for row in rows}):
        own = [row for row in rows if row["value"] == value]
        entry: dict[str, Any] = {"value": value}
        for name in MEASURES:
            known = [row[name] for row in own if row[name] is not None]
            entry[name] = statistics.fmean(known) if known else None
        for kind in ("spheres", "mesh"):
            known = [row for row in own if row[f"relative_rmse_{kind}"] is not None]
            errors = [row[f"relative_rmse_{kind}"] for row in known]
            entry[f"range_{kind}"] = [min(errors), max(errors)] if known else None
            squares = [row[f"relative_rmse_{kind}"] ** 2 - row[f"noise_{kind}"] ** 2 for row in known]
            entry[f"own_{kind}"] = max(statistics.fmean(squares), 0.0) ** 0.5 if known else None
        first = summary[0]["products"] if summary else entry["products"]
        entry["products_saved"] = 1 - entry["products"] / first if first else None
        summary.append(entry)
    return summary


def _knee(summary: Sequence[dict[str, Any]], error: str) -> float | None:
    """The value where the error bends most, both on logarithmic scales."""
    known = [entry for entry in summary if entry["value"] > 0 and entry[error]]
    x = [float(np.log(entry["value"])) for entry in known]
    y = [float(np.log(entry[error])) for entry in known]
    at = knee(x, y)
    return None if at is None else known[at]["value"]


def _csv(rows: Sequence[dict[str, Any]]) -> str:
    text = io.StringIO()
    writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    return text.getvalue()
