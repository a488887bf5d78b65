"""Error maps and the words of the report."""

import numpy as np
import pytest
from PIL import Image

from coslobe.evaluate.pictures import COLOURS, error_colours, error_scale, write_error_map
from coslobe.evaluate.split import PARTS
from coslobe.evaluate.verdicts import duration, percent, verdicts

SPACE = "\N{NO-BREAK SPACE}"


@pytest.mark.parametrize(
    ("largest", "scale"), [(0.0009, 0.001), (0.013, 0.02), (0.2, 0.2), (0.21, 0.5), (0.6, 1.0), (7.0, 10.0)]
)
def test_scales_are_round_numbers_above_the_errors(largest, scale):
    assert error_scale([np.array([0.0]), np.array([-largest, largest])]) == pytest.approx(scale)


def test_the_scale_of_no_error_is_small_but_there():
    assert error_scale([np.zeros(5)]) > 0
    assert error_scale([np.zeros(0)]) > 0


def test_a_few_outliers_do_not_set_the_scale():
    errors = np.full(1000, 0.01)
    errors[:3] = 50
    assert error_scale([errors]) == pytest.approx(0.01)


def test_colours_of_the_ends_and_the_middle():
    def rgb(text):
        return [int(text[i : i + 2], 16) for i in (1, 3, 5)]

    colours = error_colours(np.array([-9.0, -0.1, 0.0, 0.1, 9.0]), 0.1)
    ends = [rgb(COLOURS[0]), rgb(COLOURS[0]), rgb(COLOURS[3]), rgb(COLOURS[-1]), rgb(COLOURS[-1])]
    np.testing.assert_array_equal(colours, ends)


def test_the_background_of_an_error_map_is_transparent(tmp_path):
    hit = np.array([[True, False], [True, True]])
    write_error_map(tmp_path / "map.png", np.zeros((2, 2)), hit, 0.1)
    with Image.open(tmp_path / "map.png") as image:
        np.testing.assert_array_equal(np.asarray(image)[..., 3] > 0, hit)


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (None, "–"),
        (0.0, f"0.00{SPACE}%"),
        (0.00213, f"0.21{SPACE}%"),
        (0.0291, f"2.9{SPACE}%"),
        (0.01, f"1.0{SPACE}%"),
        (0.123, f"12{SPACE}%"),
        (1.46, f"150{SPACE}%"),
        (-0.012, f"−1.2{SPACE}%"),
        (-0.000004, f"0.00{SPACE}%"),
    ],
)
def test_percentages(value, text):
    assert percent(value) == text


def test_durations():
    assert [duration(t) for t in (None, 0.0123, 4.567)] == ["–", "12.3 ms", "4.57 s"]


def means(**values):
    mean = {
        "relative_rmse_spheres": 0.003,
        "noise_spheres": 0.001,
        "relative_rmse_mesh": 0.03,
        "bias_mesh": 0.002,
        "noise_mesh": 0.001,
        "split": {"geometry": 0.03, "visibility": 0.0, "lobes": 0.003},
    }
    return mean | values


@pytest.mark.parametrize(
    ("values", "grades"),
    [
        ({}, ["good", "good", "good"]),
        ({"relative_rmse_spheres": 0.01}, ["fair", "good", "good"]),
        ({"relative_rmse_spheres": 0.03}, ["poor", "good", "good"]),
        ({"relative_rmse_mesh": 0.05}, ["good", "fair", "good"]),
        ({"relative_rmse_mesh": 0.1, "bias_mesh": -0.05}, ["good", "poor", "poor"]),
        # the error is all noise: good where that noise is small, else nothing can be said
        ({"relative_rmse_spheres": 0.004, "noise_spheres": 0.004}, ["good", "good", "good"]),
        ({"relative_rmse_spheres": 0.02, "noise_spheres": 0.02}, ["info", "good", "good"]),
        # most of it is noise, and what is left is small
        ({"relative_rmse_spheres": 0.0061, "noise_spheres": 0.005}, ["good", "good", "good"]),
    ],
)
def test_grades(values, grades):
    found = verdicts(means(**values), [])
    light, shape, brightness = (
        next(verdict for verdict in found if verdict.title.startswith(words))
        for words in (("Light", "The reference"), "Spheres", "Brightness")
    )
    assert [light.grade, shape.grade, brightness.grade] == grades


def frame(local: float, floor: float, **zones) -> dict:
    """What verdicts read of a frame."""
    return {
        "index": 7,
        "kernel_seconds": None,
        "local_max_spheres": local,
        "noise_floor": {"spheres": {"local_max": floor}},
        "zones": {name: {"split": dict(zip(PARTS, split, strict=True))} for name, split in zones.items()},
    }


@pytest.mark.parametrize(
    ("local", "floor", "grade"), [(0.06, 0.02, "good"), (0.08, 0.01, "fair"), (0.2, 0.05, "poor")]
)
def test_a_single_place_is_judged_beside_the_noise(local, floor, grade):
    found = verdicts(means(), [frame(0.01, 0.01), frame(local, floor)])
    (place,) = (verdict for verdict in found if "5 × 5" in verdict.text)
    assert place.grade == grade
    assert "frame 7" in place.text


def test_what_dominates_is_said_for_each_zone():
    zones = {"lit": (3.0, 4.0, 0.0), "penumbra": (0.0, 1.0, 1e-9), "umbra": (0.0, 0.0, 0.0)}
    found = verdicts(means(), [frame(0.0, 0.0, **zones)])
    (cause,) = (verdict for verdict in found if verdict.title.startswith("Most of the error"))
    assert "spheres in place of meshes" in cause.title
    assert f"the bit masks where it is lit (64{SPACE}%) and in penumbra (100{SPACE}%)" in cause.text
    assert "umbra (" not in cause.text.replace("penumbra (", "")
    assert "too little" in verdicts(means(bias_mesh=-0.02), [])[-1].text
