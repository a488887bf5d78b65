"""`coslobe eval`: how wrong, how fast, and compared with what."""

import shlex
import sys
from pathlib import Path
from typing import Annotated, Any

import typer

from coslobe.cli.common import DeviceOption, JsonOption, command, print_json, progress, say
from coslobe.cli.compare import compare as compare_runs
from coslobe.cli.options import FramesOption, OutOption, SetOption
from coslobe.cli.paper import rebuild as rebuild_paper
from coslobe.cli.reference import SamplesOption
from coslobe.cli.sweep import Sweeps
from coslobe.cli.sweep import sweep as run_sweep
from coslobe.cli.table1 import measure_stages
from coslobe.core.errors import UsageError


@command
def evaluate(
    scene: Annotated[
        Path | None,
        typer.Argument(
            metavar="[SCENE]",
            help="Scene file (YAML).",
            exists=True,
            dir_okay=False,
            show_default="the bunny of the paper's Fig. 17; Fig. 16 for --sweep ti",
        ),
    ] = None,
    out: OutOption = None,
    frames: FramesOption = None,
    spp: SamplesOption = 256,
    set_: SetOption = None,
    sweep: Annotated[
        Sweeps | None, typer.Option(help="Vary one parameter; see --values and --seeds.")
    ] = None,
    values: Annotated[
        str | None, typer.Option(metavar="V,V,...", help="Values of the sweep, instead of its own.")
    ] = None,
    seeds: Annotated[
        int, typer.Option(min=1, metavar="N", help="Seeds of sphere fits and references in a sweep.")
    ] = 2,
    compare: Annotated[
        tuple[Path, Path] | None,
        typer.Option(
            metavar="A.json B.json", help="Say what changed from results A to B, and whether it holds."
        ),
    ] = None,
    worse: Annotated[
        float, typer.Option(min=0, metavar="SHARE", help="With --compare: by how much errors may grow.")
    ] = 0.05,
    slower: Annotated[
        float | None,
        typer.Option(
            min=0, metavar="SHARE", help="With --compare: by how much times may; by any if left out."
        ),
    ] = None,
    pareto: Annotated[
        bool, typer.Option("--pareto", help="Error against time, beside Embree and Mitsuba, on all devices.")
    ] = False,
    paper: Annotated[
        bool,
        typer.Option(
            "--paper", help="Rebuild the figures of the 2009 paper and its Table 1, beside its numbers."
        ),
    ] = False,
    table1: Annotated[
        bool, typer.Option("--table1", help="Time of the shading kernel by stage, as in the paper's Table 1.")
    ] = False,
    device: DeviceOption = None,
    json: JsonOption = False,
) -> None:
    """Render a scene, path-trace references of it, and report errors and times."""
    modes = {
        "--compare": compare is not None,
        "--sweep": sweep is not None,
        "--pareto": pareto,
        "--paper": paper,
        "--table1": table1,
    }
    check_modes([mode for mode, asked in modes.items() if asked], frames=frames, overrides=set_)
    if compare is not None:
        compare_runs(*compare, error=worse, time=slower, json=json)
        return
    if values is not None and sweep is None:
        raise UsageError("--values goes with --sweep", "say what to vary, as in --sweep ti")
    if sweep is not None:
        run_sweep(
            sweep,
            scene,
            out,
            values=values,
            frames=frames,
            seeds=seeds,
            samples=spp,
            overrides=set_ or [],
            wish=device,
            command=command_line(),
            json=json,
        )
        return
    if paper:
        rebuild_paper(scene, out, device, command=command_line(), json=json)
        return
    if table1:
        measure_stages(scene, out, device, command=command_line(), json=json)
        return
    if pareto:
        measure_pareto(scene, out, frames, set_, device, json)
        return
    from coslobe import configs
    from coslobe.core.device import open_device
    from coslobe.evaluate import evaluation
    from coslobe.render.plan import select_frames
    from coslobe.render.scene import load_scene

    scene_file = load_scene(scene or configs.path("fig17"), set_ or ())
    with progress() as listener:
        document = evaluation.evaluate(
            scene_file,
            out or Path("out", scene_file.name),
            frames=select_frames(frames, scene_file.frames),
            samples=spp,
            device=open_device(device),
            command=command_line(),
            progress=listener,
        )
    show(document, json)


def check_modes(modes: list[str], *, frames: str | None, overrides: list[str] | None) -> None:
    """At most one kind of evaluation, and no changes to scenes where none is read."""
    if len(modes) > 1:
        raise UsageError(f"{' and '.join(modes)} do not go together", "run them one after the other")
    fixed = {"--compare", "--paper", "--table1"}.intersection(modes)
    given = [name for name, value in {"--frames": frames, "--set": overrides}.items() if value]
    if fixed and given:
        raise UsageError(f"{modes[0]} takes no {given[0]}", f"leave {given[0]} out")


def measure_pareto(
    scene: Path | None,
    out: Path | None,
    frames: str | None,
    set_: list[str] | None,
    wish: str | None,
    json: bool,
) -> None:
    """`--pareto`: all devices, unless one is wished for."""
    from coslobe.core.device import Device, devices, open_device
    from coslobe.evaluate.pareto import measure_fronts

    opened = [open_device(wish)]
    if wish is None:
        first = opened[0].info
        opened += [Device(info) for info in devices() if info.ok and info.index != first.index]
    with progress() as listener:
        document = measure_fronts(
            scene,
            out or Path("out", "pareto" if scene is None else scene.stem),
            overrides=set_ or (),
            frame=frames,
            devices=opened,
            command=command_line(),
            progress=listener,
        )
    if json:
        print_json(document)
        return
    for found in document["speedups"]:
        ratio = f"{found['speedup']:.3g}x{' (extrapolated)' if found['extrapolated'] else ''}"
        what = f"{found['material']}, {found['spheres']} spheres, {found['device']}"
        say(f"{ratio} as fast as {found['against']} at {100 * found['at_error']:.2g} % error: {what}")
    say(f"report: {document['report']}")


def command_line() -> str:
    """What was typed, for the report."""
    return shlex.join(["coslobe", *sys.argv[1:]])


def show(document: dict[str, Any], json: bool) -> None:
    """Print the result of an evaluation."""
    from coslobe.evaluate.verdicts import percent

    if json:
        print_json(document)
        return
    for frame in document["frames"]:
        spheres, noise, mesh = (
            percent(frame[name]) for name in ("relative_rmse_spheres", "noise_spheres", "relative_rmse_mesh")
        )
        text = f"error {spheres} with the same spheres (noise {noise}), {mesh} with the meshes"
        say(f"frame {frame['index']}: {text}")
    say(f"report: {document['report']}")
