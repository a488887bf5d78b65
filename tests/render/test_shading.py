"""Whole shading of points against closed forms, invariants and the path-traced reference."""

import dataclasses

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from coslobe.core.device import Device
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.occlusion import NONE, Occluders, Spheres, light_spheres
from coslobe.evaluate.sampling import strata
from coslobe.render import layout, unshadowed
from coslobe.render.assets import Blockers
from coslobe.render.gbuffer import GBuffer
from coslobe.render.methods.cosine_lobes import CosineLobes
from coslobe.render.scene import Light, Scene, SphereLight
from coslobe.tables import lobe_cap

EYE = np.array([-2.0, 1.5, 2.5])


def scene(lights, *, albedo=1.0, phong=None, eye=EYE, **shading) -> Scene:
    """Materials 0 (Lambert) and 1 (Phong), and the given (centre, radius, radiance) lights."""
    phong = phong or {"kd": 0.2, "ks": 0.5, "exponent": 50}
    return Scene.model_validate(
        {
            "camera": {"look_at": {"origin": list(eye), "target": list(eye - 1)}, "fov": 40},
            "image": {"width": 8, "height": 8},
            "shading": shading,
            "materials": {"matt": {"lambert": {"albedo": albedo}}, "glossy": {"phong": phong}},
            "lights": {
                f"light{j}": {"sphere": {"center": list(map(float, c)), "radius": r, "radiance": radiance}}
                for j, (c, r, radiance) in enumerate(lights)
            },
            "objects": {},
        }
    )


def points(position, normal=(0, 1, 0), *, material=0, owner=0, eye=EYE) -> GBuffer:
    position = np.atleast_2d(np.asarray(position, np.float64))
    n = len(position)
    normals = np.broadcast_to(np.asarray(normal, np.float64), (n, 3)).copy()
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    view = eye - position
    distance = np.linalg.norm(view, axis=1)
    ints = np.zeros(n, np.int32)
    return GBuffer(
        position, normals, normals, view / distance[:, None], ints + owner, ints + material,
        np.arange(n, dtype=np.int32), distance, ints, np.tile([1.0, 0.0, 0.0], (n, 1)), n, 1, 1,
    )  # fmt: skip


def blockers(*spheres, owner=5, outside=0.0) -> Blockers:
    array = np.asarray(spheres, np.float64).reshape(-1, 4)
    n = len(array)
    return Blockers(array[:, :3], array[:, 3], np.full(n, outside), np.full(n, owner, np.int32))


def reference(of_scene, gbuffer, blocking, samples=4096):
    lights = light_spheres(of_scene)
    parts = (
        (blocking.centers, lights.centers),
        (blocking.radii, lights.radii),
        (blocking.outside, lights.outside),
        (blocking.owner, lights.owner),
        (np.full(len(blocking.radii), NONE, np.int32), lights.emitter),
    )
    occluders = Occluders(Spheres(*(np.concatenate(pair) for pair in parts)))
    return direct_light(of_scene, gbuffer, occluders, strata(samples), (0,))


def relative_rmse(found, expected):
    return np.sqrt(np.mean((found - expected) ** 2)) / np.mean(expected)


@pytest.fixture(scope="session")
def method(device):
    return CosineLobes(device)


def plane_grid(n=24, size=3.0):
    x = (np.arange(n) + 0.5) / n * size - size / 2
    return np.stack([np.repeat(x, n), np.zeros(n * n), np.tile(x, n)], axis=1)


KEY = ([1.0, 2.2, 0.6], 0.3, 30.0)


def random_blockers(rng, n=40):
    centre = rng.uniform([-0.5, 0.2, -0.5], [0.5, 1.0, 0.5], (n, 3))
    return blockers(*np.concatenate([centre, rng.uniform(0.03, 0.15, (n, 1))], axis=1))


