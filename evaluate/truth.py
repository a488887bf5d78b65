"""Converged light at some points, made once and kept in the cache."""

import hashlib
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np

from coslobe.core import cache
from coslobe.core.files import atomic_path
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import VERSION
from coslobe.evaluate.adaptive import Goal, integrate_adaptively
from coslobe.evaluate.direct import direct_sources
from coslobe.evaluate.integration import Estimate
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.reference import OccluderKind
from coslobe.render.assets import world_blockers

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene

SEED = 2009
MOST = 1 << 12  # samples of a point and light

# Of this room, what the light depends on.
CODE = ("adaptive.py", "brdf.py", "direct.py", "integration.py", "occlusion.py", "sampling.py")


def cached_truth(
    scene: "Scene",
    gbuffer: "GBuffer",
    assets: "Assets",
    occluders: OccluderKind,
    error: float,
    progress: Progress = SILENT,
) -> Estimate:
    """Light at the points of `gbuffer`, from the cache where the same was asked for before.

    `error` is the standard error relative to the mean that is aimed at (see `adaptive.Goal`).
    """
    path = cache.entry("truth", _key(scene, gbuffer, assets, occluders, error), ".npz")
    try:
        with np.load(path) as found:
            return Estimate(found["radiance"], found["variance"])
    except (OSError, ValueError, KeyError):
        pass  # not there yet, or not whole
    blockers = mesh_occluders(scene, assets) if occluders == "mesh" else sphere_occluders(scene, assets)
    sources = direct_sources(scene, gbuffer, blockers)
    goal = Goal(error, MOST, len(gbuffer.position))
    name = f"reference with {occluders}, {len(gbuffer.position):,} points"
    estimate, _ = integrate_adaptively(sources, gbuffer.material, goal, (SEED,), name, progress)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, radiance=estimate.radiance, variance=estimate.variance)
    return estimate


def _key(scene: "Scene", gbuffer: "GBuffer", assets: "Assets", occluders: OccluderKind, error: float) -> str:
    """Hash of everything that the light depends on: points, materials, lights, occluders, error, code."""
    digest = hashlib.sha256()
    for array in (gbuffer.position, gbuffer.geometric_normal, gbuffer.shading_normal, gbuffer.view):
        digest.update(np.ascontiguousarray(array).tobytes())
    for array in (gbuffer.material, gbuffer.object):
        digest.update(np.ascontiguousarray(array).tobytes())
    if occluders == "spheres":
        blockers = world_blockers(scene, assets)
        for array in (blockers.centers, blockers.radii, blockers.outside, blockers.owner):
            digest.update(np.ascontiguousarray(array).tobytes())
    objects = {
        name: {"mesh": assets.mesh_hash(obj), "transform": obj.transform.model_dump(mode="json")}
        | {"visible": obj.visible, "occludes": obj.occludes}
        for name, obj in scene.objects.items()
        if obj.mesh is not None
    }
    materials = {name: assets.material_contents(part) for name, part in scene.materials.items()}
    lights = {name: light.model_dump(mode="json") for name, light in scene.lights.items()}
    code = [(files("coslobe.evaluate") / name).read_text(encoding="utf-8") for name in CODE]
    return cache.digest(
        "truth", VERSION, digest.hexdigest(), objects, materials, lights, occluders, error, code
    )
