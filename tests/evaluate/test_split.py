"""Zones and the three parts of the error: masks against their float64 twin, shares against geometry."""

import numpy as np
import pytest

from coslobe.evaluate.analysis import Analysis, _reached_by_shadows
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.lobe_sums import mask_at
from coslobe.evaluate.masked import MaskedOccluders
from coslobe.evaluate.occlusion import Segments, entry_distance, sphere_occluders
from coslobe.evaluate.reference import Reference
from coslobe.evaluate.sampling import strata
from coslobe.evaluate.split import PARTS, shares, split_error, split_numbers
from coslobe.evaluate.zones import irradiance_share, zones
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import load_scene
from coslobe.tables.quadtree import disk


@pytest.fixture(scope="module")
def scene(ball_scene):
    return load_scene(ball_scene).at(0)


@pytest.fixture(scope="module")
def assets():
    return Assets(None)


@pytest.fixture(scope="module")
def gbuffer(scene, assets):
    return trace_gbuffer(scene, assets)


def cells_of(scene, gbuffer, i: int, occluders) -> np.ndarray:
    """Which cells of point i's mask `occluders` call blocked, asked away from the cells' centres."""
    rows = 2**scene.shading.mask.depth
    cap, _, axes = mask_at(scene, gbuffer, i, 0, occluders)
    x = ((np.arange(rows) + 0.7) * 2 / rows - 1) * cap.tangent
    plane = np.stack(np.broadcast_arrays(x[None, :], x[:, None], 1.0), axis=-1) @ np.stack([*axes, cap.axis])
    plane /= np.linalg.norm(plane, axis=-1, keepdims=True)
    directions = tuple(part.reshape(1, -1) for part in np.moveaxis(plane, -1, 0))
    light = next(iter(scene.lights.values())).sphere
    one = slice(i, i + 1)
    center = np.asarray(light.center)
    reach = entry_distance(gbuffer.position[one], directions, center, light.radius)
    segments = Segments(
        gbuffer.position[one],
        gbuffer.geometric_normal[one],
        gbuffer.object[one],
        0,
        center,
        light.radius,
        directions,
        reach,
        np.ones(reach.shape, bool),
    )
    return occluders.blocked(segments).reshape(rows, rows)