def test_unoccluded_diffuse_light_has_its_closed_form(method):
    """The horizon included: points of every tilt, lights near and far."""
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(500, 3))
    at = points(rng.uniform(-1, 1, (500, 3)), normals)
    centre, radius, radiance = [0.3, 2.5, -0.4], 0.5, 7.0
    found = method.shade(scene([(centre, radius, radiance)], albedo=0.6), at, blockers()).radiance
    to_light = np.asarray(centre) - at.position
    distance = np.linalg.norm(to_light, axis=1)
    cosine = np.einsum("ij,ij->i", at.shading_normal, to_light) / distance
    expected = 0.6 / np.pi * radiance * unshadowed.lambert_sphere(cosine, (radius / distance) ** 2)
    # The geometric horizon is cut in cells of the mask: 1 % of a cell row's share where it crosses the light.
    np.testing.assert_allclose(found[:, 0], expected, atol=2e-3 * expected.max())
    clear = np.abs(cosine) > radius / distance + 1e-3
    np.testing.assert_allclose(found[clear, 0], expected[clear], rtol=3e-6, atol=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 50.0, 1000.0])
def test_unoccluded_glossy_light_has_its_exact_integral(method, exponent):
    """The cosine stays inside the integral: the moments of the lobe over the light's cap give it exactly."""
    at = points(plane_grid(), material=1)
    centre, radius, radiance = KEY
    phong = {"kd": 0.0, "ks": 1.0, "exponent": exponent}
    found = method.shade(scene([KEY], phong=phong), at, blockers()).radiance[:, 0]
    to_light = np.asarray(centre) - at.position
    distance = np.linalg.norm(to_light, axis=1, keepdims=True)
    axis = to_light / distance
    mirror = 2 * np.einsum("ij,ij->i", at.view, at.shading_normal)[:, None] * at.shading_normal - at.view
    theta = np.arccos(np.clip(np.einsum("ij,ij->i", axis, mirror), -1, 1))
    m = lobe_cap.exact(exponent, theta, np.arcsin(radius / distance[:, 0]))
    direction = m.along_lobe[:, None] * mirror + m.towards_cap[:, None] * (
        axis - np.cos(theta)[:, None] * mirror
    )
    integral = m.integral * np.einsum("ij,ij->i", direction, at.shading_normal)
    expected = radiance * (exponent + 2) / (2 * np.pi) * integral
    # 1e-3 of the highlight: the table's own error (tests/tables) plus float32.
    np.testing.assert_allclose(found, expected, atol=1e-3 * expected.max())


def test_inside_a_light_every_direction_sees_it(method):
    """A furnace: outgoing radiance is albedo times the light's radiance, whatever the normal."""
    rng = np.random.default_rng(1)
    at = points(rng.uniform(-0.5, 0.5, (50, 3)), rng.normal(size=(50, 3)))
    found = method.shade(scene([([0, 0, 0], 2.0, 3.0)], albedo=0.7), at, blockers()).radiance
    np.testing.assert_allclose(found, 2.1, rtol=5e-3)  # 32 rings of the equal-area map


def test_a_covered_light_is_exactly_dark(method):
    at = points(plane_grid(8, 0.2))
    lit = scene([([0, 3, 0], 0.3, 10.0)])
    assert np.all(method.shade(lit, at, blockers([0, 1.5, 0, 0.4])).radiance == 0)
    pieces = [[x, 1.0, z, 0.06] for x in np.linspace(-0.4, 0.4, 13) for z in np.linspace(-0.4, 0.4, 13)]
    assert np.all(method.shade(lit, at, blockers(*pieces)).radiance == 0)


