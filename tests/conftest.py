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


CUBE = """\
v -0.2 0.0 -0.2\nv 0.2 0.0 -0.2\nv 0.2 0.4 -0.2\nv -0.2 0.4 -0.2
v -0.2 0.0 0.2\nv 0.2 0.0 0.2\nv 0.2 0.4 0.2\nv -0.2 0.4 0.2
f 1 4 3 2\nf 5 6 7 8\nf 1 2 6 5\nf 4 8 7 3\nf 1 5 8 4\nf 2 3 7 6
"""

TINY = """\
coslobe: 1
camera: {look_at: {origin: [-1, 1.2, 1.5], target: [0, 0.2, 0]}, fov: 40}
image: {width: 21, height: 16}
sequence: {frames: 4, fps: 10}
materials:
  floor: {lambert: {albedo: 0.5}}
  clay: {phong: {kd: [0.3, 0.2, 0.1], ks: 0.2, exponent: 20}}
lights:
  key: {sphere: {center: [0.5, 1.5, 0.5], radius: 0.2, radiance: [20, 18, 15]}}
objects:
  ground: {plane: {size: 2}, material: floor}
  cube: {mesh: cube.obj, spheres: {file: cube.spheres.json}, material: clay}
animation:
  - {target: objects.cube.transform.rotate_y, keys: {0: 0, 3: 45}}
  - {target: lights.key.sphere.center, keys: {0: [0.5, 1.5, 0.5], 3: [-0.5, 1.5, 0.5]}}
"""


@pytest.fixture
def tiny_scene(tmp_path: Path) -> Path:
    """A scene file of four tiny frames: a cube with one sphere on a plane, turning, and a moving light."""
    import numpy as np

    from coslobe.core.files import sha256
    from coslobe.spheresets.files import write_spheres
    from coslobe.spheresets.model import Hierarchy, MeshInfo, SphereSet, SphereTree

    folder = tmp_path / "scene"
    folder.mkdir()
    (folder / "cube.obj").write_text(CUBE)
    centers, radii, one = np.array([[0.0, 0.2, 0.0]]), np.array([0.25]), np.array([1], np.int32)
    tree = SphereTree(
        levels=(SphereSet(centers, radii, np.array([0.05])),),
        parents=(np.array([-1], np.int32),),
        hierarchy=Hierarchy(centers, radii, one, one),
        mesh=MeshInfo("cube.obj", sha256(folder / "cube.obj"), 8, 12),
        method="balanced",
        quality="fast",
        mode="balanced",
        seed=0,
        seconds=0.0,
    )
    write_spheres(folder / "cube.spheres.json", tree)
    path = folder / "tiny.yaml"
    path.write_text(TINY)
    return path
