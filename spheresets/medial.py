"""The medial fit: balls along the medial axis, reduced to the wanted number.

After Bradshaw and O'Sullivan, "Sphere-tree construction using dynamic medial axis approximation" (2002) and
"Adaptive medial-axis approximation for sphere-tree construction" (2004): sample the surface, take the inner
Voronoi balls, add samples where these err most, reduce the balls to a few that cover the surface.

Departures. Of a sample's Voronoi balls only the one around its inner pole is kept. All levels are fitted to
the whole solid, none to the parts of the level above. Balls are judged by their volume outside the solid (the
papers: by how far they reach out), which is also what merging minimises. Expanding only chooses the balls to
merge, more of them than are wanted. Spheres then move, each on its own, to where their samples need least
volume. Bursting is left out: from the same balls it ended with 1.1 to 3.4 times the outside volume of merging
(ten trials on bunny and hand, 16 to 256 spheres). At last radii grow until the whole surface is inside:
triangles, not only samples.

Mode inner takes balls as they are, one after another, each time the one that comes close to most of what is
left of surface and interior.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.cover import cover
from coslobe.spheresets.medial_axis import medial_balls
from coslobe.spheresets.reduction import SMALLEST, Reducer, greedy_cover, grown, outside_volumes
from coslobe.spheresets.samples import draw_points
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

NOISE = (0.0067, 0.02)  # of the interior points, most of which are near the surface
INTERIOR, LEAST_INTERIOR, MOST_INTERIOR = 16, 20_000, 200_000  # such points: per sphere, and in all
SAMPLES, LEAST_SAMPLES, MOST_SAMPLES = 256, 20_000, 200_000  # of the surface: per sphere, and in all
LEAST_SITES, MANY_SITES = 1500, 8000
FLOAT32 = 1e-6  # by which distances in unit coordinates may be wrong


@dataclass(frozen=True)
class Effort:
    """How long a fit may search.

    `sites` of the Voronoi diagram per sphere; as many `starts` as handle 32 spheres each, of which the best
    is kept; each ends with `rounds` of settling.
    """

    sites: int
    starts: int
    rounds: int


EFFORTS = {"fast": Effort(16, 6, 30), "best": Effort(32, 16, 80)}
COARSE = Effort(16, 1, 15)
EXPANDED = (2, 4)  # times the wanted spheres are what starts expand to, in turns, before they merge,
LEAST_EXPANDED = 32  # and at least


class Medial:
    """Fits to one solid that share their samples of its interior.

    Parameters
    ----------
    solid : Solid
    settings : FitSettings
        Their mode is outer or inner, their quality a key of EFFORTS.
    device : Device
        Not used: the work is rays and search trees.

    Raises
    ------
    InvalidInput
        The mesh encloses no volume.
    """

    def __init__(self, solid: Solid, settings: FitSettings, device: Device) -> None:
        del device
        self._solid = solid
        self._mode = settings.mode
        self._effort = EFFORTS[settings.quality]
        self._seed = settings.seed
        interior = int(np.clip(INTERIOR * settings.count, LEAST_INTERIOR, MOST_INTERIOR))
        drawn = draw_points(solid, NOISE, 1, interior, np.random.default_rng([settings.seed, 0]))
        self._interior = np.column_stack([drawn.interior, drawn.depth])

    def fit(self, count: int, *, coarse: bool = False, progress: Progress = SILENT) -> Array:
        """Exactly `count` spheres [count, 4] (center, radius) in unit coordinates.

        `coarse` spends less time: for levels that only stand for the solid from afar.
        """
        effort = COARSE if coarse else self._effort
        rng = np.random.default_rng([self._seed, 1, count])
        surface = self._solid.sample_surface(int(np.clip(SAMPLES * count, LEAST_SAMPLES, MOST_SAMPLES)), rng)
        sites = int(np.clip(effort.sites * count, LEAST_SITES, max(MANY_SITES, 4 * count)))
        starts = int(np.clip(32 * effort.starts // count, 1, effort.starts))
        with progress.task(f"fitting {count} spheres", 1 + starts) as advance:
            balls = self._candidates(surface, count, sites, rng)
            advance()
            reducer = Reducer(self._solid, surface, rng)
            if self._mode == "inner":
                return self._packing(reducer, balls, surface, count)
            best, least = balls[:count], np.inf
            for start in range(starts):
                wanted = max(EXPANDED[start % len(EXPANDED)] * count, LEAST_EXPANDED)
                merged = reducer.merge(reducer.expand(balls, wanted), count)
                spheres = reducer.settle(merged, effort.rounds)
                volume = float(outside_volumes(self._solid, spheres).sum())
                advance(1, f"outside volume {volume:.4f}")
                if volume < least:
                    best, least = spheres, volume
            # A sphere that has no samples left becomes a ball inside: that is no volume outside.
            idle = np.flatnonzero(best[:, 3] <= SMALLEST)
            best[idle] = balls[np.argsort(-balls[:, 3], kind="stable")[: len(idle)]]
            return cover(self._solid, best)

    def _candidates(self, surface: Array, count: int, sites: int, rng: np.random.Generator) -> Array:
        """At least `count` balls inside the solid: around interior points where it is too thin for others."""
        balls = medial_balls(self._solid, surface, sites, rng)
        if len(balls) >= count:
            return balls
        interior = rng.permutation(self._interior)
        return np.concatenate([balls, np.resize(interior, (max(sites, count) - len(balls), 4))])

    def _packing(self, reducer: Reducer, balls: Array, surface: Array, count: int) -> Array:
        """The balls inside the solid that together come closest to most of its surface and interior.

        Close is half of the stand-off with which as many would cover everything: balls that only count what
        they hold pile up where the solid is thick, and those of a full cover spread too thin.
        """
        distance = self._solid.distance(balls[:, :3])
        balls = np.column_stack([balls[:, :3], np.maximum(distance - FLOAT32, distance / 2)])
        points = np.concatenate([surface[:: len(surface) // len(self._interior) + 1], self._interior[:, :3]])
        reach = reducer.stand_off(balls, count) / 2
        chosen = greedy_cover(points, grown(balls, reach), count)
        others = np.setdiff1d(np.argsort(-balls[:, 3], kind="stable"), chosen, assume_unique=True)
        return balls[np.concatenate([chosen, others[: count - len(chosen)]])]
