"""Points, lights and occluders as plain arrays, for tests against closed forms."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import trimesh

from coslobe.core.files import sha256
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.integration import Estimate
from coslobe.evaluate.occlusion import NONE, Occluders, Spheres
from coslobe.evaluate.sampling import strata
from coslobe.render.gbuffer import GBuffer
from coslobe.render.scene import Material, SphereLight
from coslobe.spheresets.files import write_spheres
from coslobe.spheresets.model import Hierarchy, MeshInfo, SphereSet, SphereTree


def unit(vector) -> np.ndarray:
    vector = np.asarray(vector, np.float64)
    return vector / np.linalg.norm(vector, axis=-1, keepdims=True)


class Bench:
    """A set-up whose answer is known: many copies of one point, for statistics over pixels."""

    @staticmethod
    def points(n: int, position=(0, 0, 0), normal=(0, 1, 0), view=(0, 1, 0), owner: int = 0) -> GBuffer:
        normals = np.tile(unit(normal), (n, 1))
        zeros = np.zeros(n, np.int32)
        return GBuffer(
            position=np.tile(np.asarray(position, np.float64), (n, 1)),
            geometric_normal=normals,
            shading_normal=normals,
            view=np.tile(unit(view), (n, 1)),
            object=zeros + owner,
            material=zeros,
            pixel=np.arange(n, dtype=np.int32),
            depth=np.ones(n),
            triangle=zeros,
            weights=np.tile([1.0, 0.0, 0.0], (n, 1)),
            width=n,
            height=1,
            samples=1,
        )

    @staticmethod
    def lambert(albedo=1.0):
        return Material.model_validate({"lambert": {"albedo": albedo}})

    @staticmethod
    def phong(kd=0.0, ks=1.0, exponent=50.0):
        return Material.model_validate({"phong": {"kd": kd, "ks": ks, "exponent": exponent}})

    @staticmethod
    def light(center, radius, radiance=1.0):
        """A radius of 0 makes `radiance` an intensity."""
        emission = {"radiance" if radius else "intensity": (radiance,) * 3}
        return SimpleNamespace(
            sphere=SphereLight(center=tuple(map(float, center)), radius=radius, **emission)
        )

    @staticmethod
    def spheres(*spheres, owner=NONE, outside=0.0) -> Spheres:
        """Blockers from (center, radius) pairs."""
        n = len(spheres)
        return Spheres(
            np.array([center for center, _ in spheres], np.float64).reshape(n, 3),
            np.array([radius for _, radius in spheres], np.float64),
            np.full(n, outside),
            np.full(n, owner, np.int32),
            np.full(n, NONE, np.int32),
        )

    def estimate(self, gbuffer, light, material=None, blockers=None, samples=64, seed=0) -> Estimate:
        scene = SimpleNamespace(materials={"m": material or self.lambert()}, lights={"l": light})
        occluders = Occluders(self.spheres() if blockers is None else blockers)
        return direct_light(scene, gbuffer, occluders, strata(samples), (seed,))

    @staticmethod
    def z_score(estimate: Estimate, exact: float) -> float:
        """How many standard errors the mean over all points is off the exact value."""
        mean = estimate.radiance[:, 0].mean()
        error = np.sqrt(estimate.variance[:, 0].sum()) / len(estimate.variance)
        return float((mean - exact) / error)


@pytest.fixture
def bench() -> Bench:
    return Bench()


BALL = 0.3

SCENE = """
coslobe: 1
camera: {look_at: {origin: [-1.5, 1.6, 2.2], target: [0, 0.2, 0]}, fov: 40}
image: {width: 48, height: 40}
sequence: {frames: 3}
materials:
  floor: {lambert: {albedo: [0.8, 0.7, 0.6]}}
  clay: {phong: {kd: 0.3, ks: 0.2, exponent: 20}}
lights:
  key: {sphere: {center: [1.0, 2.2, 0.6], radius: 0.3, radiance: [30, 28, 25]}}
objects:
  ground: {plane: {size: 6.0}, material: floor}
  ball:
    mesh: ball.ply
    spheres: {file: ball.spheres.json}
    material: clay
    transform: {translate: [0, 0.35, 0]}
animation:
  - {target: objects.ball.transform.translate, keys: {0: [0, 0.35, 0], 2: [0.2, 0.35, 0]}}
"""


def write_balls(folder: Path, name: str, centers: np.ndarray) -> None:
    """NAME.ply with a fine icosphere around each centre, and NAME.spheres.json with the balls themselves.

    The vertices lie on the balls; the middles of the triangles sink in by at most edge^2 / (8 radius).
    """
    n = len(centers)
    mesh = trimesh.util.concatenate(
        [
            trimesh.creation.icosphere(subdivisions=5, radius=BALL).apply_translation(center)
            for center in centers
        ]
    )
    mesh.export(folder / f"{name}.ply")
    balls = SphereSet(np.asarray(centers, np.float64), np.full(n, BALL), np.full(n, BALL * 1e-3))
    one = np.ones(1, np.int32)
    tree = SphereTree(
        levels=(balls,),
        parents=(np.full(n, -1, np.int32),),
        hierarchy=Hierarchy(np.mean(centers, axis=0)[None], np.array([2 * BALL]), one, n * one),
        mesh=MeshInfo(f"{name}.ply", sha256(folder / f"{name}.ply"), len(mesh.vertices), len(mesh.faces)),
        method="balanced",
        quality="fast",
        mode="balanced",
        seed=0,
        seconds=0.0,
        metrics={},
    )
    write_spheres(folder / f"{name}.spheres.json", tree)


@pytest.fixture(scope="session")
def ball_scene(tmp_path_factory) -> Path:
    """A scene with one ball as mesh and as sphere set; `pair`, two balls in a row, lies beside it."""
    folder = tmp_path_factory.mktemp("ball")
    write_balls(folder, "ball", np.zeros((1, 3)))
    write_balls(folder, "pair", np.array([[-0.12, 0, -0.07], [0.25, 0.43, 0.15]]))
    path = folder / "scene.yaml"
    path.write_text(SCENE)
    return path
