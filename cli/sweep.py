"""`coslobe eval --sweep`: one parameter over a range."""

from enum import StrEnum
from pathlib import Path
from typing import Any

from coslobe.cli.common import print_json, progress, say


class Sweeps(StrEnum):
    """What `--sweep` takes."""

    ti = "ti"
    depth = "depth"
    spheres = "spheres"
    lights = "lights"
    exponent = "exponent"


def sweep(
    name: Sweeps,
    scene: Path | None,
    out: Path | None,
    *,
    values: str | None,
    frames: str | None,
    seeds: int,
    samples: int,
    overrides: list[str],
    wish: str | None,
    command: str,
    json: bool,
) -> None:
    """Run the sweep and print what it found; without a scene, that of the paper's figure."""
    from coslobe import configs
    from coslobe.core.device import open_device
    from coslobe.evaluate.sweep_scenes import SWEEPS
    from coslobe.evaluate.sweeps import run_sweep, sweep_frames
    from coslobe.render.plan import select_frames
    from coslobe.render.scene import load_scene

    shipped = SWEEPS[name]
    path, settings = (configs.path(shipped.scene), shipped.settings) if scene is None else (scene, ())
    scene_file = load_scene(path, [*settings, *overrides])
    chosen = sweep_frames(scene_file.frames) if frames is None else select_frames(frames, scene_file.frames)
    with progress() as listener:
        document = run_sweep(
            name,
            scene_file,
            out or Path("out", scene_file.name, f"sweep_{name}"),
            values=values,
            frames=chosen,
            seeds=seeds,
            samples=samples,
            device=open_device(wish),
            command=command,
            beside=load_scene(configs.path("fig05")) if scene is None and name is Sweeps.ti else None,
            progress=listener,
        )
    if json:
        print_json(document)
        return
    _show(document)


def _show(document: dict[str, Any]) -> None:
    from coslobe.evaluate.verdicts import duration, own_error, percent

    for entry in document["summary"]:
        spheres, mesh = (
            own_error(entry[f"own_{kind}"], entry[f"noise_{kind}"]) for kind in ("spheres", "mesh")
        )
        text = f"error {spheres} with the same spheres, {mesh} with the meshes"
        text += f", {duration(entry['kernel_seconds'])}"
        saved = entry["products_saved"]
        if saved and document["sweep"] == "ti":
            text += f", {percent(saved)} fewer products"
        say(f"{document['sweep']} {entry['value']:g}: {text}")
    if document["knee"] is not None:
        say(f"knee: {document['knee']:g}")
    say(f"report: {document['report']}")
