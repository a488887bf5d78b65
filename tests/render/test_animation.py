"""Keyframes: exact at the keys, between them within them, constant outside."""

import math
from bisect import bisect_right

import pytest
from hypothesis import given
from hypothesis import strategies as st

from coslobe.render.animation import Track, animated, put
from coslobe.render.scene import load_scene

NUMBER = st.floats(-1e6, 1e6)
INTERPOLATION = st.sampled_from(["linear", "step", "smooth"])


def keys(values):
    """Between one and six frames with a value each, in order."""
    return st.dictionaries(st.integers(-50, 50), values, min_size=1, max_size=6).map(
        lambda d: sorted(d.items())
    )


def track(pairs, interpolation="linear") -> Track:
    frames, values = zip(*pairs, strict=True)
    return Track(("x",), frames, values, interpolation)


@given(keys(NUMBER), INTERPOLATION)
def test_keys_are_met_exactly(pairs, interpolation):
    moving = track(pairs, interpolation)
    assert [moving.at(frame) for frame, _ in pairs] == [value for _, value in pairs]


@given(keys(NUMBER), INTERPOLATION, st.integers(1, 1000))
def test_values_are_held_outside_the_keys(pairs, interpolation, beyond):
    moving = track(pairs, interpolation)
    assert moving.at(pairs[0][0] - beyond) == pairs[0][1]
    assert moving.at(pairs[-1][0] + beyond) == pairs[-1][1]


@given(keys(NUMBER), INTERPOLATION, st.integers(-60, 60))
def test_values_stay_within_their_neighbours(pairs, interpolation, frame):
    last = max(bisect_right([key for key, _ in pairs], frame) - 1, 0)
    neighbours = [value for _, value in pairs[last : last + 2]]
    assert min(neighbours) <= track(pairs, interpolation).at(frame) <= max(neighbours)


@given(keys(st.tuples(NUMBER, NUMBER, NUMBER)), INTERPOLATION, st.integers(-60, 60))
def test_vectors_are_interpolated_by_component(pairs, interpolation, frame):
    components = [track([(key, value[i]) for key, value in pairs], interpolation).at(frame) for i in range(3)]
    assert track(pairs, interpolation).at(frame) == tuple(components)


@given(keys(st.booleans() | st.integers()), INTERPOLATION, st.integers(-60, 60))
def test_switches_and_whole_numbers_step(pairs, interpolation, frame):
    assert track(pairs, interpolation).at(frame) == track(pairs, "step").at(frame)
    assert track(pairs, "step").at(frame) in [value for _, value in pairs]


@pytest.mark.parametrize(
    ("interpolation", "expected"),
    [
        ("linear", [0.0, 2.5, 5.0, 7.5, 10.0]),
        ("step", [0.0, 0.0, 0.0, 0.0, 10.0]),
        ("smooth", [0.0, 1.5625, 5.0, 8.4375, 10.0]),  # 10 (3 t^2 - 2 t^3) at quarters
    ],
)
def test_closed_forms(interpolation, expected):
    assert [track([(0, 0.0), (4, 10.0)], interpolation).at(frame) for frame in range(5)] == expected


@given(NUMBER, st.integers(1, 1000), st.integers(0, 1000), INTERPOLATION)
def test_what_does_not_change_stays_the_same_to_the_last_bit(value, length, frame, interpolation):
    assert track([(0, value), (length, value)], interpolation).at(frame) == value


def test_data_is_copied_only_along_the_path():
    data = {"a": {"b": [1, 2, 3]}, "c": {"d": 4}}
    changed = animated(data, [Track(("a", "b", 1), (0,), (9.0,), "linear")], 5)
    assert changed == {"a": {"b": [1, 9.0, 3]}, "c": {"d": 4}}
    assert data["a"]["b"] == [1, 2, 3]
    assert changed["c"] is data["c"]
    assert put({"a": {}}, ("a", "new", "key"), 1) == {"a": {"new": {"key": 1}}}


# Values of every kind that can be animated: path, text of two keys, how to read it from the scene.
ANIMATED = {
    "number": ("lights.key.sphere.radius", 0.1, 0.3, lambda s: s.lights["key"].sphere.radius),
    "vector": ("camera.look_at.origin", [1, 2, 3], [3, 2, 1], lambda s: s.camera.look_at.origin),
    "component": ("camera.look_at.origin.1", 2.0, 3.0, lambda s: s.camera.look_at.origin[1]),
    "colour": ("lights.key.sphere.radiance", 4, [1, 2, 3], lambda s: s.lights["key"].sphere.radiance),
    "optional": ("objects.cube.transform.scale", 1, 2, lambda s: s.objects["cube"].transform.scale),
    "switch": ("objects.cube.visible", True, False, lambda s: s.objects["cube"].visible),
    "whole number": ("shading.mask.depth", 3, 5, lambda s: s.shading.mask.depth),
    "material": ("materials.clay.phong.exponent", 5, 500, lambda s: s.materials["clay"].phong.exponent),
    "reflectance": (
        "materials.clay.phong.kd",
        [0, 0.5, 1],
        [1, 1, 0],
        lambda s: s.materials["clay"].phong.kd,
    ),
    "texture": (
        "materials.wood.phong.exponent.scale",
        10,
        90,
        lambda s: s.materials["wood"].phong.exponent.scale,
    ),
    "lobe": ("materials.silk.lafortune.lobes.0.c", [-1, -1, 1], [1, 1, 1], lambda s: silk(s).c),
    "lobe's component": ("materials.silk.lafortune.lobes.0.c.2", 0.5, 1.0, lambda s: silk(s).c[2]),
}

MATERIALS = """
  wood: {phong: {kd: 1, ks: 1, exponent: {texture: tiny.yaml, scale: 3}}}
  silk: {lafortune: {kd: 0.1, lobes: [{rho: 1, c: [-1, -1, 1], exponent: 9}]}}
"""


def silk(scene):
    return scene.materials["silk"].lafortune.lobes[0]


@pytest.mark.parametrize(("target", "first", "last", "read"), ANIMATED.values(), ids=ANIMATED.keys())
def test_scenes_animate_every_kind_of_value(tiny_scene, target, first, last, read):
    tiny_scene.write_text(tiny_scene.read_text().replace("materials:\n", "materials:" + MATERIALS))
    entry = f"{{target: {target}, keys: {{0: {_yaml(first)}, 2: {_yaml(last)}}}}}"
    scene_file = load_scene(tiny_scene, [f"animation=[{entry}]"])

    def expanded(value):
        colour = target.endswith("radiance") and not isinstance(value, list)
        return (value,) * 3 if colour else tuple(value) if isinstance(value, list) else value

    assert read(scene_file.at(0)) == expanded(first)
    assert read(scene_file.at(2)) == read(scene_file.at(3)) == expanded(last)
    middle = read(scene_file.at(1))
    if isinstance(first, bool) or "depth" in target:
        assert middle == first
    elif isinstance(middle, tuple):
        pairs = zip(expanded(first), expanded(last), strict=True)
        assert middle == tuple((a + b) / 2 for a, b in pairs)
    else:
        assert math.isclose(middle, (first + last) / 2, rel_tol=1e-15)  # one rounding


def _yaml(value) -> str:
    return str(value).lower()
