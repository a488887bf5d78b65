"""`coslobe render`: the frames of a scene as pictures and a video."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated, Any

import typer

from coslobe.cli.common import DeviceOption, JsonOption, command, print_json, progress, say
from coslobe.cli.options import FramesOption, OutOption, SceneArgument, SetOption


class Estimator(StrEnum):
    """What `--estimator` takes."""

    accurate = "accurate"
    paper = "paper"


@command
def render(
    scene: SceneArgument,
    out: OutOption = None,
    frames: FramesOption = None,
    estimator: Annotated[Estimator | None, typer.Option(help="Same as --set shading.estimator=...")] = None,
    layers: Annotated[
        str | None,
        typer.Option(
            metavar="NAME,...",
            help="Also store: irradiance, products, mask_leaves, object, normal, position, depth.",
        ),
    ] = None,
    set_: SetOption = None,
    device: DeviceOption = None,
    no_resume: Annotated[
        bool, typer.Option("--no-resume", help="Render all frames, also those that are up to date.")
    ] = False,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="Print what would be done, and stop.")] = False,
    json: JsonOption = False,
) -> None:
    """Render a scene to EXR and PNG pictures, and to a video where ffmpeg is installed."""
    from coslobe.core.device import open_device
    from coslobe.render.plan import check_layers, preview, select_frames
    from coslobe.render.scene import load_scene
    from coslobe.render.sequence import render_sequence

    overrides = [*(set_ or ()), *([f"shading.estimator={estimator.value}"] if estimator else ())]
    scene_file = load_scene(scene, overrides)
    folder = out or Path("out", scene_file.name)
    settings: dict[str, Any] = {
        "frames": select_frames(frames, scene_file.frames),
        "layers": check_layers([name.strip() for name in layers.split(",")] if layers else []),
        "resume": not no_resume,
        "device": open_device(device),
    }
    with progress() as listener:
        work = preview if dry_run else render_sequence
        document = work(scene_file, folder, **settings, progress=listener)
    if json:
        print_json(document)
    elif dry_run:
        _print_preview(document, folder)
    else:
        _print_result(document, folder)


def _print_preview(document: dict[str, Any], folder: Path) -> None:
    wanted = [frame["index"] for frame in document["frames"] if not frame["resumed"]]
    done = [frame["index"] for frame in document["frames"] if frame["resumed"]]
    say(f"to render: {_listed(wanted)} -> {folder / 'frames'}")
    say(f"up to date: {_listed(done)}")
    say(f"shaded points: up to {document['points']:,} per frame")
    for spheres in document["spheres"]:
        say(f"spheres of {spheres['object']}: {spheres['source']}")


def _listed(frames: list[int]) -> str:
    """ "3 frames (0, 1, 2)", shortened where there are many."""
    if not frames:
        return "no frame"
    names = [str(frame) for frame in frames]
    if len(names) > 8:
        names[3:-1] = ["..."]
    return f"{len(frames)} frame{'s' * (len(frames) > 1)} ({', '.join(names)})"


def _print_result(document: dict[str, Any], folder: Path) -> None:
    frames = document["frames"]
    seconds = [frame["seconds"] for frame in frames if not frame["resumed"]]
    speed = f" ({len(seconds) / sum(seconds):.2f} frames/s)" if seconds else ""
    resumed = f", {len(frames) - len(seconds)} up to date" if len(seconds) < len(frames) else ""
    say(f"{len(seconds)} rendered{speed}{resumed}: {folder / 'frames'}")
    video = folder / "sequence.mp4"
    if len(frames) > 1 and video.is_file():
        say(f"video: {video}")
