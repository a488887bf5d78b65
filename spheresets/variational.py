"""The variational fit: outer covers with the least sum of outside volumes.

After Wang, Zhou, Snyder, Liu, Bao, Peng and Guo, "Variational sphere set approximation for solid objects",
The Visual Computer 22, 2006. Points of the surface are handed to spheres, each sphere moves to where it holds
its points with least volume outside the solid, and so on in turns. Where that stalls, spheres teleport: the
one that others replace best leaves, the one with most outside volume is split at two far points. At last
radii grow until the whole surface is covered.

Departures. The start is a medial fit, which is already a cover, not random centers: from balls that are
spread evenly the search ended 1.4 to 2.8 times as high (bunny, hand, torus; 64 spheres), from balanced
spheres as high on bunny and hand and higher on the torus. From there teleportation gains little, so that only
quality best tries it, and one that does not pay is taken back. Points of the inside are not samples: a cover
of the surface holds what casts shadows. Points are handed out hardest first (`cover.grow`), from somewhat
smaller spheres, instead of one after another to the sphere that then grows least. Centers follow the exact
gradient of the outside volume, all spheres in one launch, instead of Powell's method: for 64 spheres in the
bunny both end within 0.1 % of each other, after 25 and 194 evaluations per sphere. Fresh samples that are not
covered join the others between stages, so that the last growth, over triangles instead of samples
(`cover.cover`), is small.
"""

from dataclasses import dataclass, replace
from itertools import islice

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.closed_surface import closed_surface
from coslobe.spheresets.clusters import Clusters
from coslobe.spheresets.cover import cover
from coslobe.spheresets.medial import Medial
from coslobe.spheresets.outside_volume import OutsideVolume
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

SAMPLES, LEAST, MOST = 100, 6000, 100_000  # of the surface: per sphere, and in all
MANY, FEWEST = 500, 2  # spheres above which rounds become fewer, and how few
TRIED = 6  # rounds that a teleportation has to pay
FRESH = 100_000  # samples in which uncovered ones are looked for


@dataclass(frozen=True)
class Effort:
    """How long a fit may search.

    `stages`, each with fresh samples, of `rounds` of handing out and moving, and tries of `teleportations`.
    """

    stages: int
    rounds: int
    teleportations: int


EFFORTS = {"fast": Effort(4, 8, 0), "best": Effort(6, 16, 4)}
COARSE = Effort(2, 6, 0)


class Variational:
    """Fits to one solid.

    Parameters
    ----------
    solid : Solid
    settings : FitSettings
        Their quality is a key of EFFORTS.
    device : Device
    """

    def __init__(self, solid: Solid, settings: FitSettings, device: Device) -> None:
        self._solid = solid
        self._settings = settings
        self._starts = Medial(solid, replace(settings, method="medial", mode="outer"), device)
        corners, self._exact = closed_surface(solid)
        self._volume = OutsideVolume(device, corners, solid.inside)

    def fit(self, count: int, *, coarse: bool = False, progress: Progress = SILENT) -> Array:
        """Exactly `count` spheres [count, 4] (center, radius) in unit coordinates that cover the surface.

        `coarse` spends less time: for levels that only stand for the solid from afar.
        """
        if not self._exact:
            progress.say(
                f"{self._solid.name} is open, overlaps itself, or is huge: outside volumes by its voxels"
            )
        effort = COARSE if coarse else EFFORTS[self._settings.quality]
        rng = np.random.default_rng([self._settings.seed, 4, count])
        start = self._starts.fit(count, coarse=coarse, progress=progress)
        rounds = max(FEWEST, effort.rounds * MANY // max(MANY, count))
        points = self._solid.sample_surface(int(np.clip(SAMPLES * count, LEAST, MOST)), rng)
        spheres = best = start
        with progress.task(f"covering with {count} spheres", effort.stages) as advance:
            for _ in range(effort.stages):
                clusters = Clusters(self._volume, points)
                spheres = clusters.improved(spheres, rounds)
                trials = islice(clusters.teleported(spheres), effort.teleportations)
                spheres = self._least(spheres, *(clusters.improved(trial, TRIED) for trial in trials))
                best = self._least(best, cover(self._solid, spheres))
                fresh = self._solid.sample_surface(FRESH, rng)
                points = np.concatenate([points, clusters.missed(spheres, fresh)])
                advance(1, f"outside volume {self._volume.total(best):.4f}")
        return best

    def _least(self, *sets: Array) -> Array:
        """The set with the least outside volume."""
        return min(sets, key=self._volume.total)
