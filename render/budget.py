"""A threshold that follows a time budget, as the paper suggests in 4.3: measured on some of the points."""

from typing import TYPE_CHECKING

from coslobe.render.assets import Blockers
from coslobe.render.scene import Scene

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.methods.base import Method
    from coslobe.render.visible import Visible

TRIED = (1e-5, 1e-4, 3e-4, 1e-3, 3e-3, 1e-2, 3e-2, 1e-1)  # t_i, from invisible to jagged
SHARE = 16  # one tile in so many is timed


def within_budget(
    method: "Method", scene: Scene, sample: "Visible | GBuffer", share: float, blockers: Blockers
) -> Scene:
    """The scene with the smallest threshold, its own or a larger one, that keeps shading in its time budget.

    Times are the kernel's on a `sample` of the points, which is a `share` of them. What no threshold can
    save, such as building masks, may keep a frame above the budget: then the largest of TRIED is taken.
    """
    budget = scene.shading.time_budget
    if budget is None or len(sample) == 0:
        return scene
    tried = scene
    for threshold in (scene.shading.threshold, *(t for t in TRIED if t > scene.shading.threshold)):
        shading = scene.shading.model_copy(update={"threshold": threshold})
        tried = scene.model_copy(update={"shading": shading})
        if method.shade(tried, sample, blockers).kernel_seconds <= budget * share:
            break
    return tried
