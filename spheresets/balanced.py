"""The balanced fit: spheres that miss as much of the solid as they add, weighted by its surface.

A shadow is a silhouette, so neither an inner packing (silhouettes shrink) nor an outer cover (they grow) will
do. The spheres minimise the cross-entropy of their soft union against the solid on samples spread evenly over
the surface, while the union's softness is annealed. Between the steps of descent, spheres that contribute
least move to where the loss would fall most: both are judged exactly. At last one offset on all radii makes
the mean projected area equal to the solid's.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.samples import LineSamples, PointSamples, draw_lines, draw_points
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.soft_union import SMALLEST, SoftUnion, State
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.starts import greedy_start
from coslobe.spheresets.union import Union

Array = NDArray[np.float64]

# In units of the box's diagonal, for 64 spheres: first and last value of a geometric schedule.
SOFTNESS = (0.0125, 0.0019)
RATE = (0.004, 0.0004)
NOISE = (0.0067, 0.02)

SPARE_FROM = 64  # counts from which a fit starts with twice the spheres
PRUNINGS, PRUNED_AT = 6, 0.6  # rounds in which the spare ones go, and the share of steps when all are gone
EXCHANGED_FROM, EXCHANGED_TO = 0.1, 0.75  # share of the steps between the first and last exchange
MOST_EXCHANGED = 0.15  # of the spheres, in one round
CANDIDATES = 1200


@dataclass(frozen=True)
class Effort:
    """How long a fit may search.

    `steps` of descent, `rounds` of exchange, and as many `starts` as handle 32 spheres each: small counts
    have many local optima and cost little.
    """

    steps: int
    rounds: int
    starts: int


EFFORTS = {"fast": Effort(600, 6, 6), "best": Effort(1500, 12, 16)}
COARSE = Effort(300, 3, 1)


class Balanced:
    """Fits to one solid that share their samples.

    Parameters
    ----------
    solid : Solid
    settings : FitSettings
        Their quality is a key of EFFORTS.
    device : Device
    """

    def __init__(self, solid: Solid, settings: FitSettings, device: Device) -> None:
        self._solid = solid
        self._effort = EFFORTS[settings.quality]
        self._seed = settings.seed
        self._device = device
        self._lines = draw_lines(solid, np.random.default_rng([settings.seed, 0]))
        self._drawn: dict[float, tuple[PointSamples, SoftUnion]] = {}

    def fit(self, count: int, *, coarse: bool = False, progress: Progress = SILENT) -> Array:
        """Exactly `count` spheres [count, 4] (center, radius) in unit coordinates.

        `coarse` spends less time: for levels that only stand for the solid from afar.
        """
        effort = COARSE if coarse else self._effort
        starts = int(np.clip(32 * effort.starts // count, 1, effort.starts))
        points, union = self._points(count)
        best, least = np.empty((0, 4)), np.inf
        with progress.task(f"fitting {count} spheres", starts * effort.steps) as advance:
            for start in range(starts):
                rng = np.random.default_rng([self._seed, 1, count, start])
                spheres = greedy_start(points, count * (2 if count >= SPARE_FROM else 1), start, rng)
                search = _Search(points, union, self._device, spheres, count, rng)
                spheres, mistaken = self._unbiased(search.run(effort, advance))
                if mistaken < least:
                    best, least = spheres, mistaken
        return best

    def _points(self, count: int) -> tuple[PointSamples, SoftUnion]:
        fineness = min(1.0, 256 / count)  # smaller spheres resolve finer detail: samples follow
        if fineness not in self._drawn:
            points = draw_points(
                self._solid,
                (NOISE[0] * fineness**0.7, NOISE[1] * fineness**0.55),
                scale=int(np.clip(count // 512, 1, 8)),
                interior=int(np.clip(12 * count, 24_000, 200_000)),
                rng=np.random.default_rng([self._seed, 2, int(1 / fineness)]),
            )
            self._drawn[fineness] = points, SoftUnion(self._device, points.batches, points.judged)
        return self._drawn[fineness]

    def _unbiased(self, spheres: Array) -> tuple[Array, float]:
        """The spheres with one offset on all radii, and the share of lines that they then get wrong.

        A line passes the union at some clearance; it hits once all radii grow by as much. The offset that
        gives the union as many hits as the solid has is therefore an order statistic of the clearances.
        """
        lines: LineSamples = self._lines
        clearance = Union(self._device, spheres).lines(lines.origins, lines.directions)
        hits = int(np.count_nonzero(lines.hit))
        offset = float(np.partition(clearance, hits)[hits]) if hits < len(clearance) else 0.0
        radii = np.maximum(spheres[:, 3] + offset, SMALLEST)
        mistaken = np.mean((clearance < offset) != lines.hit)
        return np.column_stack([spheres[:, :3], radii]), float(mistaken)


class _Search:
    """One descent from one start."""

    def __init__(
        self,
        points: PointSamples,
        union: SoftUnion,
        device: Device,
        spheres: Array,
        count: int,
        rng: np.random.Generator,
    ) -> None:
        self._points = points
        self._union = union
        self._device = device
        self._count = count
        self._rng = rng
        self._state = State.start(spheres)

    def run(self, effort: Effort, advance: Callable[..., None]) -> Array:
        steps = effort.steps
        scale = np.clip((64 / self._count) ** (1 / 3), 0.2, 1.5)
        taus, rates = (scale * np.geomspace(*ends, steps) for ends in (SOFTNESS, RATE))
        exchanges = set(_at(np.linspace(EXCHANGED_FROM, EXCHANGED_TO, effort.rounds), steps))
        surplus = len(self._state.spheres) / self._count
        prunings = dict(
            zip(
                _at(np.linspace(0, PRUNED_AT, PRUNINGS + 1)[1:], steps),
                np.rint(self._count * np.geomspace(surplus, 1, PRUNINGS + 1)[1:]).astype(int),
                strict=True,
            )
        )
        done = 0
        for stop in sorted({*exchanges, *prunings, steps}):
            loss = self._union.descend(self._state, taus[done:stop], rates[done:stop])
            advance(stop - done, f"loss {loss:.4f}")
            done = stop
            if stop in prunings:
                self._prune(prunings[stop], taus[stop])
            if stop in exchanges:
                self._exchange(taus[stop])
        return self._state.spheres.astype(np.float64)

    def _prune(self, count: int, tau: float) -> None:
        """Drop the spheres that cost least, down to `count`."""
        spheres = self._state.spheres
        if count < len(spheres):
            odds = self._union.odds(spheres, tau)
            cost = self._union.exchange(odds, spheres, tau, removing=True)
            self._state.keep(np.sort(np.argsort(cost, kind="stable")[len(spheres) - count :]))

    def _exchange(self, tau: float) -> None:
        """Move the spheres that cost least to where they gain most, while the gain is larger.

        Costs and gains are exact one by one; spheres that change in one round are kept disjoint, so that
        they are nearly exact together.
        """
        spheres = self._state.spheres.astype(np.float64)
        candidates = self._candidates(spheres)
        if not len(candidates):
            return
        odds = self._union.odds(self._state.spheres, tau)
        cost = self._union.exchange(odds, self._state.spheres, tau, removing=True)
        gain = -self._union.exchange(odds, candidates, tau, removing=False)
        entering = iter(np.argsort(-gain, kind="stable"))
        changed = np.empty((0, 4))
        removed, added = [], []
        for out in np.argsort(cost, kind="stable"):
            if len(removed) >= max(1, MOST_EXCHANGED * len(spheres)):
                break
            if _touches(spheres[out], changed):
                continue
            changed = np.vstack([changed, spheres[out]])
            new = next((k for k in entering if not _touches(candidates[k], changed)), None)
            if new is None or gain[new] <= cost[out]:
                break
            changed = np.vstack([changed, candidates[new]])
            removed.append(out)
            added.append(new)
        if removed:
            self._state.replace(np.array(removed), candidates[added])

    def _candidates(self, spheres: Array) -> Array:
        """Largest balls inside the solid around interior points that no sphere covers."""
        uncovered = self._points.uncovered(spheres)
        chosen = self._rng.choice(
            uncovered, min(max(CANDIDATES, len(spheres)), len(uncovered)), replace=False
        )
        depth = np.maximum(self._points.depth[chosen], SMALLEST)
        return np.column_stack([self._points.interior[chosen], depth])


def _at(shares: Array, steps: int) -> list[int]:
    return [int(share * steps) for share in shares]


def _touches(sphere: Array, others: Array) -> bool:
    gap = np.linalg.norm(others[:, :3] - sphere[:3], axis=1) - others[:, 3] - sphere[3]
    return bool((gap <= 0).any())
