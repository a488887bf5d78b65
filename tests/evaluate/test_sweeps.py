"""Sweeps: what each changes in a scene, the knee of a curve, and a whole run with its files."""

import csv
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from typer.testing import CliRunner

from coslobe import configs
from coslobe.cli.main import app
from coslobe.core.errors import UsageError
from coslobe.evaluate.sweep_scenes import SWEEPS, knee, parse_values, with_seed
from coslobe.evaluate.sweeps import sweep_frames
from coslobe.render.scene import load_scene


@pytest.fixture(scope="module")
def fig17():
    return load_scene(configs.path("fig17")).at(0)


def test_values_are_read_in_order_and_once():
    assert parse_values(SWEEPS["ti"], "0.01,0,1e-3,0.01") == [0, 0.001, 0.01]
    assert parse_values(SWEEPS["depth"], None) == [2, 3, 4, 5]


@pytest.mark.parametrize(
    ("name", "text"), [("ti", "a"), ("ti", ""), ("ti", "-1"), ("ti", "nan"), ("depth", "2.5")]
)
def test_values_that_cannot_be_read(name, text):
    with pytest.raises(UsageError, match="--values"):
        parse_values(SWEEPS[name], text)


def test_each_sweep_sets_its_value(fig17):
    assert SWEEPS["ti"].apply(fig17, 0.25).shading.threshold == 0.25
    assert SWEEPS["depth"].apply(fig17, 3).shading.mask.depth == 3
    assert SWEEPS["spheres"].apply(fig17, 32).objects["bunny"].spheres.count == 32
    assert with_seed(fig17, 4).objects["bunny"].spheres.seed == 4
    glossy = SWEEPS["exponent"].apply(fig17, 7).materials["white"].phong
    assert (glossy.exponent, glossy.kd, glossy.ks) == (7, (0.4,) * 3, (0.4,) * 3)
    assert fig17.shading.mask.depth == 5  # the scene itself stays


def test_exponents_of_lobes_that_are_there():
    for name in ("fig16", "showcase_materials"):
        scene = load_scene(configs.path(name)).at(0)
        for material in SWEEPS["exponent"].apply(scene, 33.0).materials.values():
            own = material.phong or material.phong_1975
            assert own is None or own.exponent == 33
            assert material.lafortune is None or all(lobe.exponent == 33 for lobe in material.lafortune.lobes)


def test_light_is_split_and_not_added(fig17):
    """The lights together send what the first one did, from the same height and distance."""
    (one,) = fig17.lights.values()
    lights = [light.sphere for light in SWEEPS["lights"].apply(fig17, 5).lights.values()]
    assert len(lights) == 5
    assert sum(light.radius**2 for light in lights) == pytest.approx(one.sphere.radius**2)
    assert {light.radiance for light in lights} == {one.sphere.radiance}
    assert lights[0].center == pytest.approx(one.sphere.center)
    away = [np.linalg.norm(np.array(light.center)[[0, 2]]) for light in lights]
    assert away == pytest.approx([np.hypot(0.6, 0.4)] * 5)
    assert {light.center[1] for light in lights} == {4.0}


@pytest.mark.parametrize(("name", "value"), [("depth", 9), ("spheres", 0), ("lights", 0), ("exponent", -1)])
def test_values_that_a_scene_cannot_have(fig17, name, value):
    with pytest.raises(UsageError):
        SWEEPS[name].apply(fig17, value)


def test_a_knee_is_the_corner():
    assert knee([0, 1, 2, 3, 4], [0, 0, 0, 1, 2]) == 2
    assert knee([0, 1, 2, 3], [3, 1, 0.9, 0.8]) == 1
    assert knee([0, 1, 2, 3], [0, 1, 2, 3]) is None
    assert knee([0, 1], [0, 1]) is None
    assert knee([0, 1, 2], [1, 1, 1]) is None


@given(
    st.lists(st.floats(0, 1), min_size=3, max_size=9),
    st.floats(0.1, 10),
    st.floats(0.1, 10),
)
def test_a_knee_does_not_depend_on_units(y, a, b):
    x = list(range(len(y)))
    shift = [b * value + 1 for value in y]
    if max(y) - min(y) > 1e-6 and knee(x, y) is not None:
        found, moved = knee(x, y), knee([a * value for value in x], shift)
        line = np.abs(np.subtract(y, np.interp(x, [0, x[-1]], [y[0], y[-1]])))
        assert moved is not None
        assert line[moved] == pytest.approx(line[found], rel=1e-6)  # another of the same distance, at most


@pytest.mark.parametrize(("count", "frames"), [(1, [0]), (2, [0, 1]), (3, [0, 2]), (24, [0, 23])])
def test_frames_are_spread(count, frames):
    assert sweep_frames(count) == frames


@pytest.fixture(scope="module")
def swept(ball_scene, tmp_path_factory):
    """A sweep of the mask's depth over the ball scene, as the command runs it."""
    folder = tmp_path_factory.mktemp("sweep")
    arguments = ["eval", ball_scene, "--sweep", "depth", "--values", "2,3,5", "--frames", "0", "--seeds", "2"]
    arguments += ["--spp", "64", "-o", folder, "--set", "shading.estimator=paper", "--json"]
    result = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert result.exit_code == 0, result.output
    return json.loads(result.stdout), folder


def test_a_sweep_measures_every_value_and_seed(swept):
    document, folder = swept
    assert [(row["value"], row["seed"]) for row in document["rows"]] == [
        (value, seed) for seed in (0, 1) for value in (2, 3, 5)
    ]
    by_depth = {entry["value"]: entry for entry in document["summary"]}
    assert by_depth[2]["relative_rmse_spheres"] > by_depth[5]["relative_rmse_spheres"]
    assert by_depth[2]["leaves"] < by_depth[5]["leaves"]
    assert by_depth[2]["products"] < by_depth[5]["products"]
    assert all(row["kernel_seconds"] > 0 for row in document["rows"])
    assert by_depth[2]["own_spheres"] < by_depth[2]["relative_rmse_spheres"]
    low, high = by_depth[3]["range_spheres"]
    assert low <= by_depth[3]["relative_rmse_spheres"] <= high
    with open(folder / "results.csv", newline="") as file:
        rows = list(csv.DictReader(file))
    assert float(rows[0]["relative_rmse_mesh"]) == document["rows"][0]["relative_rmse_mesh"]
    assert (folder / "figures" / "sweep_depth.png").is_file()


def test_the_report_of_a_sweep(swept):
    _, folder = swept
    page = (folder / "report.html").read_text()
    assert page.count('<svg class="plot"') == 3
    assert "Lobe products in false colours" in page
    assert page.count("data:image/png") == 6


def test_wrong_sweeps_end_with_status_2(ball_scene, tmp_path):
    for arguments in (
        [ball_scene, "--sweep", "thing"],
        [ball_scene, "--values", "1,2"],
        [ball_scene, "--sweep", "depth", "--values", "7", "-o", tmp_path],
        [ball_scene, "--sweep", "spheres", "-o", tmp_path],  # its spheres come from a file
    ):
        result = CliRunner().invoke(app, ["eval", *map(str, arguments)])
        assert result.exit_code == 2, result.output
        assert "Traceback" not in result.output
    assert list(tmp_path.iterdir()) == []
