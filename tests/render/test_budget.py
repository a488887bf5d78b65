"""The threshold that follows a time budget."""

from types import SimpleNamespace

import numpy as np
import pytest

from coslobe.render.assets import Assets, world_blockers
from coslobe.render.budget import SHARE, TRIED, within_budget
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.scene import load_scene


class Timed:
    """A method that takes a microsecond per point, less what the threshold saves."""

    def shade(self, scene, gbuffer, blockers, layers=()):
        saved = np.interp(scene.shading.threshold, [0, 1e-2], [0, 0.5])
        return SimpleNamespace(kernel_seconds=1e-6 * len(gbuffer) * (1 - saved))


@pytest.fixture
def frame(tiny_scene):
    def at(*changes):
        scene = load_scene(tiny_scene, ["image.width=210", "image.height=160", *changes]).at(0)
        assets = Assets(None)
        points = trace_gbuffer(scene, assets)
        sample = points.some(np.arange(0, len(points), SHARE))
        return scene, sample, len(sample) / len(points), world_blockers(scene, assets)

    return at


def test_without_a_budget_the_threshold_stays(frame):
    scene, *arguments = frame("shading.threshold=0.002")
    assert within_budget(Timed(), scene, *arguments) is scene


@pytest.mark.parametrize("share", [2.0, 0.96, 0.7])
def test_the_smallest_threshold_in_budget_is_taken(frame, share):
    scene, *arguments = frame()
    sample, part, _ = arguments
    budget = 1e-6 * len(sample) / part * share
    shading = scene.shading.model_copy(update={"time_budget": budget})
    found = within_budget(Timed(), scene.model_copy(update={"shading": shading}), *arguments)
    needed = 2e-2 * (1 - share)
    expected = 0.0 if share >= 1 else min(t for t in TRIED if t >= needed)
    assert found.shading.threshold == expected


def test_an_impossible_budget_takes_the_largest(frame):
    scene, *arguments = frame("shading.time_budget=1e-9")
    assert within_budget(Timed(), scene, *arguments).shading.threshold == TRIED[-1]


def test_a_threshold_above_all_that_are_tried_is_kept(frame):
    scene, *arguments = frame("shading.time_budget=1e-9", "shading.threshold=0.5")
    assert within_budget(Timed(), scene, *arguments).shading.threshold == 0.5
