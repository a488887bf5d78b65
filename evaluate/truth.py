"""Converged light at some points, made once and kept in the cache."""

import hashlib
from dataclasses import dataclass
from importlib.resources import files
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.core.files import atomic_path
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import VERSION
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.reference import OccluderKind
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import world_blockers

if TYPE_CHECKING:
    from coslobe.render.assets import Assets
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene

SEED = 2009
CODE = ("direct.py", "sampling.py", "occlusion.py", "brdf.py")  # of this room, which the light depends on


@dataclass(frozen=True)
class Truth:
    """Radiance float64 [n, 3], and the variance of these means."""

    radiance: NDArray
    variance: NDArray


def cached_truth(
    scene: "Scene",
    gbuffer: "GBuffer",
    assets: "Assets",
    occluders: OccluderKind,
    samples: int,
    progress: Progress = SILENT,
) -> Truth:
    """`direct_light` at the points of `gbuffer`, from the cache where the same was asked for before."""
    path = cache.entry("truth", _key(scene, gbuffer, assets, occluders, samples), ".npz")
    try:
        with np.load(path) as found:
            return Truth(found["radiance"], found["variance"])
    except (OSError, ValueError, KeyError):
        pass  # not there yet, or not whole
    blockers = mesh_occluders(scene, assets) if occluders == "mesh" else sphere_occluders(scene, assets)
    name = f"reference with {occluders}, {samples} samples"
    estimate = direct_light(scene, gbuffer, blockers, strata(samples), (SEED,), progress, name)
    with atomic_path(path) as temporary, temporary.open("wb") as file:
        np.savez(file, radiance=estimate.radiance, variance=estimate.variance)
    return Truth(estimate.radiance, estimate.variance)


def _key(scene: "Scene", gbuffer: "GBuffer", assets: "Assets", occluders: OccluderKind, samples: int) -> str:
    """Hash of everything that the light depends on: points, materials, lights, occluders, samples, code."""
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
        "truth", VERSION, digest.hexdigest(), objects, materials, lights, occluders, samples, code
    )
