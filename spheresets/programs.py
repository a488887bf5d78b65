"""Kernels of this room, by file and name."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from coslobe.core.device import Device


def kernels(
    device: Device, unit: str, names: Sequence[str], defines: Mapping[str, int | float | str]
) -> dict[str, Any]:
    """Kernels of `kernels/<unit>` built for `device`, by name; every call gives kernels of its own."""
    from pyopencl import Kernel

    source = (files("coslobe.spheresets") / "kernels" / unit).read_text()
    program = device.build([(unit, source)], defines)
    return {name: Kernel(program, name) for name in names}
