"""Reference images: path-traced light without bias, frame by frame into EXR files, resumable."""

import hashlib
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.core.errors import InvalidInput
from coslobe.core.files import remove_leftovers, write_json
from coslobe.core.progress import SILENT, Progress
from coslobe.core.version import VERSION
from coslobe.evaluate.adaptive import Goal, integrate_adaptively
from coslobe.evaluate.checkpoint import Checkpoint
from coslobe.evaluate.direct import direct_sources
from coslobe.evaluate.integration import Source, integrate, uniform
from coslobe.evaluate.occlusion import mesh_occluders, sphere_occluders
from coslobe.evaluate.paths import BouncedLight
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.images import BEAUTY, read_exr, stored_attributes, write_exr
from coslobe.render.scene import Scene, SceneFile
from coslobe.render.sequence import earlier_seconds

OccluderKind = Literal["mesh", "spheres"]

SEED = 0


@dataclass(frozen=True)
class Sampling:
    """How light is integrated.

    Attributes
    ----------
    samples : int
        Per pixel and light, shared by the `image.samples` points of a pixel, and rounded up so that every
        point gets two in each of its strata (see `sampling`). With `error`, the most that any point gets.
    error : float or None
        Relative standard error of the image (see `adaptive.Goal`) at which to stop; None: never before.
    bounces : int
        Surfaces that light may meet on its way to the viewer; 1: direct light only.
    """

    samples: int
    error: float | None = None
    bounces: int = 1


@dataclass(frozen=True)
class Reference:
    """A reference image as read from its file.

    Attributes
    ----------
    radiance, variance : float64 [h, w, 3]
        The mean, and an unbiased estimate of the variance of that mean.
    samples : float64 [h, w]
        Samples per light, on average over the lights; 0 where no surface is seen.
    object : int [h, w]
        Index, in scene order, of what the pixel's first sample hits; -1 for the background.
    """

    radiance: NDArray
    variance: NDArray
    samples: NDArray
    object: NDArray

    @property
    def hit(self) -> NDArray:
        """Pixels that show a surface, bool [h, w]."""
        return self.samples > 0

    @property
    def error(self) -> float:
        """Root mean square of the pixels' standard errors over the mean of the image; 0 where it is black."""
        mean = float(self.radiance[self.hit].mean()) if self.hit.any() else 0.0
        return float(np.sqrt(self.variance[self.hit].mean())) / mean if mean > 0 else 0.0


def render_references(
    scene_file: SceneFile,
    folder: Path,
    *,
    frames: Sequence[int],
    occluders: OccluderKind,
    samples: int,
    assets: Assets,
    error: float | None = None,
    bounces: int = 1,
    progress: Progress = SILENT,
) -> list[dict[str, Any]]:
    """Render `frames` into `folder`/reference.0000.exr and a manifest; what is there already is kept.

    `samples`, `error` and `bounces` are those of `Sampling`. The same settings give the same bytes, also
    where the work was interrupted: it goes on where it was.

    Returns
    -------
    list of dict
        Per frame index, file, spp (per pixel and light; a mean with `error`), error (see `Reference`),
        seconds (of the run that made the file; None if unknown), resumed.

    Raises
    ------
    InvalidInput
        The scene is wrong at one of the frames, or a file that it names cannot be used.
    """
    remove_leftovers(folder)
    sampling = Sampling(samples, error, bounces)
    manifest = folder / "manifest.json"
    earlier = earlier_seconds(manifest)
    records: list[dict[str, Any]] = []
    hashes: list[str] = []
    try:
        for index in frames:
            scene = scene_file.at(index)
            path = folder / f"reference.{index:04d}.exr"
            settings = _settings_hash(scene, assets, occluders, sampling, index)
            done = stored_attributes(path).get("config_sha256") == settings
            start = time.perf_counter()
            if not done:
                _render(scene, assets, occluders, sampling, index, path, settings, progress)
            seconds = earlier.get(settings) if done else time.perf_counter() - start
            made = read_reference(path)
            record = {
                "index": index,
                "file": path,
                "spp": _samples(made, scene, sampling),
                "error": made.error,
            }
            records.append({**record, "seconds": seconds, "resumed": done})
            hashes.append(settings)
    finally:
        if records:
            _write_manifest(manifest, scene_file, occluders, records, hashes)
    return records


