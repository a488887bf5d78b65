"""Plots as SVG: points stand where the axes say, and texts are escaped."""

import re
from xml.etree import ElementTree

import pytest

from coslobe.evaluate.report.plots import HEIGHT, WIDTH, Axis, Series, svg

LINE = Series("line", [(1.0, 0.01), (10.0, 0.1), (100.0, 1.0)])


def parsed(text: str) -> ElementTree.Element:
    return ElementTree.fromstring(f"<div>{text}</div>")


def circles(text: str) -> list[tuple[float, float]]:
    return [(float(c.get("cx", "")), float(c.get("cy", ""))) for c in parsed(text).iter("circle")]


def test_logarithmic_axes_space_powers_evenly():
    (x0, y0), (x1, y1), (x2, y2) = circles(svg([LINE], Axis("x", log=True), Axis("y", log=True)))
    assert x1 - x0 == pytest.approx(x2 - x1, abs=0.2)
    assert y1 - y0 == pytest.approx(y2 - y1, abs=0.2)
    assert 0 < x0 < x2 < WIDTH
    assert HEIGHT > y0 > y2 > 0


def test_linear_axes_are_linear():
    (x0, _), (x1, _), (x2, _) = circles(svg([LINE], Axis("x"), Axis("y")))
    assert (x1 - x0) / (x2 - x0) == pytest.approx(9 / 99, abs=0.002)


def test_marks_stand_at_their_value():
    text = svg([LINE], Axis("x", log=True), Axis("y"), [(10.0, "knee")])
    place = float(re.search(r'class="mark" d="M([\d.]+)', text)[1])
    assert place == pytest.approx(circles(text)[1][0], abs=0.1)


def test_points_off_a_logarithmic_axis_are_left_out():
    line = Series("line", [(0.0, 1.0), (1.0, 0.0), (2.0, 3.0), (3.0, float("nan"))])
    assert len(circles(svg([line], Axis("x", log=True), Axis("y", log=True)))) == 1
    assert "Nothing to draw" in svg([Series("none", [])], Axis("x"), Axis("y"))


def test_dots_need_not_be_joined_and_lines_have_a_legend():
    dots = Series("dots", LINE.points, joined=False)
    text = svg([LINE, dots], Axis("x"), Axis("y"))
    assert text.count('class="line') == 1
    assert parsed(text).find("ul") is not None
    assert parsed(svg([LINE], Axis("x"), Axis("y"))).find("ul") is None


def test_texts_are_escaped():
    evil = '<script>"&'
    text = svg([Series(evil, [(1, 1)], [evil]), LINE], Axis(evil), Axis(evil), [(1, evil)])
    assert "<script" not in text
    assert parsed(text) is not None


def test_one_point_and_equal_values_have_axes():
    for points in ([(3.0, 5.0)], [(1.0, 2.0), (2.0, 2.0)], [(0.0, 0.0), (0.0, 0.0)]):
        assert len(circles(svg([Series("line", points)], Axis("x"), Axis("y")))) == len(points)
