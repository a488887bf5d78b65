"""What explains the errors of a frame: its zones, and what bit masks cost; into EXR files, resumable."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.core.files import remove_leftovers
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import VERSION
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.masked import MaskedOccluders
from coslobe.evaluate.occlusion import may_block, sphere_occluders
from coslobe.evaluate.sampling import Strata, strata
from coslobe.evaluate.zones import irradiance_share
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.images import read_exr, stored_attributes, write_exr
from coslobe.render.scene import Scene, SceneFile

SEED = 1  # not that of the references

SAMPLES_SHARE = 8
"""One in so many of the references' samples does for zones, and for each of the two differences."""

FEWEST_SAMPLES = 16


@dataclass(frozen=True)
class Analysis:
    """An analysis as read from its file.

    Attributes
    ----------
    share : float64 [h, w]
        Irradiance over unshadowed irradiance, with the true meshes; see `zones.irradiance_share`.
    visibility : float64 [2, h, w, 3]
        Two independent estimates of the radiance under the masks' visibility less that under the exact
        spheres; see `masked`.
    """

    share: NDArray
    visibility: NDArray


def render_analyses(
    scene_file: SceneFile,
    folder: Path,
    *,
    references: Sequence[Sequence[Path]],
    frames: Sequence[int],
    samples: int,
    assets: Assets,
    progress: Progress = SILENT,
) -> list[Path]:
    """Write `folder`/analysis.0000.exr for each of `frames`; what is there already is kept.

    `references` are the files of the references of each frame, whose settings hashes stand for the scene.
    `samples` per pixel are those of the references, of which a part does: differences in the same directions
    have little noise.
    """
    remove_leftovers(folder)
    paths = []
    for index, files in zip(frames, references, strict=True):
        scene = scene_file.at(index)
        enough = max(samples // SAMPLES_SHARE, FEWEST_SAMPLES)
        grid = strata(-(-enough // scene.image.samples))
        hashes = [stored_attributes(path).get("config_sha256") for path in files]
        mask = scene.shading.mask.model_dump()
        code = cache.code_digest("core", "spheresets", "render", "evaluate")
        settings = cache.digest("analysis", VERSION, code, hashes, mask, grid.rows, grid.columns, index)
        path = folder / f"analysis.{index:04d}.exr"
        if stored_attributes(path).get("config_sha256") != settings:
            _render(scene, assets, grid, index, path, settings, progress)
        paths.append(path)
    return paths


def read_analysis(path: Path) -> Analysis:
    """Read a file written by `render_analyses`. Errors as in `read_exr`."""
    layers, _ = read_exr(path)
    halves = [layers[name].astype(np.float64) for name in ("visibility_a", "visibility_b")]
    return Analysis(layers["share"].astype(np.float64), np.stack(halves))


def _reached_by_shadows(scene: Scene, gbuffer: GBuffer, assets: Assets) -> NDArray:
    """Indices of the points at which anything may stand before a light: elsewhere masks are exact."""
    lights = [light.sphere for light in scene.lights.values()]
    if len(lights) > 1:  # which block one another
        return np.arange(len(gbuffer.position))
    blockers = world_blockers(scene, assets)
    balls = []
    for owner in np.unique(blockers.owner):
        centers, radii = (part[blockers.owner == owner] for part in (blockers.centers, blockers.radii))
        middle = (centers.min(axis=0) + centers.max(axis=0)) / 2
        balls.append((middle, float((np.linalg.norm(centers - middle, axis=1) + radii).max())))
    centers, radii = np.array([c for c, _ in balls]).reshape(-1, 3), np.array([r for _, r in balls])
    reached = np.zeros(len(gbuffer.position), bool)
    for light in lights:
        reached |= may_block(gbuffer.position, centers, radii, np.array(light.center), light.radius).any(
            axis=1
        )
    return np.flatnonzero(reached)


def _render(
    scene: Scene, assets: Assets, grid: Strata, index: int, path: Path, settings: str, progress: Progress
) -> None:
    gbuffer = trace_gbuffer(scene, assets)
    name = f"zones, frame {index}"
    share = irradiance_share(scene, gbuffer, assets, grid, (SEED, index), progress, name)
    exact = sphere_occluders(scene, assets)
    masked = MaskedOccluders(exact, gbuffer, scene.shading.mask)
    points = _reached_by_shadows(scene, gbuffer, assets)
    some = gbuffer.some(points)
    differences = []
    for seed in (1, 2):
        name = f"masks beside spheres, frame {index}, half {seed}"
        with_masks, with_spheres = (
            direct_light(scene, some, occluders, grid, (SEED, index, seed), progress, name).radiance
            for occluders in (masked, exact)
        )
        difference = np.zeros_like(gbuffer.position)
        difference[points] = with_masks - with_spheres
        differences.append(gbuffer.image(difference))
    layers = {
        "share": gbuffer.image(share[:, None])[..., 0]
        / np.maximum(gbuffer.image(np.ones((len(share), 1)))[..., 0], np.finfo(float).tiny),
        "visibility_a": differences[0],
        "visibility_b": differences[1],
    }
    write_exr(path, layers, {"version": VERSION, "config_sha256": settings, "frame": index})
