"""The variational fit: covers of exact counts that lose to none of their parts."""

import numpy as np
import pytest
import trimesh
from scipy.optimize import minimize

from coslobe.core.progress import Progress
from coslobe.spheresets.balanced import Balanced
from coslobe.spheresets.closed_surface import closed_surface
from coslobe.spheresets.clusters import Clusters
from coslobe.spheresets.medial import Medial
from coslobe.spheresets.outside_volume import OutsideVolume
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.starts import greedy_start
from coslobe.spheresets.variational import Variational


@pytest.fixture(scope="module")
def torus(mesh_of) -> Solid:
    return Solid(mesh_of(trimesh.creation.torus(1.0, 0.3, major_sections=48, minor_sections=24)))


@pytest.fixture(scope="module")
def fits(torus, one_device) -> Variational:
    return Variational(torus, FitSettings(method="variational"), one_device)


@pytest.fixture(scope="module")
def volume(torus, one_device) -> OutsideVolume:
    return OutsideVolume(one_device, torus.triangles, torus.inside)


def uncovered(points, spheres) -> int:
    holds = [
        (np.linalg.norm(part[:, None] - spheres[:, :3], axis=2) <= spheres[:, 3]).any(1)
        for part in np.array_split(points, 50)
    ]
    return int((~np.concatenate(holds)).sum())


@pytest.mark.parametrize("count", [2, 7, 40])
def test_exactly_as_many_spheres_as_asked_for_cover_everything(torus, fits, count):
    spheres = fits.fit(count, coarse=True)
    assert spheres.shape == (count, 4)
    assert np.isfinite(spheres).all()
    assert (spheres[:, 3] > 0).all()
    assert uncovered(torus.sample_surface(100_000, np.random.default_rng(77)), spheres) == 0


def test_one_sphere_is_the_smallest_around_the_torus(torus, fits):
    sphere = fits.fit(1, coarse=True)[0] * torus.size
    # along the axis the radius is flat: 0.02 aside costs 0.0002
    np.testing.assert_array_less(np.abs(sphere - [0, 0, 0, 1.3]), [0.005, 0.005, 0.05, 0.002])


def test_a_fit_does_not_lose_to_its_start(torus, fits, volume, one_device):
    start = Medial(torus, FitSettings(method="medial"), one_device).fit(12, coarse=True)
    assert volume.total(fits.fit(12, coarse=True)) < 0.99 * volume.total(start)


def test_the_same_seed_gives_the_same_bits(torus, fits, one_device):
    again = Variational(torus, FitSettings(method="variational"), one_device)
    np.testing.assert_array_equal(fits.fit(9, coarse=True), again.fit(9, coarse=True))


@pytest.fixture(scope="module")
def clusters(torus, volume) -> Clusters:
    return Clusters(volume, torus.sample_surface(1500, np.random.default_rng(5)))


@pytest.fixture(scope="module")
def started(torus, one_device):
    points = Balanced(torus, FitSettings(), one_device).samples(12).points
    return greedy_start(points, 12, 0, np.random.default_rng(0))


def test_points_are_held_and_centers_found_as_well_as_by_powell(clusters, started, volume):
    owners = clusters._owners(started)
    moved = clusters._moved(started, owners)
    found = []
    for k in np.unique(owners):
        points = clusters._points[owners == k]
        assert uncovered(points, moved[[k]] * [1, 1, 1, 1 + 1e-12]) == 0

        def around(center, points=points):
            return volume.total(np.array([[*center, np.linalg.norm(points - center, axis=1).max()]]))

        options = {"xtol": 1e-3, "ftol": 1e-3}
        found.append(minimize(around, started[k, :3], method="Powell", options=options).fun)
    assert volume.total(moved) < 1.02 * sum(found)  # measured: 0.99


def test_a_useless_sphere_teleports_to_where_most_is_outside(clusters, started, volume):
    """Two of twelve spheres in one place: one goes, and the fit is better for it."""
    doubled = started.copy()
    doubled[1] = doubled[0]
    stuck = clusters.improved(doubled, 6)
    away = clusters.improved(next(clusters.teleported(stuck)), 6)
    assert away.shape == stuck.shape
    assert volume.total(away) < volume.total(stuck)


def test_an_open_mesh_is_covered_with_a_line_that_says_how(mesh_of, one_device):
    part = trimesh.creation.icosphere(subdivisions=3)
    part.update_faces(part.triangles_center[:, 1] > -0.9)
    solid = Solid(mesh_of(part))
    assert not closed_surface(solid)[1]

    class Lines(Progress):
        def __init__(self):
            self.lines = []

        def say(self, text):
            self.lines.append(text)

    lines = Lines()
    spheres = Variational(solid, FitSettings(method="variational"), one_device).fit(
        3, coarse=True, progress=lines
    )
    assert any("voxels" in line for line in lines.lines)
    assert uncovered(solid.sample_surface(50_000, np.random.default_rng(1)), spheres) == 0


@pytest.mark.slow
def test_the_bunny_reaches_its_target(one_device):
    """Asked for: 0.45 of the volume; a rival measured 0.375 with 56 spheres; measured here: 0.23."""
    from coslobe.spheresets.mesh import load_mesh
    from coslobe.spheresets.metrics import measure
    from coslobe.spheresets.model import SphereSet

    solid = Solid(load_mesh("sample:bunny"))
    spheres = Variational(solid, FitSettings(method="variational"), one_device).fit(64)
    assert uncovered(solid.sample_surface(100_000, np.random.default_rng(77)), spheres) == 0
    placed = solid.center + solid.size * spheres[:, :3], solid.size * spheres[:, 3], np.zeros(64)
    assert measure(solid, SphereSet(*placed), one_device)["sum_outside_volume"] < 0.28
