"""Kernels of this room, by file and name."""

from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

from coslobe.core.device import Device


def kernels(
    device: Device, units: Sequence[str], names: Sequence[str], defines: Mapping[str, int | float | str]
) -> dict[str, Any]:
    """Kernels of the files `kernels/<unit>` in order, built for `device`; every call gives its own."""
    from pyopencl import Kernel

    folder = files("coslobe.spheresets") / "kernels"
    program = device.build([(unit, (folder / unit).read_text()) for unit in units], defines)
    return {name: Kernel(program, name) for name in names}
