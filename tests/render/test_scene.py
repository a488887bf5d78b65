"""Scene files: what is accepted, what is refused and in which words, `--set`, and placing objects."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from coslobe import configs
from coslobe.core.errors import CoslobeError, InvalidInput, UsageError
from coslobe.render.animation import put
from coslobe.render.scene import Description, Transform, load_scene
from coslobe.render.yamlfile import parse_yaml

SCENE = """\
coslobe: 1
camera: {look_at: {origin: [-2.5, 2.4, 3.0], target: [0, 0.3, 0], up: [0, 1, 0]}, fov: 35, fov_axis: x}
image: {width: 512, height: 512, samples: 1}
sequence: {frames: 60, fps: 30}
shading:
  at: pixels
  method: cosine_lobes
  estimator: accurate
  mask: {depth: 5, mode: centre}
  threshold: 0.0
materials:
  floor: {lambert: {albedo: [0.8, 0.8, 0.8]}}
  clay:
    phong:
      kd: [0.3, 0.3, 0.3]
      ks: 0.4
      exponent: 50
lights:
  key: {sphere: {center: [1.0, 2.2, 0.6], radius: 0.3, radiance: [30, 30, 30]}}
objects:
  ground: {plane: {size: 3.0, resolution: 1}, material: floor}
  bunny:
    mesh: sample:bunny
    spheres: {count: 64}
    material: clay
    transform: {translate: [0, 0, 0], rotate_y: 30, scale: 1.0}
animation:
  - {target: objects.bunny.transform.rotate_y, keys: {0: 0, 59: 360}}
  - {target: lights.key.sphere.center, keys: {0: [1, 2.2, 0.6], 59: [-1, 2.2, 0.6]}, interpolation: linear}
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "scene.yaml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture
def scene(tmp_path: Path) -> Path:
    return write(tmp_path, SCENE)


def test_the_contracts_scene_loads_with_its_values(scene: Path):
    scene_file = load_scene(scene)
    assert (scene_file.name, scene_file.frames, scene_file.fps) == ("scene", 60, 30.0)
    at_end = scene_file.at(59)
    assert at_end.objects["bunny"].transform.rotate_y == 360
    assert at_end.lights["key"].sphere.center == (-1.0, 2.2, 0.6)
    clay = at_end.materials["clay"].phong
    assert clay is not None
    assert clay.ks == (0.4, 0.4, 0.4)  # a colour may be a single number
    assert at_end.objects["bunny"].mesh == "sample:bunny"
    assert at_end.objects["bunny"].occludes
    assert not at_end.objects["ground"].occludes


def test_defaults_are_those_of_the_contract(tmp_path: Path):
    path = write(
        tmp_path,
        "coslobe: 1\ncamera: {look_at: {origin: [0, 1, 3], target: [0, 0, 0]}, fov: 35}\n"
        "image: {width: 4, height: 3}\nmaterials: {m: {lambert: {albedo: 1}}}\nlights: {}\n"
        "objects: {b: {mesh: sample:bunny, material: m}, p: {plane: {size: 1}, material: m}}\n",
    )
    scene_file = load_scene(path)
    scene = scene_file.at(0)
    assert (scene_file.frames, scene_file.fps) == (1, 30.0)
    assert (scene.camera.look_at.up, scene.camera.fov_axis, scene.image.samples) == ((0, 1, 0), "x", 1)
    shading = scene.shading
    assert (shading.at, shading.method, shading.estimator) == ("pixels", "cosine_lobes", "accurate")
    assert (shading.mask.depth, shading.mask.mode, shading.threshold) == (5, "centre", 0.0)
    bunny, plane = scene.objects["b"], scene.objects["p"]
    assert bunny.spheres.model_dump() == {
        "count": 64,
        "method": "balanced",
        "quality": "fast",
        "seed": 0,
        "file": None,
    }
    assert (bunny.visible, bunny.normals, bunny.occludes, plane.occludes) == (True, "smooth", True, False)
    assert plane.plane is not None
    assert plane.plane.resolution == 1
    np.testing.assert_array_equal(bunny.transform.matrix(), np.eye(4))


