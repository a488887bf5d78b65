"""Shared libraries that Open3D and pymeshlab load from the system, with the Debian packages that hold them.

`scripts/prepare.py` reads this file before anything is installed, so it needs nothing but Python itself.
"""

import ctypes

DEBIAN_PACKAGES = {
    "libEGL.so.1": "libegl1",
    "libGL.so.1": "libgl1",
    "libOpenGL.so.0": "libopengl0",
    "libX11.so.6": "libx11-6",
    "libgomp.so.1": "libgomp1",
    "libusb-1.0.so.0": "libusb-1.0-0",
}


def missing() -> list[str]:
    """Names of those libraries that cannot be loaded."""
    return [name for name in DEBIAN_PACKAGES if not _loads(name)]


def _loads(name: str) -> bool:
    try:
        ctypes.CDLL(name)
    except OSError:
        return False
    return True
