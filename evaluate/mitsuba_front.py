"""Mitsuba 3 beside coslobe: the same picture by its `direct` integrator, timed in a process of its own.

Its vectorised variant needs a libLLVM, and an unsuitable one ends the process: 15 does, 19 works. Where it
does, the scalar variant takes its place.
"""

import json
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError
from coslobe.core.progress import SILENT, Progress

VARIANTS = ("llvm_ad_rgb", "scalar_rgb")
SAMPLES = (1, 4, 16, 64, 256)  # squares: the sampler stratifies them best
RUNS = 7
LONGEST = 12.0
"""Seconds of one run beyond which no more samples are tried."""

ROW = '{"variant"'  # how a row of the child begins; what the packages print may stand before it


def mitsuba_front(
    scene: Path,
    overrides: Sequence[str],
    frame: int,
    progress: Progress = SILENT,
    *,
    near_clip: float | None = None,
    samples: Sequence[int] = SAMPLES,
    name: str = "Mitsuba",
) -> Iterator[tuple[dict[str, Any], NDArray]]:
    """By number of samples: {variant, samples, seconds, cpu_seconds} of several runs, and their pictures.

    From each run's time that of a render is taken off which only casts the same primary rays. `near_clip` is
    where the camera begins to see. The pictures' mean and the variance of one of them: float64 [2, h, w, 3].

    Raises
    ------
    CoslobeError
        Mitsuba is not installed, cannot express the scene, or works in no variant.
    """
    task = {
        "scene": str(scene),
        "overrides": list(overrides),
        "frame": frame,
        "near_clip": near_clip,
        "samples": list(samples),
    }
    reason = ""
    for variant in VARIANTS:
        with (
            tempfile.TemporaryDirectory(prefix="coslobe-mitsuba-") as folder,
            progress.task(name, len(samples)) as advance,
        ):
            command = [sys.executable, "-m", "coslobe.evaluate.mitsuba_front", folder]
            with (
                Path(folder, "complaints").open("w+") as complaints,
                subprocess.Popen(
                    command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=complaints, text=True
                ) as child,
            ):
                assert child.stdin is not None
                assert child.stdout is not None
                some = False
                try:
                    child.stdin.write(json.dumps({**task, "variant": variant}))
                    child.stdin.close()
                    for line in child.stdout:
                        if (start := line.find(ROW)) >= 0:
                            some = True
                            row = json.loads(line[start:])
                            yield row, np.load(Path(folder, f"{row['samples']}.npy"))
                            advance()
                finally:
                    child.kill()
                complaints.seek(0)
                complaint = complaints.read().strip().splitlines()
            # The last line of a traceback, without the exception's name.
            reason = complaint[-1].split("Error: ", 1)[-1] if complaint else "its process ended"
            if some:
                return
    raise CoslobeError(f"Mitsuba cannot render {scene}: {reason}", "pip install 'coslobe[mitsuba]'")


def measured(folder: Path, task: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """In the child: one row per number of samples; their pictures are written into `folder`."""
    from coslobe.evaluate.crosscheck import load_mitsuba, mitsuba_scene
    from coslobe.render.assets import Assets
    from coslobe.render.scene import load_scene

    variant = task["variant"]
    mitsuba = load_mitsuba(variant)
    scene = load_scene(task["scene"], task["overrides"]).at(task["frame"])
    if variant.startswith("scalar") and any(
        material.lambert is None for material in scene.materials.values()
    ):
        raise CoslobeError("the scalar variant would time the BSDF that is written in Python")
    described = mitsuba_scene(mitsuba, scene, Assets(None), 1, folder)
    described["sensor"]["sampler"]["type"] = "multijitter"
    if task["near_clip"] is not None:
        described["sensor"]["near_clip"] = task["near_clip"]
    loaded = mitsuba.load_dict(described)
    direct, primary = loaded.integrator(), mitsuba.load_dict({"type": "depth"})
    for samples in task["samples"]:
        runs, pictures = [], []
        for seed in range(RUNS + 1):
            seconds, cpu_seconds, picture = _timed(mitsuba, loaded, direct, samples, seed)
            without, cpu_without, _ = _timed(mitsuba, loaded, primary, samples, seed)
            runs.append((seconds - without, cpu_seconds - cpu_without, seconds))
            pictures.append(picture)
        del runs[0]  # the warm-up
        np.save(
            folder / f"{samples}.npy", np.stack([np.mean(pictures, axis=0), np.var(pictures, axis=0, ddof=1)])
        )
        row = {
            "variant": variant,
            "samples": samples,
            "seconds": [run[0] for run in runs],
            "cpu_seconds": [run[1] for run in runs],
        }
        yield row
        if max(run[2] for run in runs) > LONGEST:
            return


def _timed(
    mitsuba: Any, scene: Any, integrator: Any, samples: int, seed: int
) -> tuple[float, float, NDArray]:
    """Wall-clock and CPU seconds of a render, and its picture."""
    start, cpu = time.perf_counter(), time.process_time()
    picture = np.array(mitsuba.render(scene, integrator=integrator, spp=samples, seed=seed), np.float64)
    return time.perf_counter() - start, time.process_time() - cpu, picture


if __name__ == "__main__":
    for found in measured(Path(sys.argv[1]), json.loads(sys.stdin.read())):
        print(json.dumps(found), flush=True)