def test_one_blocker_leaves_the_light_minus_a_lens(method):
    """Visible solid angle of a small light behind one sphere, from the overlap of two circles."""
    height, light, block = 100.0, 1.0, 0.4
    offset = np.linspace(0, 1.0, 60)
    at = points(np.stack([offset, 0 * offset, 0 * offset], axis=1))
    ball = blockers([0, height / 2, 0, block])
    found = method.shade(scene([([0, height, 0], light, 1.0)]), at, ball).radiance[:, 0]
    free = method.shade(scene([([0, height, 0], light, 1.0)]), at, blockers()).radiance[:, 0]
    # Seen from the ground at unit distance: radii R / h and 2 r / h, centres offset / h apart.
    a, b, d = light, 2 * block, np.maximum(offset, 1e-9)
    lens = np.where(
        d <= a - b,
        np.pi * b * b,
        a * a * np.arccos(np.clip((d * d + a * a - b * b) / (2 * d * a), -1, 1))
        + b * b * np.arccos(np.clip((d * d + b * b - a * a) / (2 * d * b), -1, 1))
        - 0.5 * np.sqrt(np.maximum((a + b - d) * (d + a - b) * (d - a + b) * (d + a + b), 0)),
    )
    visible = 1 - lens / (np.pi * a * a)
    # What a mask of 32 rows makes of an edge (theory, section 5): 2 % at worst, 0.4 % in general.
    assert np.max(np.abs(found / free - visible)) < 0.02
    assert np.sqrt(np.mean((found / free - visible) ** 2)) < 0.005


@pytest.mark.parametrize(
    ("material", "exponent"), [(0, 50), (1, 50), (1, 1000)], ids=["lambert", "phong-50", "phong-1000"]
)
def test_shadows_match_the_reference_with_the_same_spheres(method, material, exponent):
    rng = np.random.default_rng(2)
    at = points(plane_grid(), material=material)
    of = scene([KEY], phong={"kd": 0.3, "ks": 0.3, "exponent": exponent})
    blocking = random_blockers(rng)
    found = method.shade(of, at, blocking).radiance
    expected = reference(of, at, blocking)
    assert np.isfinite(found).all()
    noise = np.sqrt(expected.variance.mean()) / expected.radiance.mean()
    assert relative_rmse(found, expected.radiance) <= np.hypot(0.003, noise)


def test_deeper_masks_are_more_accurate(method):
    rng = np.random.default_rng(3)
    at, blocking = points(plane_grid()), random_blockers(rng)
    expected = reference(scene([KEY]), at, blocking, 16384).radiance
    errors = [
        relative_rmse(method.shade(scene([KEY], mask={"depth": depth}), at, blocking).radiance, expected)
        for depth in (2, 3, 4, 5)
    ]
    # An edge misses by a fixed share of a cell: the error falls at least like the cell's size.
    slope = np.polyfit(np.arange(4), np.log2(errors), 1)[0]
    assert slope < -0.9


def test_lights_add_up_and_block_one_another(method):
    at = points(plane_grid(12))
    near, far = ([0.3, 1.0, 0.0], 0.2, 4.0), ([0.6, 2.5, 0.1], 0.3, 20.0)
    both = method.shade(scene([near, far]), at, blockers()).radiance
    ball = blockers([*near[0], near[1]])
    parts = (
        method.shade(scene([near]), at, blockers()).radiance + method.shade(scene([far]), at, ball).radiance
    )
    np.testing.assert_allclose(both, parts, rtol=1e-5, atol=1e-6)
    free = method.shade(scene([far]), at, blockers()).radiance
    assert (method.shade(scene([far]), at, ball).radiance < free).any()


def test_blockers_behind_and_beside_the_light_do_nothing(method):
    at = points(plane_grid(12))
    free = method.shade(scene([KEY]), at, blockers()).radiance
    idle = blockers([1.3, 3.2, 0.8, 0.4], [0, -1, 0, 0.5], [-1.4, 1.4, -1.4, 0.1])
    np.testing.assert_array_equal(method.shade(scene([KEY]), at, idle).radiance, free)


def test_points_close_to_a_light(method):
    """Cones beyond 60 degrees use another map of directions, and still match the reference."""
    rng = np.random.default_rng(4)
    grid = plane_grid(12, 1.0)
    light = ([0.1, 0.45, 0.0], 0.4, 5.0)
    blocking = blockers([0.3, 0.1, 0.3, 0.08], [-0.2, 0.05, 0.1, 0.1], [0.0, 0.03, -0.4, 0.05])
    for material in (0, 1):
        at = points(grid + [0, 1e-3, 0] * rng.random((144, 1)), material=material)
        found = method.shade(scene([light]), at, blocking).radiance
        expected = reference(scene([light]), at, blocking).radiance
        assert np.isfinite(found).all()
        assert relative_rmse(found, expected) < 0.02


