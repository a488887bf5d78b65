"""Trees: levels and hierarchy of a fit in file coordinates, what is refused, and what the cache keeps."""

import dataclasses

import numpy as np
import pytest

from coslobe.core.errors import CoslobeError, UsageError
from coslobe.core.progress import Progress
from coslobe.spheresets.files import read_spheres, write_spheres
from coslobe.spheresets.fit import cached_spheres, fit_spheres
from coslobe.spheresets.mesh import load_mesh
from coslobe.spheresets.settings import FitSettings


class Listener(Progress):
    def __init__(self):
        self.lines = []

    def say(self, text):
        self.lines.append(text)


@pytest.fixture(scope="module")
def moved_ball(ball):
    return dataclasses.replace(ball, vertices=ball.vertices * 10 + [100, 0, -7], file="moved.ply")


@pytest.fixture(scope="module")
def tree(moved_ball, one_device):
    return fit_spheres(moved_ball, FitSettings(18, seed=1), device=one_device)


def test_a_tree_has_its_levels_in_file_coordinates(tree):
    assert [level.count for level in tree.levels] == [4, 16, 18]
    assert (tree.parents[0] == -1).all()
    for level, above, parents in zip(tree.levels[1:], tree.levels, tree.parents[1:], strict=False):
        assert parents.shape == (level.count,)
        assert 0 <= parents.min() <= parents.max() < above.count
    for level in tree.levels:
        reach = np.linalg.norm(level.centers - [100, 0, -7], axis=1) + level.radii
        assert 8.5 < reach.max() < 11
        # a sphere reaches out of the ball by what its farthest point does; 256 points miss little of it
        np.testing.assert_allclose(level.outside, np.maximum(reach - 10, 0), atol=0.15)
    assert (tree.method, tree.quality, tree.mode, tree.seed) == ("balanced", "fast", "balanced", 1)
    assert tree.mesh.file == "moved.ply"
    assert tree.seconds > 0


def test_the_hierarchy_holds_the_finest_level(tree):
    centers = np.concatenate([tree.hierarchy.centers, tree.finest.centers])
    radii = np.concatenate([tree.hierarchy.radii, tree.finest.radii])
    assert len(tree.hierarchy.radii) + 18 == tree.hierarchy.child_count.sum() + 1
    for node, (first, count) in enumerate(
        zip(tree.hierarchy.first_child, tree.hierarchy.child_count, strict=True)
    ):
        part = slice(first, first + count)
        gap = np.linalg.norm(centers[part] - centers[node], axis=1)
        assert (gap + radii[part] <= radii[node]).all()


def test_a_fitted_tree_survives_the_file(tree, tmp_path):
    write_spheres(tmp_path / "a.spheres.json", tree)
    np.testing.assert_array_equal(
        read_spheres(tmp_path / "a.spheres.json").finest.centers, tree.finest.centers
    )


def test_levels_are_counted_from_the_finest(ball, one_device):
    tree = fit_spheres(ball, FitSettings(6, levels=1), device=one_device)
    assert [level.count for level in tree.levels] == [6]
    assert (tree.parents[0] == -1).all()


@pytest.mark.parametrize(
    ("wrong", "complaint"),
    [
        ({"count": 0}, "count must be >= 1"),
        ({"method": "convex"}, "no method 'convex'"),
        ({"quality": "good"}, "no quality 'good'"),
        ({"mode": "around"}, "no mode 'around' with method balanced"),
        ({"levels": 0}, "levels must be >= 1"),
    ],
)
def test_what_does_not_exist_is_refused(ball, one_device, wrong, complaint):
    with pytest.raises(UsageError, match=complaint) as caught:
        FitSettings(**{"count": 4, **wrong})
    assert caught.value.hint


def test_the_cache_knows_a_mesh_by_its_content(ball_file, one_device, tmp_path):
    listener = Listener()
    settings = FitSettings(3, seed=11)
    first = cached_spheres(load_mesh(ball_file), settings, device=one_device, progress=listener)
    assert any("fitting 3 spheres" in line for line in listener.lines)
    assert first.metrics == {}

    copy = tmp_path / "copy.ply"
    copy.write_bytes(ball_file.read_bytes())
    listener.lines.clear()
    second = cached_spheres(load_mesh(copy), settings, device=one_device, progress=listener)
    assert listener.lines == []
    np.testing.assert_array_equal(first.finest.centers, second.finest.centers)
    assert second.mesh.file == str(copy)

    third = cached_spheres(load_mesh(copy), FitSettings(3, seed=12), device=one_device, progress=listener)
    assert any("fitting 3 spheres" in line for line in listener.lines)
    assert third.seed == 12


def test_metrics_join_a_cached_tree(ball_file, one_device):
    mesh = load_mesh(ball_file)
    assert cached_spheres(mesh, FitSettings(2, seed=21), device=one_device).metrics == {}
    measured = cached_spheres(mesh, FitSettings(2, seed=21), metrics=True, device=one_device)
    assert measured.metrics["silhouette_iou_mean"] > 0.9
    assert cached_spheres(mesh, FitSettings(2, seed=21), device=one_device).metrics == measured.metrics


def test_a_damaged_cache_entry_is_replaced(ball_file, one_device):
    from coslobe.core import cache

    mesh = load_mesh(ball_file)
    first = cached_spheres(mesh, FitSettings(1), device=one_device)
    for path in (cache.folder() / "spheres").iterdir():
        path.write_text("{")
    again = cached_spheres(mesh, FitSettings(1), device=one_device)
    np.testing.assert_array_equal(first.finest.centers, again.finest.centers)


def test_nothing_is_said_to_be_kept_where_it_is_not(ball_file, one_device, tmp_path, monkeypatch):
    (tmp_path / "file").write_text("")
    monkeypatch.setenv("COSLOBE_CACHE_DIR", str(tmp_path / "file" / "cache"))
    listener = Listener()
    with pytest.warns(UserWarning, match="cannot be written"):
        cached_spheres(load_mesh(ball_file), FitSettings(1), device=one_device, progress=listener)
    assert not any("kept" in line for line in listener.lines)


def test_a_full_cache_does_not_cost_the_fit(ball_file, one_device, tmp_path, monkeypatch):
    def full(*_):
        raise CoslobeError("a.spheres.json: cannot be written (No space left on device)")

    monkeypatch.setenv("COSLOBE_CACHE_DIR", str(tmp_path))
    monkeypatch.setattr("coslobe.spheresets.fit.write_spheres", full)
    with pytest.warns(UserWarning, match="No space left on device.*not kept for next time"):
        tree = cached_spheres(load_mesh(ball_file), FitSettings(1), device=one_device)
    assert tree.finest.count == 1