# (what to replace in SCENE, by what, the messages without the file's name)
BAD = {
    "below a bound": (
        "exponent: 50",
        "exponent: -3",
        ["17:7: materials.clay.phong.exponent: must be >= 0 (got -3)"],
    ),
    "radius 0": (
        "radius: 0.3",
        "radius: 0",
        ["19:9: lights.key.sphere: a light of radius 0 is a point: give intensity instead of radiance"],
    ),
    "radiance and intensity": (
        "radius: 0.3",
        "radius: 0.3, intensity: 1",
        ["19:9: lights.key.sphere: must hold exactly one of radiance, intensity"],
    ),
    "negative radius": (
        "radius: 0.3",
        "radius: -1",
        ["19:43: lights.key.sphere.radius: must be >= 0 (got -1)"],
    ),
    "scale 0": ("scale: 1.0", "scale: 0", ["26:53: objects.bunny.transform.scale: must be > 0 (got 0)"]),
    "fov": ("fov: 35", "fov: 180", ["2:83: camera.fov: must be < 180 (got 180)"]),
    "no frame": ("frames: 60", "frames: 0", ["4:12: sequence.frames: must be >= 1 (got 0)"]),
    "mask too deep": ("depth: 5", "depth: 6", ["9:10: shading.mask.depth: must be <= 5 (got 6)"]),
    "mask too flat": ("depth: 5", "depth: 1", ["9:10: shading.mask.depth: must be >= 2 (got 1)"]),
    "negative colour": (
        "[0.8, 0.8, 0.8]",
        "[0.8, -1, 0]",
        ["12:21: materials.floor.lambert.albedo: must be >= 0 (got [0.8, -1, 0])"],
    ),
    "two components": (
        "[0.8, 0.8, 0.8]",
        "[0.8, 1]",
        ["12:21: materials.floor.lambert.albedo: must be a number or three numbers [r, g, b] (got [0.8, 1])"],
    ),
    "NaN": ("fov: 35", "fov: .nan", ["2:83: camera.fov: must be finite (got NaN)"]),
    "infinite": (
        "center: [1.0, 2.2, 0.6], r",
        "center: [1.0, .inf, 0.6], r",
        ["19:18: lights.key.sphere.center: must be finite (got [1.0, Infinity, 0.6])"],
    ),
    "overflow": ("fov: 35", "fov: 1e999", ["2:83: camera.fov: must be finite (got Infinity)"]),
    "single precision": (
        "radius: 0.3",
        "radius: 1e31",
        ["19:43: lights.key.sphere.radius: must be within +-1e+30 (got 1e+31)"],
    ),
    "text for number": ("fov: 35", "fov: wide", ["2:83: camera.fov: must be a number (got wide)"]),
    "switch for number": ("fov: 35", "fov: true", ["2:83: camera.fov: must be a number (got true)"]),
    "half a pixel": ("width: 512", "width: 1.5", ["3:9: image.width: must be a whole number (got 1.5)"]),
    "choice": (
        "mode: centre",
        "mode: center",
        ["9:20: shading.mask.mode: must be 'aggressive', 'conservative' or 'centre' (got center)"],
    ),
    "unknown key": (
        "material: clay",
        "materail: clay",
        [
            "22:3: objects.bunny.material: required, but missing",
            "25:5: objects.bunny.materail: unknown key; did you mean material?",
        ],
    ),
    "unknown root key": (
        "coslobe: 1",
        "coslobe: 1\nligths: {}",
        ["2:1: ligths: unknown key; did you mean lights?"],
    ),
    "unknown material": (
        "material: clay",
        "material: cley",
        ["25:5: objects.bunny.material: no such material; did you mean clay? (got cley)"],
    ),
    "no material like it": (
        "material: clay",
        "material: xyz",
        ["25:5: objects.bunny.material: no such material; known: floor, clay (got xyz)"],
    ),
    "version": ("coslobe: 1", "coslobe: 2", ["1:1: coslobe: must be 1 (got 2)"]),
    "mapping expected": (
        "mask: {depth: 5, mode: centre}",
        "mask: 5",
        ["9:3: shading.mask: must be a mapping of keys to values (got 5)"],
    ),
    "emptied by a comment": (
        "  key: {sphere",
        "#  key: {sphere",
        [
            "18:1: lights: must be a mapping of keys to values (got null)",
            "29:6: animation.1.target: no 'key' in lights (got lights.key.sphere.center)",
        ],
    ),
    "name with a dot": (
        "  floor: ",
        "  fl.oor: ",
        [
            "12:3: materials.fl.oor: a name must be text without '.' and '=' (quote a number) (got fl.oor)",
            "21:47: objects.ground.material: no such material; did you mean fl.oor? (got floor)",
        ],
    ),
    "two kinds of material": (
        "    phong:",
        "    lambert: {albedo: 1}\n    phong:",
        ["13:3: materials.clay: must hold exactly one of lambert, phong, phong_1975, lafortune"],
    ),
    "no kind of object": (
        "    mesh: sample:bunny\n",
        "",
        ["22:3: objects.bunny: must hold exactly one of plane, mesh"],
    ),
    "plane that occludes": (
        "material: floor",
        "material: floor, occludes: true",
        ["21:3: objects.ground: a plane never occludes; leave occludes out"],
    ),
    "spheres of a plane": (
        "material: floor",
        "material: floor, spheres: {count: 2}",
        ["21:3: objects.ground: a plane has no spheres; leave spheres out"],
    ),
    "no such sample": (
        "sample:bunny",
        "sample:cow",
        ["23:5: objects.bunny.mesh: no such sample; did you mean sample:bunny? (got sample:cow)"],
    ),
    "camera in its target": (
        "target: [0, 0.3, 0]",
        "target: [-2.5, 2.4, 3.0]",
        ["2:10: camera.look_at: origin and target must differ"],
    ),
    "up along the view": (
        "up: [0, 1, 0]",
        "up: [2.5, -2.1, -3]",
        ["2:10: camera.look_at: up must not be parallel to the viewing direction"],
    ),
    "places": (
        "at: pixels",
        "at: corners",
        ["6:3: shading.at: must be 'pixels' or 'vertices' (got corners)"],
    ),
    "light lobes": (
        "estimator: accurate",
        "paper: {light_lobes: l2}",
        ["8:11: shading.paper.light_lobes: must be 'energy' or 'unit' (got l2)"],
    ),
    "threshold": (
        "threshold: 0.0",
        "threshold: -0.001",
        ["10:3: shading.threshold: must be >= 0 (got -0.001)"],
    ),
    "no table of fits": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {fit: a.csv, name: b}",
        ["12:23: materials.floor.lafortune.fit: no such file: {folder}/a.csv (got a.csv)"],
    ),
    "fit without a name": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {fit: scene.yaml}",
        ["12:11: materials.floor.lafortune: must hold either kd and lobes, or fit and name"],
    ),
    "table without columns": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {fit: scene.yaml, name: b}",
        ["12:11: materials.floor.lafortune: {file}:1: no column name; known: coslobe: 1"],
    ),
    "no lobe at all": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {}",
        ["12:11: materials.floor.lafortune: must hold either kd and lobes, or fit and name"],
    ),
    "lobe without a direction": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {lobes: [{rho: 1, c: [0, 0, 0], exponent: 2}]}",
        ["12:31: materials.floor.lafortune.lobes.0: c must not be [0, 0, 0]"],
    ),
    "lobe that no number holds": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {lobes: [{rho: 1, c: [-1, -1, 2], exponent: 16600}]}",
        [
            "12:31: materials.floor.lafortune.lobes.0: rho |c|^exponent = 10^4997 is too large; "
            "scale c to a largest component of 1"
        ],
    ),
    "direction of two numbers": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {lobes: [{rho: 1, c: [1, 1], exponent: 2}]}",
        ["12:40: materials.floor.lafortune.lobes.0.c: must be three numbers [x, y, z] (got [1, 1])"],
    ),
    "tangent without a direction": (
        "lambert: {albedo: [0.8, 0.8, 0.8]}",
        "lafortune: {kd: 1, tangent: [0, 0, 0]}",
        ["12:11: materials.floor.lafortune: tangent must not be [0, 0, 0]"],
    ),
    "no picture": (
        "ks: 0.4",
        "ks: {texture: a.png}",
        ["16:12: materials.clay.phong.ks.texture: no such file: {folder}/a.png (got a.png)"],
    ),
    "key of a texture": (
        "ks: 0.4",
        "ks: {texture: scene.yaml, scael: 2}",
        ["16:33: materials.clay.phong.ks.scael: unknown key; did you mean scale?"],
    ),
    "texture without a picture": (
        "exponent: 50",
        "exponent: {scale: 2}",
        ["17:7: materials.clay.phong.exponent.texture: required, but missing"],
    ),
    "texture in a colour": (
        "kd: [0.3, 0.3, 0.3]",
        "kd: [0.3, {texture: scene.yaml}, 0.3]",
        ['15:7: materials.clay.phong.kd: must be a number (got [0.3, {"texture": "scene.yaml"}, 0.3])'],
    ),
    "texture as a key value": (
        "objects.bunny.transform.rotate_y, keys: {0: 0, 59: 360}",
        "materials.clay.phong.exponent, keys: {0: 0, 59: {texture: scene.yaml}}",
        [
            "28:58: animation.0.keys.59: must be a number; of a texture, scale and offset can be animated",
        ],
    ),
    "other fits": (
        "{count: 64}",
        "{method: convex}",
        ["24:15: objects.bunny.spheres.method: must be 'balanced', 'variational' or 'medial' (got convex)"],
    ),
    "unknown target": (
        "objects.bunny.transform.rotate_y, k",
        "objects.buny.transform.rotate_y, k",
        [
            "28:6: animation.0.target: no 'buny' in objects; did you mean bunny? "
            "(got objects.buny.transform.rotate_y)"
        ],
    ),
    "target of text": (
        "objects.bunny.transform.rotate_y, k",
        "objects.bunny.material, k",
        [
            "28:6: animation.0.target: only numbers, colours, vectors and visible can be animated "
            "(got objects.bunny.material)"
        ],
    ),
    "target that must not change": (
        "objects.bunny.transform.rotate_y, k",
        "image.width, k",
        ["28:6: animation.0.target: must be the same in all frames (got image.width)"],
    ),
    "key out of bounds": (
        "objects.bunny.transform.rotate_y, keys: {0: 0, 59: 360}",
        "objects.bunny.transform.scale, keys: {0: 1, 59: -1}",
        ["28:58: animation.0.keys.59: must be > 0 (got -1)"],
    ),
    "key of another shape": (
        "keys: {0: 0, 59: 360}",
        "keys: {0: [1, 2, 3], 59: 360}",
        ["28:55: animation.0.keys.0: must be a number (got [1, 2, 3])"],
    ),
    "no keys": ("keys: {0: 0, 59: 360}", "keys: {}", ["28:48: animation.0.keys: must not be empty"]),
    "animated twice": (
        "objects.bunny.transform.rotate_y, k",
        "lights.key.sphere.center.0, k",
        ["29:6: animation.1.target: animated twice (got lights.key.sphere.center)"],
    ),
    "key twice": (
        "  threshold: 0.0",
        "  threshold: 0.0\n  at: pixels",
        ["11:3: at: the key stands twice, first at {file}:6:3"],
    ),
    "code": (
        "exponent: 50",
        "exponent: !!python/object/apply:os.getcwd []",
        ["17:17: !!python/object/apply:os.getcwd: only plain data may stand here"],
    ),
    "not YAML": ("image: {", "image: {{", None),
    "several at once": (
        "width: 512, height: 512, samples: 1}",
        "width: 0, hieght: 512, samples: 0}",
        [
            "3:1: image.height: required, but missing",
            "3:9: image.width: must be >= 1 (got 0)",
            "3:19: image.hieght: unknown key; did you mean height?",
            "3:32: image.samples: must be >= 1 (got 0)",
        ],
    ),
}


