"""What all tests share: a cache of their own, OpenCL devices, and the data folder beside the repository."""

import os
import shutil
import tempfile
from pathlib import Path

import pytest

DATA = Path(__file__).parents[2] / "shared" / "data"


def pytest_configure(config: pytest.Config) -> None:
    """Give the session a cache of its own before anything, the search for devices included, can use it."""
    folder = tempfile.mkdtemp(prefix="coslobe-test-cache-")
    os.environ["COSLOBE_CACHE_DIR"] = folder
    config.add_cleanup(lambda: shutil.rmtree(folder, ignore_errors=True))


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run tests that take `device` on every usable OpenCL device."""
    if "device" not in metafunc.fixturenames:
        return
    from coslobe.core.device import devices

    infos = [info for info in devices() if info.ok]
    names = [f"{info.index}-{info.platform.split()[0]}" for info in infos]
    if infos:
        metafunc.parametrize("device", infos, indirect=True, ids=names, scope="session")
    else:
        skip = pytest.mark.skip(reason="no usable OpenCL device")
        metafunc.parametrize("device", [pytest.param(None, marks=skip)], indirect=True, ids=["none"])


@pytest.fixture(scope="session")
def device(request: pytest.FixtureRequest):
    """An opened OpenCL device; tests that take it run once per usable device."""
    from coslobe.core.device import Device

    return Device(request.param)


@pytest.fixture(scope="session")
def data() -> Path:
    """The folder of meshes, environment maps and BRDF tables; tests skip where it is absent."""
    if not DATA.is_dir():
        pytest.skip(f"test data not found at {DATA}")
    return DATA
