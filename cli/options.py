"""Arguments and options that several commands take."""

from pathlib import Path
from typing import Annotated

import typer

SceneArgument = Annotated[
    Path, typer.Argument(metavar="SCENE", help="Scene file (YAML).", exists=True, dir_okay=False)
]
FramesOption = Annotated[
    str | None,
    typer.Option(metavar="A:B[:S]", help="Frames, half-open like a Python slice; one number is one frame."),
]
SetOption = Annotated[
    list[str] | None,
    typer.Option("--set", metavar="PATH=VALUE", help="Change a value of the scene, as in image.samples=4."),
]
OutOption = Annotated[
    Path | None,
    typer.Option("-o", "--out", metavar="DIR", help="Output folder.", show_default="out/<scene name>"),
]