@pytest.mark.parametrize(("old", "new", "messages"), BAD.values(), ids=BAD.keys())
def test_bad_scenes_are_refused_in_words_with_their_place(tmp_path: Path, old: str, new: str, messages):
    assert old in SCENE
    path = write(tmp_path, SCENE.replace(old, new))
    with pytest.raises(InvalidInput) as error:
        load_scene(path)
    lines = str(error.value).splitlines()
    if messages is None:
        assert re.match(rf"{re.escape(str(path))}:\d+:\d+: not valid YAML: ", lines[0])
    else:
        expected = [
            message.replace("{file}", str(path)).replace("{folder}", str(tmp_path)) for message in messages
        ]
        assert lines == [f"{path}:{message}" for message in expected]
    assert error.value.exit_status == 3


@pytest.mark.parametrize("text", ["", "[1, 2]", "plain", "&a [*a]", "? [1]\n: 2", "\x07", "a: 1\n---\nb: 2"])
def test_what_is_no_scene_is_refused_with_its_place(tmp_path: Path, text: str):
    with pytest.raises(InvalidInput, match=r"scene.yaml:\d+:\d+: "):
        load_scene(write(tmp_path, text))


def test_what_is_not_text_is_refused_with_its_line(tmp_path: Path):
    path = tmp_path / "scene.yaml"
    path.write_bytes(b"coslobe: 1\nname: \xff\xfe\n")
    with pytest.raises(InvalidInput, match=r"scene.yaml:2:1: not UTF-8"):
        load_scene(path)


