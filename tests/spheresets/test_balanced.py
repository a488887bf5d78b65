"""The balanced fit: exact counts, close fits of shapes with known answers, repeatability, equivariance."""

import numpy as np
import pytest
import trimesh

from coslobe.spheresets.balanced import Balanced
from coslobe.spheresets.line_samples import draw_lines
from coslobe.spheresets.metrics import measure, silhouette_ious
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.search import Search
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.starts import greedy_start
from coslobe.spheresets.union import Union


def fits(solid: Solid, device, seed: int = 0, quality: str = "fast") -> Balanced:
    return Balanced(solid, FitSettings(quality=quality, seed=seed), device)


@pytest.fixture(scope="module")
def torus(mesh_of) -> Solid:
    return Solid(mesh_of(trimesh.creation.torus(1.0, 0.3, major_sections=96, minor_sections=48)))


@pytest.fixture(scope="module")
def torus_fits(torus, one_device) -> Balanced:
    return fits(torus, one_device)


@pytest.mark.parametrize("count", [1, 2, 3, 5, 17, 63, 64, 65, 130])
def test_exactly_as_many_spheres_as_asked_for(torus_fits, count):
    spheres = torus_fits.fit(count, coarse=True)
    assert spheres.shape == (count, 4)
    assert np.isfinite(spheres).all()
    assert (spheres[:, 3] > 0).all()


def test_more_spheres_than_a_small_mesh_has_room_for(mesh_of, one_device):
    """Two thin rods: most spheres must share places."""
    rods = [trimesh.creation.box([1, 0.01, 0.01]).apply_translation([0, y, 0]) for y in (0, 0.4)]
    assert fits(Solid(mesh_of(*rods)), one_device).fit(700, coarse=True).shape == (700, 4)


def test_a_ball_gives_the_ball_back(ball, one_device):
    solid = Solid(ball)
    spheres = fits(solid, one_device).fit(1) * solid.size
    # the icosphere is 0.06 % smaller; over seeds the radius varies by 0.0001, the center by 0.0005
    np.testing.assert_allclose(spheres, [[0, 0, 0, 1]], atol=0.002)


def test_two_balls_give_two_spheres_back(mesh_of, one_device):
    parts = [
        trimesh.creation.icosphere(subdivisions=4, radius=r).apply_translation(c)
        for r, c in ((1.0, [0, 0, 0]), (0.4, [1.7, 0.3, 0]))
    ]
    solid = Solid(mesh_of(*parts))
    spheres = fits(solid, one_device).fit(2) * solid.size + [*solid.center, 0]
    spheres = spheres[np.argsort(-spheres[:, 3])]
    np.testing.assert_allclose(spheres, [[0, 0, 0, 1], [1.7, 0.3, 0, 0.4]], atol=0.01)


def test_a_capsule_becomes_a_row_of_spheres(mesh_of, one_device):
    """Radius 0.5 around an axis of length 2; both ends are hemispheres."""
    solid = Solid(mesh_of(trimesh.creation.capsule(height=2, radius=0.5, count=[48, 48])))
    spheres = fits(solid, one_device).fit(8, coarse=True)
    assert silhouette_ious(solid, spheres).mean() > 0.985  # measured 0.993
    placed = spheres * solid.size + [*solid.center, 0]
    placed = placed[np.argsort(placed[:, 2])]
    np.testing.assert_allclose(placed[:, :2], 0, atol=0.01)
    # Spheres 2/7 apart leave notches, and exceed the tube by less than those to make up for it.
    notch = 0.5 - np.sqrt(0.5**2 - (1 / 7) ** 2)
    np.testing.assert_allclose(placed[:, 3], 0.5 + notch / 2, atol=notch / 2)
    np.testing.assert_allclose(np.diff(placed[:, 2]), 2 / 7, atol=0.03)
    np.testing.assert_allclose(placed[[0, -1], 2], [-1, 1], atol=0.01)


def test_a_torus_becomes_a_ring_of_equal_spheres(torus, torus_fits):
    spheres = torus_fits.fit(16, coarse=True) * torus.size
    around = np.linalg.norm(spheres[:, :2], axis=1)
    # Spheres on a ring bulge and leave notches: larger than the tube and a little farther in or out.
    np.testing.assert_allclose(around, 1, atol=0.06)
    np.testing.assert_allclose(spheres[:, 2], 0, atol=0.06)
    np.testing.assert_allclose(spheres[:, 3], 0.32, atol=0.05)
    assert silhouette_ious(torus, spheres / torus.size).mean() > 0.93


def test_a_torus_of_64_spheres_is_close(torus, torus_fits, one_device):
    spheres = torus_fits.fit(64) * torus.size
    m = measure(torus, SphereSet(spheres[:, :3], spheres[:, 3], np.zeros(64)), one_device)
    # measured 0.993, 0.984, 0.002; below by the spread of seeds
    assert m["silhouette_iou_mean"] > 0.985
    assert m["volume_iou"] > 0.97
    assert m["max_gap"] < 0.008


def test_every_component_gets_its_share(mesh_of, one_device):
    """A large ball, and a small one that a loss over volume would give up: 1/1000 of the volume."""
    parts = [
        trimesh.creation.icosphere(subdivisions=4),
        trimesh.creation.icosphere(subdivisions=3, radius=0.1).apply_translation([1.5, 0, 0]),
    ]
    solid = Solid(mesh_of(*parts))
    spheres = fits(solid, one_device).fit(8, coarse=True) * solid.size + [*solid.center, 0]
    assert (np.linalg.norm(spheres[:, :3] - [1.5, 0, 0], axis=1) < 0.1).any()