def test_every_direction_of_a_cell_has_the_visibility_of_its_centre(scene, assets, gbuffer):
    """Against the mask of `lobe_sums.mask_at`, in points of the penumbra."""
    exact = sphere_occluders(scene, assets)
    masked = MaskedOccluders(exact, gbuffer, scene.shading.mask)
    on_disk = disk(2**scene.shading.mask.depth)
    in_penumbra = 0
    ground = np.flatnonzero((gbuffer.object == 0) & (np.abs(gbuffer.position[:, 0]) < 0.6))
    for i in ground[:: len(ground) // 60]:
        wanted = mask_at(scene, gbuffer, i, 0, exact)[1][on_disk]
        assert (cells_of(scene, gbuffer, i, masked)[on_disk] == wanted).all()
        in_penumbra += 0 < wanted.sum() < wanted.size
    assert in_penumbra >= 3


def test_finer_masks_are_nearer_to_the_spheres(scene, assets, gbuffer):
    """Twice the cells along a side divide the error by 2 to 3 (theory), less what noise is in it."""
    exact = sphere_occluders(scene, assets)
    grid, errors = strata(128), []
    truth = direct_light(scene, gbuffer, exact, grid, (0,)).radiance
    for depth in (2, 3, 4):
        mask = scene.shading.mask.model_copy(update={"depth": depth})
        found = direct_light(scene, gbuffer, MaskedOccluders(exact, gbuffer, mask), grid, (0,)).radiance
        errors.append(np.sqrt(np.mean((found - truth) ** 2)))
    assert 1.5 < errors[0] / errors[1] < 4
    assert 1.5 < errors[1] / errors[2] < 4


def test_aggressive_masks_are_brighter_and_conservative_darker(scene, assets, gbuffer):
    exact = sphere_occluders(scene, assets)
    sums = {}
    for mode in ("aggressive", "centre", "conservative"):
        mask = scene.shading.mask.model_copy(update={"mode": mode, "depth": 3})
        estimate = direct_light(scene, gbuffer, MaskedOccluders(exact, gbuffer, mask), strata(32), (0,))
        sums[mode] = estimate.radiance.sum()
    assert sums["aggressive"] > sums["centre"] > sums["conservative"]


def test_shares_of_irradiance(scene, assets, gbuffer):
    """Far from the ball all arrives, under it none, and what faces away gets none either."""
    share = irradiance_share(scene, gbuffer, assets, strata(32), (0,))
    light = np.asarray(next(iter(scene.lights.values())).sphere.center)
    ball, radius = np.array([0, 0.35, 0]), 0.3
    to_light = light - gbuffer.position
    distance = np.linalg.norm(to_light, axis=1)
    along = np.einsum("ij,ij->i", ball - gbuffer.position, to_light) / distance
    gap = np.sqrt(np.maximum(np.sum((ball - gbuffer.position) ** 2, axis=1) - along**2, 0))
    ground = gbuffer.object == 0
    assert (share[ground & ((gap > 2 * radius) | (along < 0))] == 1).all()
    assert (share[ground & (along > 0) & (gap < 0.3 * radius)] == 0).all()
    away = np.einsum("ij,ij->i", gbuffer.geometric_normal, to_light) < -0.3
    assert away.any()
    assert (share[away] == 0).all()
    assert ((share > 0) & (share < 1)).any()


def test_zones_part_the_surface():
    share = np.array([[0.0, 0.3, 1.0], [1 - 1e-12, 0.5, 0.0]])
    hit = np.array([[True, True, True], [True, False, False]])
    found = zones(share, hit)
    assert sum(region.astype(int) for region in found.values()).tolist() == hit.astype(int).tolist()
    assert found["umbra"].tolist() == [[True, False, False], [False, False, False]]
    assert found["penumbra"].tolist() == [[False, True, False], [False, False, False]]


def test_parts_add_up_and_noise_does_not_count():
    """Noise of the references and of the halves is taken off: what is left are the parts put in."""
    rng = np.random.default_rng(0)
    shape, sigma = (120, 120, 3), 0.02

    def noise():
        return sigma * rng.normal(size=shape)

    radiance = np.ones(shape)
    variance = np.full(shape, sigma**2)
    mesh = Reference(radiance, variance, np.ones(shape[:2]), np.zeros(shape[:2], int))
    sphere_noise = noise()
    spheres = Reference(radiance + 0.1 + sphere_noise, variance, mesh.samples, mesh.object)
    halves = np.stack([0.03 + noise(), 0.03 + noise()])
    image = radiance + 0.1 + 0.03 - 0.05
    split = split_error(image, mesh, spheres, Analysis(np.ones(shape[:2]), halves))
    assert np.allclose(sum(split.maps.values()), image - mesh.radiance)
    numbers = split_numbers(split, np.ones(shape[:2], bool), 1.0)
    assert numbers["visibility"] == pytest.approx(0.03, rel=0.05)  # 43,200 values
    assert numbers["lobes"] == pytest.approx(0.05, rel=0.05)
    assert set(split_numbers(split, np.zeros(shape[:2], bool), 1.0).values()) == {None}


def test_shares_of_squares():
    assert shares(dict(zip(PARTS, (3.0, 0.0, 4.0), strict=True))) == pytest.approx(
        {"geometry": 0.36, "visibility": 0.0, "lobes": 0.64}
    )
    assert shares(dict.fromkeys(PARTS)) is None


def test_masks_are_exact_where_no_shadow_reaches(scene, assets, gbuffer):
    """Points that the analysis leaves out have the same light from masks as from spheres."""
    rest = np.setdiff1d(np.arange(len(gbuffer.position)), _reached_by_shadows(scene, gbuffer, assets))
    assert 0.3 < len(rest) / len(gbuffer.position) < 0.95
    some, exact = gbuffer.some(rest), sphere_occluders(scene, assets)
    masked = MaskedOccluders(exact, some, scene.shading.mask)
    found, wanted = (direct_light(scene, some, by, strata(16), (0,)).radiance for by in (masked, exact))
    assert (found == wanted).all()