def test_aliases_cannot_fill_the_memory(tmp_path: Path):
    lines = ["a0: &a0 [1, 1, 1, 1, 1, 1, 1, 1, 1, 1]"]
    lines += [f"a{i}: &a{i} [{', '.join([f'*a{i - 1}'] * 10)}]" for i in range(1, 12)]
    with pytest.raises(InvalidInput, match="more than"):
        load_scene(write(tmp_path, "\n".join(lines)))


@settings(max_examples=60, deadline=None)
@given(st.text(max_size=80), st.integers(0, len(SCENE)), st.integers(0, 40))
def test_damaged_scenes_never_fail_otherwise_than_with_an_error_of_ours(
    tmp_path_factory, text: str, at: int, length: int
):
    path = tmp_path_factory.mktemp("fuzz") / "scene.yaml"
    path.write_text(SCENE[:at] + text + SCENE[at + length :], encoding="utf-8", errors="surrogatepass")
    try:
        load_scene(path).at(7)
    except CoslobeError as error:
        assert str(path) in str(error)  # noqa: PT017


ANYTHING = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=4) | st.just(10**400),
    lambda children: (
        st.lists(children, max_size=4) | st.dictionaries(st.text(max_size=4), children, max_size=3)
    ),
    max_leaves=6,
)
PLACES = [path for path in parse_yaml(SCENE, "scene").places if path]


