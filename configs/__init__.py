"""The scenes that come with coslobe."""

from importlib.resources import files
from pathlib import Path


def path(name: str) -> Path:
    """The scene file NAME.yaml of this folder, as in `path("bunny")`."""
    return Path(str(files(__package__) / f"{name}.yaml"))
