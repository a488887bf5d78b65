"""Light between surfaces, against closed forms by statistics.

A light around everything makes the direct light on every surface the same, as nothing blocks inside a light:
what surfaces throw on one another then follows from view factors alone.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
import PIL.Image
import pytest
import trimesh

from coslobe.evaluate.direct import direct_sources
from coslobe.evaluate.integration import Estimate, integrate, uniform
from coslobe.evaluate.occlusion import mesh_occluders
from coslobe.evaluate.paths import BouncedLight
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import Scene

Z_BOUND = 4.5  # two-sided p = 7e-6 for one test; seeds are fixed, so a pass stays a pass

EVERYWHERE = {"center": [0, 0, 0], "radius": 50, "radiance": 1}

ALBEDO = np.array([0.7, 0.5, 0.2])


def scene(
    objects: dict,
    light: dict,
    material=None,
    *,
    fov=60.0,
    size=16,
    origin=(0.1, 0.2, -0.15),
    target=(0.6, -0.3, 0.4),
) -> Scene:
    """One material `m`, and `white` beside it."""
    white = {"lambert": {"albedo": ALBEDO.tolist()}}
    look_at = {"origin": origin, "target": target}
    return Scene.model_validate(
        {
            "camera": {"look_at": look_at, "fov": fov},
            "image": {"width": size, "height": size},
            "materials": {"m": material or white, "white": white},
            "lights": {"l": {"sphere": light}},
            "objects": objects,
        }
    )


def room(path: Path, **settings) -> dict:
    return {"room": {"mesh": str(path), "material": "m", "occludes": False, "normals": "flat", **settings}}


def estimate(of: Scene, bounces: int, samples: int = 64, *, direct: bool = True) -> Estimate:
    assets = Assets(None)
    gbuffer = trace_gbuffer(of, assets)
    occluders = mesh_occluders(of, assets)
    sources = [*direct_sources(of, gbuffer, occluders)] if direct else []
    if bounces > 1:
        sources.append(BouncedLight(of, assets, gbuffer, occluders, bounces))
    choice = uniform(strata(samples), len(sources), len(gbuffer.position))
    return integrate(sources, gbuffer.material, choice, (0,), "test")[0]


def z_scores(found: Estimate, exact) -> np.ndarray:
    """How many standard errors the mean of each channel over all points is off."""
    n = len(found.radiance)
    return (found.radiance.mean(axis=0) - exact) / (np.sqrt(found.variance.sum(axis=0)) / n)


@pytest.fixture(scope="module")
def box(tmp_path_factory) -> Path:
    path = tmp_path_factory.mktemp("room") / "box.ply"
    trimesh.creation.box((2, 3, 2.5)).export(path)
    return path


@pytest.fixture(scope="module")
def ball(tmp_path_factory) -> Path:
    """A polyhedron around a ball of radius 1, which sags by at most 6e-4."""
    path = tmp_path_factory.mktemp("room") / "ball.ply"
    trimesh.creation.icosphere(subdivisions=5, radius=1.0).export(path)
    return path


@pytest.mark.parametrize("bounces", [1, 2, 3, 25])
def test_a_furnace_adds_up_the_powers_of_the_albedo(box, bounces):
    """In a closed room every direction meets a wall as bright as all others: L = a + a^2 + ... + a^n."""
    found = estimate(scene(room(box), EVERYWHERE), bounces, samples=128)
    exact = sum(ALBEDO**k for k in range(1, bounces + 1))
    assert np.all(np.abs(z_scores(found, exact)) < Z_BOUND)
    if bounces <= 3:  # and the test would notice one bounce more
        assert np.all(np.abs(z_scores(found, exact + ALBEDO ** (bounces + 1))) > Z_BOUND)


def test_two_plates_see_one_another_by_their_view_factor():
    """From below the middle of a plate of half-sizes X, Y at the distance 1, the view factor is closed."""
    half = 0.8
    plates = {
        "floor": {"plane": {"size": 1e-2}, "material": "m"},
        "ceiling": {"plane": {"size": 2 * half}, "material": "m", "transform": {"translate": [0, 1, 0]}},
    }
    of = scene(plates, EVERYWHERE, fov=0.5, size=24, target=(0, 0, 0))
    found = estimate(of, bounces=2, samples=32)
    root = np.sqrt(1 + half**2)
    factor = 4 / (2 * np.pi) * 2 * half / root * np.arctan(half / root)
    assert np.all(np.abs(z_scores(found, ALBEDO + ALBEDO**2 * factor)) < Z_BOUND)
    # All pixels show the same but for noise: the variances claimed add up to what is seen.
    seen, claimed = found.radiance.var(axis=0, ddof=1), found.variance.mean(axis=0)
    # of 576 pixels a ratio has a relative standard deviation of sqrt(2 / 576) = 6 %
    np.testing.assert_allclose(seen, claimed, rtol=0.25)


@pytest.mark.parametrize("bounces", [2, 5])
def test_a_lamp_in_a_ball_loses_what_meets_the_lamp(ball, bounces):
    """From a wall, the lamp has the view factor (r/R)^2 = f: every bounce keeps a (1 - f) of the light.

    The mean over the wall is compared: the polyhedron's facets are lit unevenly by 1e-3 of that.
    """
    f, radiance = 0.25, 3.0
    light = {"center": [0, 0, 0], "radius": 0.5, "radiance": radiance}
    of = scene(room(ball), light, origin=(0.6, 0.1, 0.2), target=(1, 0.2, 0.4))
    found = estimate(of, bounces, samples=256)
    exact = radiance * f * ALBEDO * sum((ALBEDO * (1 - f)) ** k for k in range(bounces))
    np.testing.assert_allclose(found.radiance.mean(axis=0), exact, rtol=4e-3)
    without_the_lamps_shadow = radiance * f * ALBEDO * sum(ALBEDO**k for k in range(bounces))
    assert np.all(found.radiance.mean(axis=0) < 0.98 * without_the_lamps_shadow)


def test_a_point_in_a_ball_lights_it_as_often_as_it_bounces(ball):
    """A wall of a ball sees every part of it with the same view factor: E = I / R^2 (1 + a + a^2 + ...)."""
    of = scene(room(ball, normals="smooth"), {"center": [0, 0, 0], "radius": 0, "intensity": 2.0})
    found = estimate(of, bounces=4, samples=64)
    exact = 2.0 * ALBEDO / np.pi * sum(ALBEDO**k for k in range(4))
    np.testing.assert_allclose(found.radiance.mean(axis=0), exact, rtol=4e-3)


@pytest.mark.parametrize("exponent", [3, 300])
def test_gloss_bounces_no_more_light_than_arrives(box, exponent):
    """Modified Phong reflects at most kd + ks: no point of the furnace exceeds the series of that."""
    gloss = {"phong": {"kd": 0.3, "ks": 0.5, "exponent": exponent}}
    found = estimate(scene(room(box), EVERYWHERE, gloss), bounces=4, samples=256)
    most = sum(0.8**k for k in range(1, 5))
    assert np.all(z_scores(found, most) < Z_BOUND)
    assert found.radiance.mean() > 0.6 * most


def test_a_mirror_shows_what_it_faces():
    """A sharp lobe over a floor sees the ceiling where the ray is mirrored: ks of its direct light."""
    floor = {"phong": {"kd": 0.0, "ks": 0.9, "exponent": 20000}}
    plates = {
        "floor": {"plane": {"size": 2}, "material": "m"},
        "ceiling": {"plane": {"size": 20}, "material": "white", "transform": {"translate": [0, 1, 0]}},
    }
    of = scene(plates, EVERYWHERE, floor, fov=1.0, origin=(2e-3, 0.2, 0), target=(0, 0, 0))
    found = estimate(of, bounces=2, direct=False)
    # The camera looks down, where the lobe returns ks, but for cosines that differ from 1 by 1e-4.
    assert np.all(np.abs(z_scores(found, 0.9 * ALBEDO)) < Z_BOUND)
    np.testing.assert_allclose(found.radiance.mean(axis=0), 0.9 * ALBEDO, rtol=3e-3)


@pytest.mark.parametrize("kind", ["grey", "black", "textured"])
def test_without_anything_to_meet_there_is_no_bounced_light(tmp_path, kind):
    PIL.Image.fromarray(np.full((2, 2, 3), 200, np.uint8)).save(tmp_path / "grey.png")
    albedo = {"grey": 0.5, "black": 0.0, "textured": {"texture": str(tmp_path / "grey.png")}}[kind]
    floor = {"floor": {"plane": {"size": 3}, "material": "m"}}
    lamp = {"center": [0, 2, 0], "radius": 0.3, "radiance": 5}
    of = scene(floor, lamp, {"lambert": {"albedo": albedo}}, target=(0.3, 0, 0.2))
    found = estimate(of, bounces=5, samples=8, direct=False)
    np.testing.assert_array_equal(found.radiance, 0)
    np.testing.assert_array_equal(found.variance, 0)


def test_roulette_changes_nothing_but_the_noise(box, monkeypatch):
    of = scene(room(box), EVERYWHERE)
    ended = estimate(of, bounces=8, samples=128)
    monkeypatch.setattr("coslobe.evaluate.paths.SURE_BOUNCES", 100)
    going_on = estimate(of, bounces=8, samples=128)
    assert not np.array_equal(ended.radiance, going_on.radiance)
    both = replace(ended, variance=ended.variance + going_on.variance)
    assert np.all(np.abs(z_scores(both, going_on.radiance.mean(axis=0))) < Z_BOUND)
