"""Lighting methods by the name that the scene file gives them."""

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.render.methods.base import Method


def create_method(name: str, device: Device, progress: Progress = SILENT) -> Method:
    """The method called `name`; the scene file has been validated, so the name exists."""
    from coslobe.render.methods.cosine_lobes import CosineLobes

    return {"cosine_lobes": CosineLobes}[name](device, progress)
