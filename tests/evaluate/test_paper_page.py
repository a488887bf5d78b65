"""The paper's figures: all are there, mask views agree with the mask's twins, the page shows all."""

import json
import re
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from typer.testing import CliRunner

from coslobe.cli.main import app
from coslobe.core.errors import CoslobeError
from coslobe.core.files import write_json
from coslobe.evaluate import paper_page
from coslobe.evaluate.paper_figures.figure import PaperFigure, Quantity, Rebuilt, new_plot, save_plot
from coslobe.evaluate.paper_figures.lobe_sums import difference
from coslobe.evaluate.paper_figures.mask_view import shadow_lobes, view_from
from coslobe.evaluate.paper_figures.masks import three_spheres
from coslobe.evaluate.paper_figures.thresholds import Savings
from coslobe.evaluate.report.paper import write_paper_report
from coslobe.render.assets import Assets
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import load_scene
from coslobe.tables import cap
from coslobe.tables.quadtree import disk
from coslobe.tables.weights import leaf_lobes

TABLE = {
    "rows": [
        {"scene": "14", "estimator": "paper", "stage": stage, "percent": 20.0, "seconds": 1e-3}
        | {"paper_percent": share}
        for stage, share in zip("abcde", (29.6, 15.5, 0, 0, 54.9), strict=True)
    ],
    "totals": [
        {"scene": "14", "estimator": "paper", "points": 4, "points_seconds": 1e-3, "sum_seconds": 6e-3}
        | {"fused_seconds": 5e-3}
    ],
    "mapping": {"paper": {"a": "the lobes of the reflectance"}},
}


CAPS = SimpleNamespace(cap=cap.build())  # the only one of the tables that leaves need


@pytest.fixture(scope="module")
def views(ball_scene):
    """Masks of points on the ground around a pair of balls that see some of the light."""
    overrides = ("objects.ball.mesh=pair.ply", "objects.ball.spheres.file=pair.spheres.json")
    scene = load_scene(ball_scene, overrides).at(0)
    bench = SimpleNamespace(assets=Assets(None))
    gbuffer = trace_gbuffer(scene, bench.assets)
    ground = np.flatnonzero(gbuffer.object == 0)
    found = [view_from(bench, scene, gbuffer, int(i)) for i in ground[::7]]
    return [view for view in found if view.meets.any()]


def test_every_figure_is_there_once():
    assert [figure.number for figure in paper_page.FIGURES] == list(range(2, 19))
    assert all(figure.title and figure.paper for figure in paper_page.FIGURES)


def test_a_mask_view_is_its_spheres_splatted(views):
    """On the light's disk the mask is the union of the spheres that meet it, cell by cell."""
    assert len(views) > 5
    for view in views:
        rows = len(view.blocked)
        inside = disk(rows)
        union = np.any([view.covered(i, rows) for i in np.flatnonzero(view.meets)], axis=0)
        np.testing.assert_array_equal(union & inside, view.blocked & inside)
        for i in np.flatnonzero(~view.meets):
            assert not (view.covered(i, rows) & inside).any()


def test_leaves_of_a_view_tile_its_mask(views):
    for view in views:
        rows = len(view.blocked)
        covered = np.zeros((rows, rows), int)
        for level in view.leaves:
            covered += level.repeat(rows // len(level), 0).repeat(rows // len(level), 1)
        assert covered.max() <= 1
        inside = disk(rows)
        np.testing.assert_array_equal(covered.astype(bool) & inside, view.blocked & inside)


def test_outlines_keep_their_place_at_another_scale(views):
    """A square of twice the size shows the same cells in its middle."""
    for view in views[:5]:
        index = int(np.flatnonzero(view.meets)[0])
        np.testing.assert_array_equal(view.covered(index, 64, 2.0)[16:48, 16:48], view.covered(index, 32))


def test_chosen_spheres_cover_what_any_choice_of_one_does(views):
    for view in views:
        chosen = three_spheres(view)
        assert len(chosen) == len(set(chosen)) == min(3, int(view.meets.sum()))
        sizes = [view.covered(i, len(view.blocked)).sum() for i in np.flatnonzero(view.meets)]
        assert view.covered(chosen[0], len(view.blocked)).sum() == max(sizes)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 3), st.floats(0.02, 0.8), st.floats(0.1, 2.0), st.integers(0, 2**32 - 1))