@settings(max_examples=100, deadline=None)
@given(st.sampled_from(PLACES), ANYTHING)
def test_any_value_in_any_place_is_taken_or_refused_with_an_error_of_ours(tmp_path_factory, path, value):
    data = put(parse_yaml(SCENE, "scene").data, path, value)
    file = write(tmp_path_factory.mktemp("any"), json.dumps(data))
    try:
        load_scene(file).at(7)
    except InvalidInput as error:
        assert all(f"{file}:" in line for line in str(error).split("\n"))  # noqa: PT017


def test_missing_files_are_named_and_found_ones_become_absolute(tmp_path: Path):
    path = write(tmp_path, SCENE.replace("sample:bunny", "meshes/b.obj"))
    with pytest.raises(
        InvalidInput, match=r"23:5: objects.bunny.mesh: no such file: .*b.obj \(got meshes/b.obj\)"
    ):
        load_scene(path)
    (tmp_path / "meshes").mkdir()
    (tmp_path / "meshes" / "b.obj").touch()
    assert load_scene(path).at(0).objects["bunny"].mesh == str(tmp_path / "meshes" / "b.obj")
    with pytest.raises(InvalidInput, match=r"no such file"):
        load_scene(write(tmp_path, SCENE.replace("sample:bunny", "b" * 300)))


@pytest.mark.parametrize(
    ("override", "read", "expected"),
    [
        ("lights.key.sphere.radius=0.2", lambda s: s.lights["key"].sphere.radius, 0.2),
        ("image.samples=4", lambda s: s.image.samples, 4),
        ("camera.look_at.origin=[1, 2, 3]", lambda s: s.camera.look_at.origin, (1, 2, 3)),
        ("camera.look_at.origin.1=7", lambda s: s.camera.look_at.origin, (-2.5, 7, 3)),
        ("objects.ground.transform.rotate_x=90", lambda s: s.objects["ground"].transform.rotate_x, 90),
        ("objects.bunny.normals=flat", lambda s: s.objects["bunny"].normals, "flat"),
        ("objects.bunny.visible=false", lambda s: s.objects["bunny"].visible, False),
        ("objects.bunny.spheres.quality=best", lambda s: s.objects["bunny"].spheres.quality, "best"),
        (
            "materials.floor={phong: {kd: 1, ks: 0, exponent: 2}}",
            lambda s: s.materials["floor"].phong.kd,
            (1, 1, 1),
        ),
        ("animation=[]", lambda s: s.objects["bunny"].transform.rotate_y, 30),
        ("animation.0.keys.59=59", lambda s: s.objects["bunny"].transform.rotate_y, 12),
        ("animation.0.interpolation=step", lambda s: s.objects["bunny"].transform.rotate_y, 0),
    ],
)
def test_set_changes_one_value(scene: Path, override: str, read, expected):
    assert read(load_scene(scene, [override]).at(12)) == expected


def test_later_overrides_see_earlier_ones(scene: Path):
    overrides = ["objects.bunny.spheres={count: 7}", "objects.bunny.spheres.seed=3"]
    spheres = load_scene(scene, overrides).at(0).objects["bunny"].spheres
    assert (spheres.count, spheres.seed) == (7, 3)


