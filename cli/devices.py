"""`coslobe devices`: which OpenCL devices there are, and whether each computes correctly."""

from dataclasses import asdict

from coslobe.cli.common import JsonOption, command, print_json, progress, say
from coslobe.core.errors import NoDevice


@command
def devices(json: JsonOption = False) -> None:
    """List OpenCL devices with the vector width chosen for each and the result of a numeric self-test."""
    from coslobe.core import device

    with progress() as listener, listener.task("testing devices", 1) as advance:
        found = device.devices(fresh=True)
        advance()
    if json:
        keys = ("index", "platform", "version", "name", "vector_width", "ok", "why")
        print_json([{key: asdict(info)[key] for key in keys} for info in found])
    for info in found if not json else ():
        verdict = f"ok, {info.vector_width} floats wide" if info.ok else "not usable"
        say(f"[{info.index}] {info.name} ({info.platform}, {info.version}): {verdict}")
        if info.why:
            say(f"    {info.why}")
    if not any(info.ok for info in found):
        raise NoDevice("no usable OpenCL device", device.INSTALL_HINT)