def test_tiny_blockers_before_tiny_lights_are_not_lost(method):
    """A light of 1e-4 rad: what lies in its cone is told from what does not by more than |o|^2 - along^2."""
    rng = np.random.default_rng(8)
    centre, sine, n = np.array([0.9, 6.0, -1.2]), 1e-4, 60
    balls = np.concatenate([centre / 2 + 3 * sine * rng.normal(size=(n, 3)), np.full((n, 1), 0.6 * sine)], 1)
    at = points(0.7 * sine * rng.normal(size=(200, 3)), centre)
    of = scene([(centre, sine * np.linalg.norm(centre), 1e6)])
    expected = reference(of, at, blockers(*balls), 1024)
    noise = np.sqrt(expected.variance.mean()) / expected.radiance.mean()
    found = method.shade(of, at, blockers(*balls)).radiance
    assert relative_rmse(found, expected.radiance) < np.hypot(0.03, noise)  # many edges, 3e-2 of a cell each


@pytest.mark.parametrize("radius", [1e-3, 0.3])
def test_blockers_at_the_depth_of_the_light(method, radius):
    """Cell by cell, what is entered first blocks; small spheres far away must not lose it in rounding."""
    rng = np.random.default_rng(12)
    centre, n = np.array([0.9, 2.0, -1.2]), 12
    place = rng.normal(size=(n, 3))
    place *= rng.uniform(0.5, 1.3, (n, 1)) * radius / np.linalg.norm(place, axis=1, keepdims=True)
    balls = np.concatenate([centre + place, radius * rng.uniform(0.2, 0.7, (n, 1))], axis=1)
    at = points(rng.uniform(-0.5, 0.5, (150, 3)), centre)
    of = scene([(centre, radius, 1 / radius**2)])
    expected = reference(of, at, blockers(*balls), 2048)
    noise = np.sqrt(expected.variance.mean()) / expected.radiance.mean()
    found = method.shade(of, at, blockers(*balls)).radiance
    assert relative_rmse(found, expected.radiance) < np.hypot(0.012, noise)


@pytest.mark.parametrize("exponent", [1.0, 50.0])
def test_broad_lobes_have_shadows_from_small_lights(method, exponent):
    """A light much smaller than the lobe collects little of it, but all that there is."""
    rng = np.random.default_rng(9)
    centre, radius, ball = np.array([0.0, 2.0, 0.0]), 1e-3, 0.02
    turn, shift = rng.uniform(0, 2 * np.pi, 200), rng.uniform(-1, 1, 200)
    distance = 2 * ball + shift * radius  # around the edge of the shadow of a ball half-way up
    place = np.stack([distance * np.cos(turn), 0 * turn, distance * np.sin(turn)], axis=1)
    eye = np.array([-0.8, 2.0, 0.0])  # the mirror image of the light is 22 degrees off
    at = points(place, material=1, eye=eye)
    of = scene([(centre, radius, 1e6)], phong={"kd": 0.0, "ks": 0.5, "exponent": exponent}, eye=eye)
    blocking = blockers([0, 1, 0, ball])
    expected = reference(of, at, blocking, 1024)
    noise = np.sqrt(expected.variance.mean()) / expected.radiance.mean()
    found = method.shade(of, at, blocking).radiance
    assert relative_rmse(found, expected.radiance) < np.hypot(0.02, noise)