@pytest.mark.parametrize(
    ("override", "message"),
    [
        ("lights.kee.sphere.radius=1", "no 'kee' in lights; did you mean key?"),
        ("lights.key.sphere.raduis=1", "no 'raduis' in lights.key.sphere; did you mean radius?"),
        ("image.size=1", "no 'size' in image; known: width, height, samples"),
        ("camera.look_at.origin.3=1", "no '3' in camera.look_at.origin; it holds 3 items, counted from 0"),
        ("image.width.x=1", "no 'x' in image.width"),
        ("image.width", "no value"),
        ("=3", "no ''"),
        ("image.width=[1", "not valid YAML"),
    ],
)
def test_set_paths_that_lead_nowhere_are_usage_errors(scene: Path, override: str, message: str):
    with pytest.raises(UsageError, match=re.escape(message)) as error:
        load_scene(scene, [override])
    assert error.value.exit_status == 2


def test_a_bad_value_from_set_is_blamed_on_set(scene: Path):
    with pytest.raises(InvalidInput) as error:
        load_scene(scene, ["lights.key.sphere.radius=-1"])
    assert str(error.value) == (
        "--set lights.key.sphere.radius=-1: lights.key.sphere.radius: must be >= 0 (got -1)"
    )


def test_animated_values_that_do_not_go_together_name_the_frame(tmp_path: Path):
    text = SCENE.replace(
        "objects.bunny.transform.rotate_y, keys: {0: 0, 59: 360}",
        "camera.look_at.origin, keys: {0: [0, 1.3, 1], 30: [0, 0.3, 0]}",
    )
    scene_file = load_scene(write(tmp_path, text))
    scene_file.at(29)
    with pytest.raises(
        InvalidInput, match=r":2:10: camera.look_at: origin and target must differ, at frame 30"
    ):
        scene_file.at(30)


def test_scale_then_rotations_then_translation():
    transform = Transform(translate=(1, 2, 3), rotate_x=90, rotate_y=90, scale=2)
    # y is doubled, turned to z about x, and from there to x about y.
    np.testing.assert_allclose(transform.matrix() @ [0, 1, 0, 1], [3, 2, 3, 1], atol=1e-15)
    turned = Transform(rotate_z=90).matrix() @ [1, 0, 0, 1]
    np.testing.assert_allclose(turned, [0, 1, 0, 1], atol=1e-15)


@given(st.lists(st.floats(-720, 720), min_size=3, max_size=3), st.floats(1e-3, 1e3))
def test_transforms_are_similarities(angles: list[float], scale: float):
    x, y, z = angles
    linear = Transform(rotate_x=x, rotate_y=y, rotate_z=z, scale=scale).matrix()[:3, :3] / scale
    np.testing.assert_allclose(linear @ linear.T, np.eye(3), atol=1e-14)  # a few roundings
    np.testing.assert_allclose(np.linalg.det(linear), 1, atol=1e-14)


@pytest.mark.parametrize(
    "path", sorted(configs.path("bunny").parent.glob("*.yaml")), ids=lambda path: path.stem
)
def test_shipped_scenes_are_valid_in_all_frames(path: Path):
    scene_file = load_scene(path)
    for frame in range(scene_file.frames):
        scene_file.at(frame)


def test_the_schema_describes_every_key():
    schema = json.loads(json.dumps(Description.model_json_schema()))
    assert {"coslobe", "camera", "image", "materials", "lights", "objects"} == set(schema["required"])
    for part in [schema, *schema["$defs"].values()]:
        assert part["additionalProperties"] is False
        assert part["description"]
    constant, texture = schema["$defs"]["Phong"]["properties"]["exponent"]["anyOf"]
    assert constant["minimum"] == 0
    assert texture["$ref"] == "#/$defs/Texture"


DOCS = Path(__file__).parents[2] / "docs" / "scene_file.md"


def test_the_documented_scene_is_valid(tmp_path: Path):
    block = DOCS.read_text().split("```yaml\n")[1].split("```")[0]
    scene_file = load_scene(write(tmp_path, block.replace("bunny.ply", "sample:bunny")))
    assert scene_file.at(59).objects["bunny"].transform.rotate_y == 360


def test_every_key_is_documented():
    text = DOCS.read_text()
    for part in Description.model_json_schema()["$defs"].values():
        for key in part["properties"]:
            assert re.search(rf"\b{key}\b", text), key
