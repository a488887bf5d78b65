"""The balanced fit: spheres that miss as much of the solid as they add, weighted by its surface.

A shadow is a silhouette, so neither an inner packing (silhouettes shrink) nor an outer cover (they grow) will
do. The spheres minimise the cross-entropy of their soft union against the solid on samples spread evenly over
the surface, while the union's softness is annealed. Between the steps of descent, spheres that contribute
least move to where the loss would fall most: both are judged exactly. At last one offset on all radii makes
the mean projected area equal to the solid's.

Mode inner then moves the centers to where the largest balls inside the solid fill most of it (`inner`); mode
outer grows radii until the surface is covered (`cover`).
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.cover import cover
from coslobe.spheresets.descent import SMALLEST
from coslobe.spheresets.inner import inner
from coslobe.spheresets.line_samples import draw_bundles, draw_lines
from coslobe.spheresets.samples import draw_points
from coslobe.spheresets.search import Samples, Search
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.soft_lines import SoftLines
from coslobe.spheresets.soft_union import SoftUnion
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.starts import greedy_start
from coslobe.spheresets.union import Union

Array = NDArray[np.float64]

NOISE = (0.0067, 0.02)  # of the points, in diagonals
LINE_BATCHES = 40
SPARE_FROM = 64  # counts from which a search starts with twice the spheres


@dataclass(frozen=True)
class Effort:
    """How long a fit may search.

    `steps` of descent, `rounds` of exchange, `polish` more steps, and as many `starts` as handle 32 spheres
    each: small counts have many local optima and cost little.
    """

    steps: int
    rounds: int
    polish: int
    starts: int


EFFORTS = {"fast": Effort(600, 6, 300, 6), "best": Effort(1500, 12, 500, 16)}
COARSE = Effort(300, 3, 100, 1)


class Balanced:
    """Fits to one solid that share their samples.

    Parameters
    ----------
    solid : Solid
    settings : FitSettings
        Their quality is a key of EFFORTS; their mode says what becomes of the fit.
    device : Device
    """

    def __init__(self, solid: Solid, settings: FitSettings, device: Device) -> None:
        self._solid = solid
        self._effort = EFFORTS[settings.quality]
        self._mode = settings.mode
        self._seed = settings.seed
        self._device = device
        self._lines = draw_lines(solid, np.random.default_rng([settings.seed, 0]))
        self._drawn: dict[float, Samples] = {}

    def fit(self, count: int, *, coarse: bool = False, progress: Progress = SILENT) -> Array:
        """Exactly `count` spheres [count, 4] (center, radius) in unit coordinates.

        `coarse` spends less time: for levels that only stand for the solid from afar.
        """
        effort = COARSE if coarse else self._effort
        starts = int(np.clip(32 * effort.starts // count, 1, effort.starts))
        samples = self.samples(count)
        best, least = np.empty((0, 4)), np.inf
        with progress.task(f"fitting {count} spheres", starts * (effort.steps + effort.polish)) as advance:
            for start in range(starts):
                rng = np.random.default_rng([self._seed, 1, count, start])
                spheres = greedy_start(samples.points, count * (2 if count >= SPARE_FROM else 1), start, rng)
                search = Search(samples, self._device, spheres, count, rng)
                search.anneal(effort.steps, effort.rounds, advance)
                search.polish(effort.polish, advance)
                spheres, mistaken = self._unbiased(search.spheres)
                if mistaken < least:
                    best, least = spheres, mistaken
        if self._mode == "inner":
            return inner(self._solid, samples.points, best)
        return cover(self._solid, best) if self._mode == "outer" else best

    def samples(self, count: int) -> Samples:
        """What fits of `count` spheres learn from; drawn on first use, shared by counts of like size."""
        fineness = min(1.0, 256 / count)  # smaller spheres resolve finer detail: samples follow
        if fineness not in self._drawn:
            scale = int(np.clip(count // 512, 1, 8))
            points = draw_points(
                self._solid,
                (NOISE[0] * fineness**0.7, NOISE[1] * fineness**0.55),
                scale=scale,
                interior=int(np.clip(12 * count, 24_000, 200_000)),
                rng=np.random.default_rng([self._seed, 2, int(1 / fineness)]),
            )
            rng = np.random.default_rng([self._seed, 3, int(1 / fineness)])
            bundles = draw_bundles(self._solid, scale * LINE_BATCHES, fineness**0.6, rng)
            self._drawn[fineness] = Samples(
                points,
                SoftUnion(self._device, points.batches, points.judged),
                SoftLines(self._device, bundles),
            )
        return self._drawn[fineness]

    def _unbiased(self, spheres: Array) -> tuple[Array, float]:
        """The spheres with one offset on all radii, and the share of lines that they then get wrong.

        A line passes the union at some clearance; it hits once all radii grow by as much. The offset that
        gives the union as many hits as the solid has is therefore an order statistic of the clearances.
        """
        lines = self._lines
        clearance = Union(self._device, spheres).lines(lines.origins, lines.directions)
        hits = int(np.count_nonzero(lines.hit))
        offset = float(np.partition(clearance, hits)[hits]) if hits < len(clearance) else 0.0
        radii = np.maximum(spheres[:, 3] + offset, SMALLEST)
        mistaken = np.mean((clearance < offset) != lines.hit)
        return np.column_stack([spheres[:, :3], radii]), float(mistaken)
