"""Points, lights and occluders as plain arrays, for tests against closed forms."""

from types import SimpleNamespace

import numpy as np
import pytest

from coslobe.evaluate.direct import Estimate, direct_light
from coslobe.evaluate.occlusion import NONE, Occluders, Spheres
from coslobe.evaluate.sampling import strata
from coslobe.render.gbuffer import GBuffer


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
            width=n,
            height=1,
            samples=1,
        )

    @staticmethod
    def lambert(albedo=1.0):
        return SimpleNamespace(lambert=SimpleNamespace(albedo=(albedo,) * 3), phong=None)

    @staticmethod
    def phong(kd=0.0, ks=1.0, exponent=50.0):
        return SimpleNamespace(
            lambert=None, phong=SimpleNamespace(kd=(kd,) * 3, ks=(ks,) * 3, exponent=exponent)
        )

    @staticmethod
    def light(center, radius, radiance=1.0):
        return SimpleNamespace(sphere=SimpleNamespace(center=center, radius=radius, radiance=(radiance,) * 3))

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