def read_reference(path: Path) -> Reference:
    """Read a file written by `render_references`.

    Raises
    ------
    InvalidInput
        The file cannot be read, or is not a reference.
    """
    layers, _ = read_exr(path)
    try:
        radiance, variance, samples, index = (
            layers[name].astype(np.float64) for name in (BEAUTY, "variance", "spp", "object")
        )
    except KeyError as error:
        raise InvalidInput(
            f"{path}: no reference: it has no layer {error}", "make one with `coslobe reference`"
        ) from error
    return Reference(radiance, variance, samples, index.astype(int))


def _render(
    scene: Scene,
    assets: Assets,
    occluders: OccluderKind,
    sampling: Sampling,
    index: int,
    path: Path,
    settings: str,
    progress: Progress,
) -> None:
    gbuffer = trace_gbuffer(scene, assets)
    blockers = mesh_occluders(scene, assets) if occluders == "mesh" else sphere_occluders(scene, assets)
    sources: list[Source] = [*direct_sources(scene, gbuffer, blockers)]
    if sampling.bounces > 1 and sources:
        sources.append(BouncedLight(scene, assets, gbuffer, blockers, sampling.bounces))
    grid = strata(-(-sampling.samples // scene.image.samples))
    checkpoint = Checkpoint(path.with_suffix(".partial.npz"), settings)
    listening = f"reference with {occluders}, frame {index}", progress, checkpoint
    if sampling.error is None:
        choice = uniform(grid, len(sources), len(gbuffer.position))
        estimate, _ = integrate(sources, gbuffer.material, choice, (SEED, index), *listening)
    else:
        goal = Goal(sampling.error, grid.samples, len(np.unique(gbuffer.pixel)))
        estimate, choice = integrate_adaptively(sources, gbuffer.material, goal, (SEED, index), *listening)
    spp = choice.samples.mean(axis=0) if sources else np.full(len(gbuffer.position), float(grid.samples))
    layers = {
        BEAUTY: gbuffer.image(estimate.radiance),
        # The mean of n independent means has the sum of their variances over n^2.
        "variance": gbuffer.image(estimate.variance) / gbuffer.samples,
        "spp": gbuffer.image(spp) * gbuffer.samples,
        "object": gbuffer.first_image(gbuffer.object, background=-1),
    }
    attributes = {"version": VERSION, "config_sha256": settings, "frame": index, "occluders": occluders}
    write_exr(path, layers, attributes)
    checkpoint.remove()


def _samples(made: Reference, scene: Scene, sampling: Sampling) -> float:
    """Samples per pixel and light: where all points show a surface, or the mean where numbers differ."""
    if sampling.error is None:
        return strata(-(-sampling.samples // scene.image.samples)).samples * scene.image.samples
    return round(float(made.samples[made.hit].mean()), 1) if made.hit.any() else 0.0


def _settings_hash(
    scene: Scene, assets: Assets, occluders: OccluderKind, sampling: Sampling, frame: int
) -> str:
    """Identity of a reference image: everything that its pixels depend on, and nothing else."""
    data = scene.model_dump(mode="json", exclude={"shading"})
    order = [list(part) for part in (scene.materials, scene.lights, scene.objects)]
    data["materials"] = {name: assets.material_contents(part) for name, part in scene.materials.items()}
    for name, obj in scene.objects.items():
        del data["objects"][name]["spheres"]
        if obj.mesh is not None:
            data["objects"][name]["mesh"] = assets.mesh_hash(obj)
    blockers = None
    if occluders == "spheres":
        spheres = world_blockers(scene, assets)
        parts = (spheres.centers, spheres.radii, spheres.outside, spheres.owner)
        blockers = hashlib.sha256(
            b"".join(np.ascontiguousarray(part).tobytes() for part in parts)
        ).hexdigest()
    code = cache.code_digest("core", "spheresets", "render", "evaluate")
    return cache.digest("reference", VERSION, code, data, order, blockers, asdict(sampling), SEED, frame)


def _write_manifest(
    path: Path,
    scene_file: SceneFile,
    occluders: OccluderKind,
    records: Sequence[dict[str, Any]],
    hashes: Sequence[str],
) -> None:
    document = {
        "scene": scene_file.path,
        "settings": scene_file.data,
        "occluders": occluders,
        "versions": {"coslobe": VERSION},
        "frames": [
            {"index": record["index"], "settings_sha256": settings, "seconds": record["seconds"]}
            for record, settings in zip(records, hashes, strict=True)
        ],
    }
    write_json(path, document)
