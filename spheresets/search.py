"""One search for spheres: descent while the union hardens, exchanges in between, silhouettes at last."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.spheresets.descent import SMALLEST, Descent, State
from coslobe.spheresets.samples import PointSamples
from coslobe.spheresets.soft_lines import SoftLines
from coslobe.spheresets.soft_union import SoftUnion

Array = NDArray[np.float64]

# In units of the box's diagonal, for spheres of the TYPICAL radius: ends of geometric schedules.
SOFTNESS, RATE = (0.0125, 0.0019), (0.004, 0.0004)
POLISH_SOFTNESS, POLISH_RATE = (0.004, 0.0015), (0.002, 0.00004)
TYPICAL = 0.0229  # median radius with which 64 spheres start in the bunny, to which the schedules are tuned
COVERING = 0.5  # of the radius with which discs would cover the surface: spheres are not expected smaller
SMALLEST_SCALE, LARGEST_SCALE = 0.005, 1.5
LINE_WEIGHT = 5.0  # of the silhouettes' loss in the polish; the points' counts once

PRUNINGS, PRUNED_AT = 6, 0.6  # rounds in which spare spheres go, and the share of steps when all are gone
EXCHANGED_FROM, EXCHANGED_TO = 0.1, 0.75  # share of the steps between the first and last exchange
MOST_EXCHANGED = 0.15  # of the spheres, in one round
CANDIDATES = 1200
REPORTED = 100  # steps of the polish between reports

Advance = Callable[..., None]


@dataclass(frozen=True)
class Samples:
    """What spheres of one size learn from, here and on the device."""

    points: PointSamples
    union: SoftUnion
    lines: SoftLines


class Search:
    """A search that starts from `spheres` [n, 4] and ends with `count`.

    Parameters
    ----------
    samples : Samples
    device : Device
    spheres : float64 [n, 4]
        At least `count`; spare ones go where they cost least.
    count : int
    rng : Generator
    """

    def __init__(
        self, samples: Samples, device: Device, spheres: Array, count: int, rng: np.random.Generator
    ) -> None:
        self._samples = samples
        self._count = count
        self._rng = rng
        covering = np.sqrt(samples.points.area / (2 * np.pi * count))
        radius = max(np.median(spheres[:count, 3]), COVERING * covering)
        self._scale = float(np.clip(radius / TYPICAL, SMALLEST_SCALE, LARGEST_SCALE))
        self._state = State.start(spheres)
        self._on_points = Descent(device, (samples.union, 1.0))
        self._on_both = Descent(device, (samples.union, 1.0), (samples.lines, LINE_WEIGHT))

    @property
    def spheres(self) -> Array:
        """As they are now, [n, 4]."""
        return self._state.spheres.astype(np.float64)

    def anneal(self, steps: int, rounds: int, advance: Advance) -> None:
        """Descend on the points while the union hardens, with `rounds` of exchange in between."""
        taus, rates = (self._scale * np.geomspace(*ends, steps) for ends in (SOFTNESS, RATE))
        exchanges = set(_at(np.linspace(EXCHANGED_FROM, EXCHANGED_TO, rounds), steps))
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
            loss = self._on_points.run(self._state, taus[done:stop], rates[done:stop])
            advance(stop - done, f"loss {loss:.4f}")
            done = stop
            if stop in prunings:
                self._prune(prunings[stop], taus[stop])
            if stop in exchanges:
                self._exchange(taus[stop])
            if stop == max(exchanges):
                self._reach(taus[stop])

    def polish(self, steps: int, advance: Advance) -> None:
        """Descend on points and silhouettes, nearly hard: points alone do not know what is seen."""
        taus, rates = (self._scale * np.geomspace(*ends, steps) for ends in (POLISH_SOFTNESS, POLISH_RATE))
        for piece in np.array_split(np.arange(steps), max(1, steps // REPORTED)):
            loss = self._on_both.run(self._state, taus[piece], rates[piece])
            advance(len(piece), f"loss {loss:.4f}")
        self._reach(taus[-1])  # again: large steps can lose the smallest parts

    def _prune(self, count: int, tau: float) -> None:
        """Drop the spheres that cost least, down to `count`."""
        spheres = self._state.spheres
        if count < len(spheres):
            odds = self._samples.union.odds(spheres, tau)
            cost = self._samples.union.exchange(odds, spheres, tau, removing=True)
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
        odds = self._samples.union.odds(self._state.spheres, tau)
        cost = self._samples.union.exchange(odds, self._state.spheres, tau, removing=True)
        gain = -self._samples.union.exchange(odds, candidates, tau, removing=False)
        entering = iter(np.argsort(-gain, kind="stable"))
        changed = np.empty((0, 4))
        removed, added = [], []
        for out in np.argsort(cost, kind="stable"):
            if len(removed) >= max(1, MOST_EXCHANGED * len(spheres)):
                break
            if _touching(spheres[out], changed).any():
                continue
            changed = np.vstack([changed, spheres[out]])
            new = next((k for k in entering if not _touching(candidates[k], changed).any()), None)
            if new is None or gain[new] <= cost[out]:
                break
            changed = np.vstack([changed, candidates[new]])
            removed.append(out)
            added.append(new)
        if removed:
            self._state.replace(np.array(removed), candidates[added])

    def _reach(self, tau: float) -> None:
        """Give every connected part a sphere, where there are enough: those that cost least go there."""
        parts = self._samples.points.parts
        if not 0 < len(parts) <= self._count:
            return
        reached = np.stack([_touching(part, self.spheres) for part in parts])
        missed = np.flatnonzero(~reached.any(1))
        if not len(missed):
            return
        odds = self._samples.union.odds(self._state.spheres, tau)
        cost = self._samples.union.exchange(odds, self._state.spheres, tau, removing=True)
        for part in missed:
            only = reached[reached.sum(1) == 1].any(0)  # the only ones in some part stay
            out = int(np.argmin(np.where(only, np.inf, cost)))
            self._state.replace(np.array([out]), parts[[part]])
            reached[:, out] = _touching(parts[part], parts)

    def _candidates(self, spheres: Array) -> Array:
        """Largest balls inside the solid: half around uncovered points, half those that hold most of them.

        The former are small where little is left to cover, the latter reach it from the depth.
        """
        from scipy.spatial import KDTree

        interior, depth = self._samples.points.interior, self._samples.points.depth
        uncovered = self._samples.points.uncovered(spheres)
        if not len(uncovered):
            return np.empty((0, 4))
        half = max(CANDIDATES, len(spheres)) // 2
        around = self._rng.choice(uncovered, min(half, len(uncovered)), replace=False)
        held = KDTree(interior[uncovered]).query_ball_point(interior, depth, return_length=True)
        index = np.concatenate([around, np.argsort(-held, kind="stable")[:half]])
        return np.column_stack([interior[index], np.maximum(depth[index], SMALLEST)])


def _at(shares: Array, steps: int) -> list[int]:
    return [int(share * steps) for share in shares]


def _touching(sphere: Array, others: Array) -> NDArray[np.bool_]:
    """Which of the others [n, 4] the sphere [4] touches."""
    return np.linalg.norm(others[:, :3] - sphere[:3], axis=1) <= others[:, 3] + sphere[3]