def mistaken(solid: Solid, spheres, device) -> float:
    """Share of lines, none of which the fit has seen, that only one of solid and spheres blocks."""
    lines = draw_lines(solid, np.random.default_rng(99))
    return float(np.mean((Union(device, spheres).lines(lines.origins, lines.directions) < 0) != lines.hit))


@pytest.mark.parametrize("count", [3, 24])
def test_each_part_of_a_search_pays(torus, torus_fits, one_device, count):
    """A fit never loses to where it began, nor its polish to what it polishes."""
    rng = np.random.default_rng(0)
    samples = torus_fits.samples(count)
    search = Search(samples, one_device, greedy_start(samples.points, count, 0, rng), count, rng)
    errors = [mistaken(torus, search.spheres, one_device)]
    search.anneal(300, 3, lambda *_: None)
    errors.append(mistaken(torus, search.spheres, one_device))
    search.polish(100, lambda *_: None)
    errors.append(mistaken(torus, search.spheres, one_device))
    assert errors[0] > errors[1] > errors[2]


def test_the_mean_projected_area_is_the_solids(torus, torus_fits, one_device):
    """On lines that the fit has not seen."""
    rng = np.random.default_rng(99)
    directions = rng.normal(size=(200_000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = rng.uniform(-0.5, 0.5, (200_000, 3))
    hit = torus.occluded(origins - 2 * directions, directions, np.inf)
    spheres = torus_fits.fit(20, coarse=True)
    through = Union(one_device, spheres).lines(origins, directions) < 0
    # the lines that only one of them hits are about 10 % of all: 3 deviations of their difference
    assert hit.mean() == pytest.approx(through.mean(), abs=3 * np.sqrt(0.1 / 200_000) * 1.5)


def test_the_same_seed_gives_the_same_bits(torus, device):
    first, second = (fits(torus, device, seed=7).fit(24, coarse=True) for _ in range(2))
    np.testing.assert_array_equal(first, second)
    assert not np.array_equal(first, fits(torus, device, seed=8).fit(24, coarse=True))


def test_a_fit_does_not_depend_on_fits_before_it(torus, torus_fits, one_device):
    torus_fits.fit(5, coarse=True)
    np.testing.assert_array_equal(
        torus_fits.fit(12, coarse=True), fits(torus, one_device).fit(12, coarse=True)
    )


def test_scale_does_not_matter(mesh_of, one_device):
    """By a power of two: the unit coordinates are the same to the last bit, and so is the fit."""
    part = trimesh.creation.torus(1.0, 0.3)
    small, large = (Solid(mesh_of(part.copy().apply_scale(s))) for s in (1, 4096))
    one, two = (fits(solid, one_device).fit(12, coarse=True) for solid in (small, large))
    np.testing.assert_array_equal(one, two)
    assert large.size == 4096 * small.size


def test_place_does_not_matter(torus, mesh_of, one_device):
    """Rounding of the translated vertices may lead to another local optimum, but not to a worse fit."""
    moved = Solid(mesh_of(trimesh.creation.torus(1.0, 0.3).apply_translation([300.0, -20.0, 7.0])))
    spheres = fits(moved, one_device).fit(24, coarse=True)
    here = silhouette_ious(torus, fits(torus, one_device).fit(24, coarse=True)).mean()
    assert silhouette_ious(moved, spheres).mean() == pytest.approx(here, abs=0.005)


def test_orientation_does_not_matter(torus, mesh_of, one_device):
    """Turned, its box and all samples are others; the quality is the same to within the spread of seeds."""
    turn = trimesh.transformations.rotation_matrix(1.0, [1, 2, 3])
    turned = Solid(mesh_of(trimesh.creation.torus(1.0, 0.3, 96, 48).apply_transform(turn)))
    there = silhouette_ious(turned, fits(turned, one_device).fit(24, coarse=True)).mean()
    here = silhouette_ious(torus, fits(torus, one_device).fit(24, coarse=True)).mean()
    assert there == pytest.approx(here, abs=0.005)


def test_an_open_ball_is_fitted_as_a_ball(mesh_of, one_device):
    part = trimesh.creation.icosphere(subdivisions=4)
    part.update_faces(part.triangles_center[:, 1] > -0.9)
    solid = Solid(mesh_of(part))
    spheres = fits(solid, one_device).fit(1, coarse=True) * solid.size + [*solid.center, 0]
    np.testing.assert_allclose(spheres, [[0, 0, 0, 1]], atol=0.02)


@pytest.mark.slow
def test_the_bunny_reaches_its_targets(one_device):
    """Set just below what the spread of seeds allows; measured 0.968 / 0.959, 0.941, 0.016, 0.014, 0.002."""
    from coslobe.spheresets.mesh import load_mesh

    solid = Solid(load_mesh("sample:bunny"))
    spheres = fits(solid, one_device).fit(64) * solid.size + [*solid.center, 0]
    m = measure(solid, SphereSet(spheres[:, :3], spheres[:, 3], np.zeros(64)), one_device)
    assert m["silhouette_iou_mean"] > 0.965
    assert m["silhouette_iou_min"] > 0.953
    assert m["volume_iou"] > 0.936
    assert m["max_gap"] < 0.025
    assert m["shadow_rmse_no_contact"][1] < 0.018
    assert max(map(abs, m["shadow_bias"])) < 0.005