@pytest.mark.parametrize("exponent", [0.0, 0.1])
def test_a_lobe_gives_no_more_than_its_amplitude_over_the_light(method, exponent):
    """Where the hemisphere of a very broad lobe ends within a small light."""
    angle = np.pi / 2 + np.linspace(-0.04, 0.04, 200)  # between the mirror direction and the light
    mirror = np.stack([np.sin(angle), np.cos(angle), 0 * angle], axis=1)
    at = points(np.zeros((200, 3)), mirror + EYE / np.linalg.norm(EYE), material=1)
    phong = {"kd": 0.0, "ks": 1.0, "exponent": exponent}
    found = method.shade(scene([([0, 3, 0], 0.03, 1.0)], phong=phong), at, blockers()).radiance
    assert found.max() <= (exponent + 2) / 2 * 0.01**2 * 1.001


def mirrored(centre, spread, rng, n=200):
    """Points at the origin whose normals mirror the viewer to about `centre`."""
    axis = centre / np.linalg.norm(centre)
    towards = axis + spread * rng.normal(size=(n, 3))
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    return points(np.zeros((n, 3)), towards + EYE / np.linalg.norm(EYE), material=1)


@pytest.mark.parametrize("sine", [0.3, 0.9])
def test_lobes_sharper_than_a_cell_are_mirrors(method, sine):
    """Also where a far blocker makes a penumbra, and where the light is too wide for a plane."""
    rng = np.random.default_rng(10)
    centre = np.array([1.0, 2.2, 0.6])
    distance = np.linalg.norm(centre)
    at = mirrored(centre, sine, rng)
    of = scene([(centre, sine * distance, 1.0)], phong={"kd": 0.0, "ks": 1.0, "exponent": 1e6})
    axis = centre / distance
    edge = np.cross(axis, [1.0, 0.0, 0.0])
    ball = blockers([*(0.5 * distance * (axis + sine * edge / np.linalg.norm(edge))), 0.05 * distance])
    normal, view = at.shading_normal, at.view
    mirror = 2 * np.einsum("ij,ij->i", normal, view)[:, None] * normal - view
    cosine = np.einsum("ij,ij->i", mirror, normal)

    def sees(sphere, clearance):
        """Mirror rays that meet the sphere enlarged by `clearance`; others are too close to call."""
        along = mirror @ sphere[:3]
        return (along > 0) & (sphere[:3] @ sphere[:3] - along**2 < (sphere[3] + clearance * distance) ** 2)

    light, dark = np.array([*centre, sine * distance]), np.array([*ball.centers[0], ball.radii[0]])
    width = 0.05  # a cell and the lobe's own width
    lit = sees(light, -width) & ~sees(dark, width)
    found = method.shade(of, at, ball).radiance[:, 0]
    np.testing.assert_allclose(found[lit], cosine[lit], rtol=2e-3)
    unlit = ~sees(light, width) | sees(dark, -width / 2)
    np.testing.assert_allclose(found[unlit], 0, atol=2e-3)
    assert lit.sum() > 20
    assert unlit.sum() > 10


def test_sharp_lobes_at_the_horizon_keep_their_integral(method):
    """A grazing mirror image of the light, which the horizon cuts: no fireflies from single cells."""
    axis, sine = np.array([0.6, 0.0, 0.8]), 0.3
    rng = np.random.default_rng(11)
    eye = np.array([0.0, 0.6, 0.0]) - 3 * axis
    at = points(np.zeros((200, 3)), [0, 1, 0] + 0.04 * rng.normal(size=(200, 3)), material=1, eye=eye)
    of = scene([(2 * axis, 2 * sine, 1.0)], phong={"kd": 0.0, "ks": 1.0, "exponent": 1e5}, eye=eye)
    mirror = 2 * np.einsum("ij,ij->i", at.view, at.shading_normal)[:, None] * at.shading_normal - at.view
    inside = mirror @ axis > np.cos(np.arcsin(sine) - 0.03)
    found = method.shade(of, at, blockers()).radiance[inside, 0]
    height = np.einsum("ij,ij->i", mirror, at.shading_normal)[inside]
    above = height > 0.03
    assert above.sum() > 20
    assert np.max(np.abs(found[above] - height[above])) < 0.01  # a cell is 0.02 high