def test_the_lobe_of_one_leaf_peaks_in_the_leaf(depth, tangent, weight, seed):
    """Sums are linear in weights; a single lobe is highest in its leaf, by its amplitude times its weight."""
    leaves = [np.zeros((2**d, 2**d), bool) for d in range(depth + 1)]
    row, column = np.random.default_rng(seed).integers(2**depth, size=2)
    leaves[depth][row, column] = True
    rows = 64
    total = shadow_lobes(CAPS, leaves, tangent, np.full(depth + 1, weight), rows)
    at = np.unravel_index(total.argmax(), total.shape)
    assert (at[0] * 2**depth // rows, at[1] * 2**depth // rows) == (row, column)
    peak = weight * leaf_lobes(CAPS.cap, tangent, depth).amplitude[row, column]
    # A cell's centre is at most 0.7 cells off the axis: of 64 cells, where a leaf has 8 or more.
    assert 0.97 * peak <= total.max() <= peak * (1 + 1e-12)
    twice = shadow_lobes(CAPS, leaves, tangent, np.full(depth + 1, 2 * weight), rows)
    np.testing.assert_allclose(twice, 2 * total, rtol=1e-12)


def test_differences_and_savings_by_hand():
    found = difference(np.array([1.0, 3.0, 2.0]), np.array([1.0, 2.0, 3.0]))
    assert (found.mean, found.largest) == pytest.approx((1 / 3, 1 / 3))
    radiance = np.ones((2, 3)), np.array([[1.0] * 3, [0.5] * 3])
    products = np.array([8, 4], np.uint32), np.array([2, 1], np.uint32)
    savings = Savings(None, radiance, products)
    assert (savings.saved, savings.change) == (0.75, 0.25)


def drawn(bench, folder):
    plot = new_plot(2, 1)
    plot.subplots().plot([0, 1])
    numbers = [Quantity("rate", 20.0, 13.73, ".4g", "frames / s"), Quantity("saved <b>", 0.5, 0.4, "percent")]
    picture = save_plot(plot, folder / "figure99.png")
    return Rebuilt([("a line", picture)], "It is ours.", [*numbers, Quantity("none", None)])


def failing(bench, folder):
    raise CoslobeError("no point is lit", "look at the scene")


@pytest.fixture
def stub(monkeypatch):
    monkeypatch.setattr(paper_page, "measure_table1", lambda device, progress: TABLE)
    monkeypatch.setattr(paper_page, "Bench", lambda device, progress: None)
    described = {"name": "a device", "platform": "p", "version": "1"}
    return SimpleNamespace(describe=lambda: described)


def test_page_and_files(tmp_path, stub):
    figure = PaperFigure(99, "A line", "It was theirs.", drawn)
    document = paper_page.rebuild_paper(
        tmp_path, device=stub, command="coslobe eval --paper", chosen=[figure]
    )
    assert [entry["figure"] for entry in document["figures"]] == ["Fig. 99", "Table 1"]
    first, table = document["figures"]
    assert first["ours"] == {"rate": 20.0, "saved <b>": 0.5, "none": None}
    assert first["paper"] == {"rate": 13.73, "saved <b>": 0.4}
    assert table["paper"]["stage (e) of Fig. 14, estimator paper"] == pytest.approx(0.549)
    assert json.loads(document["results"].read_text())["figures"][0]["seconds"] == first["seconds"]
    assert "Fig. 99,rate,20.0,13.73" in (tmp_path / "results.csv").read_text().splitlines()
    text = document["report"].read_text()
    for shown in (
        "Fig. 99: A line",
        "Fig. 99: rate",
        "It was theirs.",
        "It is ours.",
        "13.73 frames / s",
        "20 frames / s",
    ):
        assert shown in text
    assert "Table 1: Time of the shading loop by stage" in text
    assert "saved &lt;b&gt;" in text
    assert "50 %" in text.replace("\N{NO-BREAK SPACE}", " ")
    sources = re.findall(r'<img src="([^"]{0,22})', text)
    assert sources == ["data:image/png;base64,"]
    assert not re.search(r'(src|href)="(?!data:)', text)


def test_a_figure_that_fails_is_named(tmp_path, stub):
    figures = [PaperFigure(5, "Dark", "", failing)]
    with pytest.raises(CoslobeError, match=r"Fig\. 5, Dark: no point is lit") as error:
        paper_page.rebuild_paper(tmp_path, device=stub, command="", chosen=figures)
    assert error.value.hint == "look at the scene"
    assert not (tmp_path / "report.html").exists()


def test_a_picture_that_is_missing_is_no_blank(tmp_path):
    entry = {"figure": "Fig. 5", "title": "t", "ours": {}, "paper": {}, "seconds": 1.0, "paper_text": ""}
    lost = entry | {"text": "", "forms": {}, "pictures": [{"label": "a", "file": "figures/lost.png"}]}
    results = tmp_path / "results.json"
    write_json(results, {"figures": [lost, entry], "table1": TABLE, "device": {"name": ""}, "command": ""})
    with pytest.raises(OSError, match="lost"):
        write_paper_report(results)


def test_a_scene_is_refused(tiny_scene):
    result = CliRunner().invoke(app, ["eval", str(tiny_scene), "--paper"])
    assert result.exit_code == 2
    assert "leave the scene out" in result.output
