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


@command
def reference(
    scene: SceneArgument,
    out: OutOption = None,
    frames: FramesOption = None,
    spp: SamplesOption = 256,
    occluders: Annotated[
        Occluders, typer.Option(help="What blocks light: the true meshes, or their sphere sets.")
    ] = Occluders.mesh,
    set_: SetOption = None,
    json: JsonOption = False,
) -> None:
    """Path-trace direct light without bias, and with the variance of every pixel."""
    from coslobe.core.device import open_device
    from coslobe.evaluate.reference import render_references
    from coslobe.render.assets import Assets
    from coslobe.render.plan import select_frames
    from coslobe.render.scene import load_scene

    scene_file = load_scene(scene, set_ or ())
    folder = (out or Path("out", scene_file.name)) / "reference"
    with progress() as listener:
        device = open_device() if occluders is Occluders.spheres else None  # where spheres have to be fitted
        records = render_references(
            scene_file,
            folder,
            frames=select_frames(frames, scene_file.frames),
            occluders=occluders.value,
            samples=spp,
            assets=Assets(device, listener),
            progress=listener,
        )
    if json:
        print_json({"frames": records})
        return
    for record in records:
        took = "was there already" if record["resumed"] else f"{record['seconds']:.1f} s"
        say(f"{record['file']}: {record['spp']} samples per pixel, {took}")