@pytest.mark.parametrize("radius", [0.3, 1.0, 1.5])
def test_inside_a_sphere_straight_below_the_light(method, radius):
    """The half-space towards the sphere's centre holds all of the light, or nothing of it."""
    at = points(np.zeros((8, 3)))
    of = scene([([0, 2, 0], radius, 1.0)])
    free = method.shade(of, at, blockers()).radiance
    for centre, expected in (([0, 0.05, 0], 0 * free), ([0, -0.05, 0], free)):
        found = method.shade(of, at, blockers([*centre, 0.2])).radiance
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_own_spheres_follow_the_same_rule_as_in_the_reference(method):
    """Receivers on a ball whose own sphere bulges above it, beside a foreign ball."""
    rng = np.random.default_rng(5)
    normals = rng.normal(size=(800, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    at = points(0.3 * normals + [0, 0.3, 0], normals, owner=0)
    own = blockers([0, 0.3, 0, 0.305], [0.25, 0.45, 0.1, 0.08], owner=0, outside=0.02)
    foreign = blockers([0.5, 1.2, 0.3, 0.2], owner=1)
    joined = Blockers(
        *(np.concatenate(pair) for pair in zip(*(vars(b).values() for b in (own, foreign)), strict=True))
    )
    found = method.shade(scene([KEY]), at, joined).radiance
    expected = reference(scene([KEY]), at, joined)
    # A mask places an edge within 2 % of the light's width (theory, section 5); a wrong rule costs 100 %.
    free = method.shade(scene([KEY]), at, blockers()).radiance
    assert np.max(np.abs(found - expected.radiance)) < 0.02 * free.max()
    # The own sphere around the ball, alone, must not darken it anywhere.
    alone = method.shade(scene([KEY]), at, blockers([0, 0.3, 0, 0.305], owner=0, outside=0.02)).radiance
    np.testing.assert_allclose(alone, free, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("change", ["rotation", "translation", "scale"])
def test_a_moved_scene_gives_the_same_picture(method, change):
    rng = np.random.default_rng(6)
    at, blocking = points(plane_grid(), material=1), random_blockers(rng)
    expected = method.shade(scene([KEY]), at, blocking).radiance
    turn, shift, factor = np.eye(3), np.zeros(3), 1.0
    if change == "rotation":
        turn = Rotation.from_rotvec([0.7, -1.1, 0.4]).as_matrix()
    elif change == "translation":
        shift = np.array([5e3, -2e3, 8e3])
    else:
        factor = 1e3

    def move(p):
        return factor * (np.asarray(p) @ turn.T) + shift

    eye = move(EYE)
    moved = points(move(at.position), at.shading_normal @ turn.T, material=1, eye=eye)
    balls = Blockers(move(blocking.centers), factor * blocking.radii, blocking.outside, blocking.owner)
    light = (move(KEY[0]), factor * KEY[1], KEY[2])
    found = method.shade(scene([light], eye=eye), moved, balls).radiance
    # A rotation turns the masks' frames, so cells fall differently; the others only round differently.
    assert relative_rmse(found, expected) < (2e-3 if change == "rotation" else 1e-4)


def test_a_point_at_the_horizon_changes_no_other(method):
    """One pixel of a large plane far away must not cost all others their digits."""
    rng = np.random.default_rng(6)
    near, blocking = plane_grid(), random_blockers(rng)
    expected = method.shade(scene([KEY]), points(near), blocking).radiance
    far = points(np.concatenate([near, [[1e6, 0, -1e6]]]))
    assert relative_rmse(method.shade(scene([KEY]), far, blocking).radiance[:-1], expected) < 1e-5


def test_order_of_blockers_and_points_does_not_matter(method):
    rng = np.random.default_rng(7)
    at, blocking = points(plane_grid()), random_blockers(rng, 100)
    expected = method.shade(scene([KEY]), at, blocking).radiance
    order = rng.permutation(100)
    shuffled = Blockers(*(values[order] for values in vars(blocking).values()))
    np.testing.assert_array_equal(method.shade(scene([KEY]), at, shuffled).radiance, expected)


def test_lights_whose_lists_do_not_fit_together_come_in_batches(device, monkeypatch):
    """With room for one light's list, and for none: the same masks; sums of batches round differently."""
    rng = np.random.default_rng(11)
    lights = [([np.cos(k), 2.2, np.sin(k)], 0.2, 10.0) for k in range(5)]
    at, blocking = points(plane_grid(), material=1), random_blockers(rng, 60)
    asked = ("irradiance", "products", "mask_leaves")
    expected = CosineLobes(device).shade(scene(lights), at, blocking, asked)
    for room in (96, 2 * device.info.vector_width):
        monkeypatch.setattr(layout, "NEAR_ROOM", room)
        found = CosineLobes(device).shade(scene(lights), at, blocking, asked)
        np.testing.assert_allclose(found.radiance, expected.radiance, rtol=1e-6)
        for name in asked:
            np.testing.assert_allclose(found.layers[name], expected.layers[name], rtol=1e-6)
    assert found.skipped["fully_dark"] == expected.skipped["fully_dark"]


def test_blockers_that_larger_ones_hide_change_nothing(method):
    """Lists leave them out; a scene where most are hidden has the picture of the few that are not."""
    rng = np.random.default_rng(12)
    large = [[0.0, 0.7, 0.0, 0.4], [0.5, 0.9, 0.3, 0.3]]
    inside = [[*(np.array(c) + rng.normal(size=3) * r * 0.2), r * 0.15] for *c, r in large for _ in range(40)]
    at = points(plane_grid(16, size=0.4) + np.array([-0.5, 0.0, 0.3]))
    few = method.shade(scene([KEY]), at, blockers(*large))
    many = method.shade(scene([KEY]), at, blockers(*large, *inside))
    np.testing.assert_array_equal(many.radiance, few.radiance)
    assert few.skipped["penumbra"] > 0
    assert many.skipped["spheres_tested_per_pair"] < 10


@pytest.mark.parametrize("estimator", ["accurate", "paper"])
def test_devices_with_one_point_per_work_item_give_the_same_picture(device, estimator):
    """Narrow vectors, as kernels use on GPUs: sums in another order, equal within float32's rounding."""
    rng = np.random.default_rng(13)
    narrow = Device(dataclasses.replace(device.info, vector_width=4))
    lit = scene([KEY, ([-1.0, 2.0, 0.0], 0.2, 10.0)], estimator=estimator)
    at, blocking = points(plane_grid(), material=1), random_blockers(rng)
    expected = CosineLobes(device).shade(lit, at, blocking)
    found = CosineLobes(narrow).shade(lit, at, blocking)
    # A cell whose edge is within rounding of its centre may fall to either side: 1/812 of a light at most.
    assert relative_rmse(found.radiance, expected.radiance) < 1e-4
    np.testing.assert_allclose(found.radiance, expected.radiance, atol=3e-3 * expected.radiance.max())


def test_nothing_to_shade_or_no_light(method):
    empty = method.shade(scene([KEY]), points(np.empty((0, 3))), blockers())
    assert empty.radiance.shape == (0, 3)
    dark = method.shade(scene([]), points(plane_grid(4)), blockers())
    assert np.all(dark.radiance == 0)


def test_statistics_of_what_was_needed(method):
    at = points(plane_grid())
    free = method.shade(scene([KEY]), at, blockers()).skipped
    assert free["fully_lit"] == 1
    below = method.shade(scene([([0, -2, 0], 0.3, 1.0)]), at, blockers()).skipped
    assert below["below_horizon"] == 1
    shaded = method.shade(scene([KEY]), at, blockers([0.3, 0.8, 0.2, 0.3])).skipped
    assert 0 < shaded["penumbra"] < 1
    assert 0 < shaded["fully_dark"] < 1
    total = sum(shaded[name] for name in ("fully_lit", "penumbra", "fully_dark", "below_horizon"))
    assert total == pytest.approx(1)


# --- point lights -------------------------------------------------------------------------------------------


def point_scene(intensity=3.0, center=(0.3, 2.0, 0.4), radius=0.0, **materials):
    of_scene = scene([(center, 1.0, 1.0)], **materials)
    light = SphereLight(center=center, radius=radius, intensity=(intensity,) * 3)
    return of_scene.model_copy(update={"lights": {"point": Light(sphere=light)}})


def scattered(n, seed, material=0):
    return points(np.random.default_rng(seed).uniform(-1, 1, (n, 3)) * [1, 0, 1], material=material)


def test_a_point_light_falls_off_with_the_square_of_the_distance(method):
    at = scattered(500, 0)
    to_light = np.array([0.3, 2.0, 0.4]) - at.position
    distance = np.linalg.norm(to_light, axis=1)
    expected = 0.6 / np.pi * 3.0 * (to_light[:, 1] / distance) / distance**2
    found = method.shade(point_scene(albedo=0.6), at, blockers()).radiance[:, 0]
    np.testing.assert_allclose(found, expected, rtol=2e-6)


def test_a_point_light_casts_hard_shadows_like_the_reference(method):
    of_scene = point_scene(phong={"kd": 0.3, "ks": 0.4, "exponent": 200})
    at = scattered(2000, 1, material=1)
    blocking = blockers((0.1, 0.8, 0.2, 0.3), (0.4, 0.3, -0.2, 0.15))
    found = method.shade(of_scene, at, blocking).radiance
    expected = reference(of_scene, at, blocking, 2).radiance
    dark = expected[:, 0] == 0
    assert 0.02 < dark.mean() < 0.6
    wrong = (found[:, 0] == 0) != dark  # rounding decides within 1e-6 of the edge
    assert wrong.mean() < 0.002
    np.testing.assert_allclose(found[~wrong], expected[~wrong], rtol=2e-4)


def test_a_small_light_of_an_intensity_becomes_the_point_light(method):
    at = scattered(300, 2, material=1)
    of_both = [method.shade(point_scene(radius=radius), at, blockers()).radiance for radius in (0, 1e-3)]
    np.testing.assert_allclose(*of_both, rtol=1e-4)


def test_a_point_on_a_point_light_is_finite(method):
    found = method.shade(point_scene(center=(0, 0, 0)), points(np.zeros((1, 3))), blockers()).radiance
    assert np.isfinite(found).all()


# --- threshold and layers -----------------------------------------------------------------------------------


def test_a_threshold_drops_what_is_below_it_and_only_that(method):
    materials = {"phong": {"kd": 0.02, "ks": 0.5, "exponent": 100}}
    at = points(np.linspace([-2, 0, 0], [2, 0, 0], 400), material=1)
    light, t = [((0, 2, 0), 0.4, 1.0)], 1e-3
    exact = method.shade(scene(light, **materials), at, blockers()).radiance[:, 0]
    found = method.shade(scene(light, **materials, threshold=t), at, blockers()).radiance[:, 0]
    missing = exact - found
    assert missing.max() <= 2 * t  # two terms, each below t
    assert missing.min() >= 0
    assert (missing > 0).any()
    assert (found[exact > 2 * t] > 0).all()


def test_irradiance_is_what_a_white_surface_reflects(method):
    lights = [((0, 2, 0), 0.4, 1.0), ((1, 1, 0), 0.2, 5.0)]
    line = np.linspace([-2, 0, 0], [2, 0, 0], 100)
    blocking = blockers((0.2, 0.6, 0, 0.2))
    made = method.shade(scene(lights), points(line, material=1), blocking, ("irradiance", "products")).layers
    white = method.shade(scene(lights, albedo=1.0), points(line), blocking).radiance
    np.testing.assert_allclose(made["irradiance"], np.pi * white, rtol=1e-5, atol=1e-9)
    assert made["products"].max() >= 4  # two lights, two terms each
