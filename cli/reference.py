"""`coslobe reference`: path-traced reference images."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from coslobe.cli.common import JsonOption, command, print_json, progress, say
from coslobe.cli.options import FramesOption, OutOption, SceneArgument, SetOption


class Occluders(StrEnum):
    """What `--occluders` takes."""

    mesh = "mesh"
    spheres = "spheres"


SamplesOption = Annotated[int, typer.Option(min=1, metavar="N", help="Light samples per pixel and light.")]

SAMPLES, MOST_SAMPLES = 256, 1 << 16


@command
def reference(
    scene: SceneArgument,
    out: OutOption = None,
    frames: FramesOption = None,
    spp: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Samples per pixel and light; with --error, the most that a pixel gets.",
            show_default=f"{SAMPLES}; with --error {MOST_SAMPLES}",
        ),
    ] = None,
    error: Annotated[
        float | None,
        typer.Option(
            min=1e-6,
            metavar="E",
            help="Sample where it is needed until the standard error of the image is E of its mean.",
        ),
    ] = None,
    occluders: Annotated[
        Occluders, typer.Option(help="What blocks light: the true meshes, or their sphere sets.")
    ] = Occluders.mesh,
    bounces: Annotated[
        int,
        typer.Option(min=1, metavar="N", help="Surfaces that light may meet; 1: direct light only."),
    ] = 1,
    export_mitsuba: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Render nothing: write the scene for Mitsuba 3 into DIR, one folder per frame.",
        ),
    ] = None,
    set_: SetOption = None,
    json: JsonOption = False,
) -> None:
    """Path-trace light without bias, and with the variance of every pixel."""
    from coslobe.core.device import open_device
    from coslobe.evaluate.mitsuba_export import export_frames
    from coslobe.evaluate.reference import render_references
    from coslobe.render.assets import Assets
    from coslobe.render.plan import select_frames
    from coslobe.render.scene import load_scene

    scene_file = load_scene(scene, set_ or ())
    chosen = select_frames(frames, scene_file.frames)
    samples = spp or (SAMPLES if error is None else MOST_SAMPLES)
    with progress() as listener:
        device = open_device() if occluders is Occluders.spheres else None  # where spheres have to be fitted
        assets = Assets(device, listener)
        if export_mitsuba is not None:
            settings = {"samples": spp or SAMPLES, "occluders": occluders.value, "bounces": bounces}
            files = export_frames(scene_file, export_mitsuba, frames=chosen, assets=assets, **settings)
            if json:
                print_json({"files": files})
            else:
                say(f"{export_mitsuba}: {len(files)} frames; each renders with `python render.py`")
            return
        records = render_references(
            scene_file,
            (out or Path("out", scene_file.name)) / "reference",
            frames=chosen,
            occluders=occluders.value,
            samples=samples,
            error=error,
            bounces=bounces,
            assets=assets,
            progress=listener,
        )
    if json:
        print_json({"frames": records})
        return
    for record in records:
        took = "was there already" if record["resumed"] else f"{record['seconds']:.1f} s"
        noise = f"standard error {100 * record['error']:.2g} %"
        say(f"{record['file']}: {record['spp']:g} samples per pixel, {noise}, {took}")
