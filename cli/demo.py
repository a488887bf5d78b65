"""`coslobe demo`: the whole main job on the bunny that comes along."""

from pathlib import Path

from coslobe.cli.common import DeviceOption, JsonOption, command, progress
from coslobe.cli.evaluate import command_line, show
from coslobe.cli.options import OutOption


@command
def demo(out: OutOption = None, device: DeviceOption = None, json: JsonOption = False) -> None:
    """Fit spheres to the Stanford bunny, render 24 frames, and measure two of them: open the report."""
    from coslobe.core.device import open_device
    from coslobe.evaluate.demo import run_demo

    with progress() as listener:
        document = run_demo(out or Path("out", "demo"), open_device(device), command_line(), listener)
    show(document, json)
