"""Which rays are traced, and what they hit."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coslobe.render import hits
from coslobe.render.assets import Assets
from coslobe.render.camera import Part, camera_rays
from coslobe.render.hits import Layer, Tracer, nearest
from coslobe.render.raycaster import RayCaster, near_rays
from coslobe.render.scene import Scene, Transform, load_scene

WHOLE = Part(0, 21 * 16)


@pytest.fixture
def traced(monkeypatch):
    """Counts what is traced, by kind."""
    count = {"_hit_plane": 0, "_hit_mesh": 0}

    def counting(name):
        original = getattr(hits, name)

        def trace(*arguments):
            count[name] += 1
            return original(*arguments)

        return trace

    for name in count:
        monkeypatch.setattr(hits, name, counting(name))
    return count


@pytest.mark.parametrize(
    ("changes", "planes", "meshes"),
    [
        ([], 1, 4),  # the cube turns
        (["animation.0.target=lights.key.sphere.radius", "animation.0.keys={0: 0.1, 3: 0.3}"], 1, 1),
        (["animation.0.target=materials.clay.phong.ks", "animation.0.keys={0: 0, 3: 1}"], 1, 1),
        (["animation.0.target=objects.ground.transform.rotate_y"], 4, 1),
        (["animation.0.target=camera.fov", "animation.0.keys={0: 40, 3: 50}"], 4, 4),
        (["animation.0.target=objects.cube.visible", "animation.0.keys={0: true, 2: false}"], 1, 1),
    ],
)
def test_only_what_moves_is_traced_again(tiny_scene, traced, changes, planes, meshes):
    file = load_scene(tiny_scene, changes)
    tracer = Tracer(Assets(None))
    for frame in range(4):
        scene = file.at(frame)
        kept, fresh = tracer.hits(scene, WHOLE), Tracer(Assets(None)).hits(scene, WHOLE)
        np.testing.assert_array_equal(kept.object, fresh.object)
        np.testing.assert_array_equal(kept.t, fresh.t)
    fresh_traces = {"_hit_plane": 4, "_hit_mesh": sum(file.at(k).objects["cube"].visible for k in range(4))}
    assert traced["_hit_plane"] - fresh_traces["_hit_plane"] == planes
    assert traced["_hit_mesh"] - fresh_traces["_hit_mesh"] == meshes


def test_large_pictures_are_not_kept(tiny_scene, traced, monkeypatch):
    monkeypatch.setattr(hits, "bands", lambda image: [WHOLE] * 100)
    scene = load_scene(tiny_scene).at(0)
    tracer = Tracer(Assets(None))
    for _ in range(2):
        tracer.hits(scene, WHOLE)
    assert traced == {"_hit_plane": 2, "_hit_mesh": 2}


def test_the_nearest_is_seen_and_of_equals_the_first(tiny_scene):
    rays = camera_rays(load_scene(tiny_scene).at(0), Part(0, 4))
    every = Layer(np.arange(4, dtype=np.int32), np.array([1.0, 2.0, 3.0, 4.0]))
    some = Layer(np.array([1, 2], np.int32), np.array([2.0, 2.5]))
    assert nearest(rays, {0: every, 1: some}).object.tolist() == [0, 0, 1, 0]
    assert nearest(rays, {0: some, 1: every}).object.tolist() == [1, 0, 0, 1]
    assert nearest(rays, {0: some, 1: every}).t.tolist() == [1, 2, 2.5, 4]
    assert nearest(rays, {5: some}).object.tolist() == [-1, 5, 5, -1]
    assert nearest(rays, {}).object.tolist() == [-1] * 4


RNG = np.random.default_rng(1)
CORNERS = RNG.normal(size=(40, 3)) * [1.0, 0.3, 0.6]
FACES = RNG.integers(0, 40, (60, 3))
number = st.floats(-3, 3)


@settings(max_examples=60, deadline=None)
@given(
    st.tuples(number, number, number),
    st.tuples(number, number, number),
    st.floats(0, 360),
    st.floats(0.05, 3),
    st.sampled_from([5, 40, 120, 170]),
)
def test_no_ray_that_hits_is_left_out(origin, place, angle, scale, fov):
    """Even of a camera within the mesh or with the mesh behind it."""
    if np.linalg.norm(np.subtract(origin, place)) < 1e-3:
        place = (place[0] + 1, *place[1:])
    look = {"origin": origin, "target": np.add(place, [0.3, 0.2, 0.1]).tolist(), "up": [0.3, 1, 0.2]}
    camera = {"look_at": look, "fov": fov}
    image = {"width": 37, "height": 29}
    scene = Scene.model_validate(
        {"camera": camera, "image": image, "materials": {}, "lights": {}, "objects": {}}
    )
    matrix = Transform(translate=place, rotate_x=angle, rotate_y=2 * angle, scale=scale).matrix()
    rays = camera_rays(scene)
    caster = RayCaster(CORNERS, FACES)
    near = near_rays(caster.hull, matrix, rays)
    inverse = np.linalg.inv(matrix[:3, :3])
    direction = scale * inverse @ rays.direction.T
    t, _, _ = caster.nearest(inverse @ (rays.origin - matrix[:3, 3]), direction)
    assert set(np.flatnonzero(np.isfinite(t))) <= set(near)
    assert len(np.unique(near)) == len(near)
