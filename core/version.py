"""Versions of the installed package and of what it stands on."""

import platform
from contextlib import suppress
from importlib.metadata import PackageNotFoundError, version

try:
    VERSION = version("coslobe")
except PackageNotFoundError:  # imported from a source tree that was never installed
    VERSION = "0+unknown"


def library_versions() -> dict[str, str]:
    """Versions of coslobe, Python, and the packages that results depend on."""
    versions = {"coslobe": VERSION, "python": platform.python_version()}
    for package in ("numpy", "open3d", "open3d-cpu", "OpenEXR", "pyopencl"):
        with suppress(PackageNotFoundError):
            versions[package] = version(package)
    return versions
