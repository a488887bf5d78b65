"""Scenes of the paper's figures with their points, pictures, references and times, on one device."""

import statistics
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe import configs
from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.errors import require_finite
from coslobe.evaluate.integration import Estimate
from coslobe.evaluate.occlusion import sphere_occluders
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import GBuffer, trace_gbuffer
from coslobe.render.images import write_png
from coslobe.render.methods import create_method
from coslobe.render.scene import Scene, load_scene
from coslobe.tables import store
from coslobe.tables.store import LobeTables

REPEATS = 7  # timed launches; the median counts


class Bench:
    """Scenes, points and pictures on one device; what is read or fitted is kept.

    `device` and `assets` may be used as they are.
    """

    def __init__(self, device: Device, progress: Progress = SILENT) -> None:
        self.device = device
        self.assets = Assets(device, progress)
        self._progress = progress
        self._method = create_method("cosine_lobes", device, progress)

    @cached_property
    def tables(self) -> LobeTables:
        """The lobe tables, built on first use."""
        return store.cached(self._progress)

    def scene(self, figure: str, frame: int = 0, overrides: tuple[str, ...] = ()) -> Scene:
        """A shipped scene at a frame."""
        return load_scene(configs.path(figure), overrides).at(frame)

    def points(self, scene: Scene) -> GBuffer:
        """What the camera sees."""
        return trace_gbuffer(scene, self.assets)

    def picture(
        self, scene: Scene, gbuffer: GBuffer, layers: tuple[str, ...] = ()
    ) -> tuple[NDArray, dict[str, NDArray]]:
        """Radiance float64 [n, 3] of the points, and layers."""
        shading = self._method.shade(scene, gbuffer, world_blockers(scene, self.assets), layers)
        radiance = shading.radiance.astype(np.float64)
        require_finite(radiance, "picture")
        return radiance, shading.layers

    def same_spheres(self, scene: Scene, gbuffer: GBuffer, samples: int) -> Estimate:
        """The reference with the same spheres."""
        return direct_light(scene, gbuffer, sphere_occluders(scene, self.assets), strata(samples), (0,))

    def seconds(self, scene: Scene, gbuffer: GBuffer) -> float:
        """Median time of all kernels for one frame, by the device's clock, after a first launch."""
        blockers = world_blockers(scene, self.assets)
        runs = [self._method.shade(scene, gbuffer, blockers).kernel_seconds for _ in range(REPEATS + 1)]
        return statistics.median(runs[1:])

    def show(self, path: Path, gbuffer: GBuffer, radiance: NDArray) -> Path:
        """Write radiance [n, 3] of the points as a picture; returns the path."""
        write_png(path, gbuffer.image(radiance))
        return path


def by_estimator(scene: Scene, estimator: str, threshold: float = 0.0) -> Scene:
    """The scene with another estimator."""
    shading = scene.shading.model_copy(update={"estimator": estimator, "threshold": threshold})
    return scene.model_copy(update={"shading": shading})
