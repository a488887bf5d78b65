"""Error maps and the words of the report."""

import numpy as np
import pytest
from PIL import Image

from coslobe.evaluate.pictures import COLOURS, error_colours, error_scale, write_error_map
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
    assert [verdict.grade for verdict in verdicts(means(**values), [])] == grades


def test_what_dominates_is_said():
    shape = verdicts(means(relative_rmse_spheres=0.03, relative_rmse_mesh=0.05), [])[1]
    assert f"64{SPACE}%" in shape.text  # 1 - (3/5)^2
    assert "too little" in verdicts(means(bias_mesh=-0.02), [])[2].text
