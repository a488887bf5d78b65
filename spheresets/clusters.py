"""Spheres that hold given points with little volume outside a solid: hand out, move, teleport."""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.cover import grow
from coslobe.spheresets.outside_volume import OutsideVolume
from coslobe.spheresets.power import nearest_by_power

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

CANDIDATES = 12  # spheres that may hold a point: those nearest by power distance
SHRUNK = 0.95  # of their radii is what spheres keep when points are handed out anew
RADII = 24  # in the table of outside volumes by radius
EMPTY = 0.005  # of r^3 counts as outside: growth inside the solid is not quite free
TURNS = 12  # of the search for new centers
STEPS = (1.0, 0.3)  # tried in each, in current steps
FIRST_STEP, LONGER, SHORTER = (
    0.2,
    1.5,
    0.2,
)  # in radii; and the change of the step after a turn that paid or not
FIRM = 0.5  # in steps: points farthest from a center pull it in proportion to exp(distance / (FIRM step))
SMALLEST = 1e-5  # radius
NEVER = 1e9  # a volume that is not worth it

Volume = Callable[[Indices, Array], Array]


class Clusters:
    """Points [m, 3], and the outside volume that spheres [n, 4] around them are to have little of."""

    def __init__(self, volume: OutsideVolume, points: Array) -> None:
        self._volume = volume
        self._points = points

    def improved(self, spheres: Array, rounds: int) -> Array:
        """The best of what handing out and moving in turns leads to; all points are inside."""
        best, least = spheres, np.inf
        for _ in range(rounds):
            spheres = self._moved(spheres, self._owners(spheres))
            total = self._volume.total(spheres)
            if total < least:
                best, least = spheres, total
        return best

    def teleported(self, spheres: Array) -> Iterator[Array]:
        """The spheres with one taken away, best first, and the one with most outside volume split instead."""
        near, needed, table = self._candidates(spheres)
        volumes = self._volume(spheres)[0]
        saved = volumes - self._replacements(spheres, near, needed, table)
        owners = self._owners(spheres)
        for out in np.argsort(-saved, kind="stable"):
            split = int(np.argmax(np.where(np.arange(len(spheres)) == out, -1, volumes)))
            volumes[split] = 0  # the next attempt splits another
            halves = _split(self._points[owners == split])
            if halves is not None:
                moved = spheres.copy()
                moved[[split, out]] = halves
                yield moved

    def missed(self, spheres: Array, points: Array) -> Array:
        """Those of other points that no sphere holds."""
        near = nearest_by_power(spheres)(points, 1)[:, 0]
        return points[np.linalg.norm(points - spheres[near, :3], axis=1) > spheres[near, 3]]

    def _candidates(self, spheres: Array) -> tuple[Indices, Array, Volume]:
        """Spheres [m, k] that may hold each point, the radii they need, and outside volumes by radius."""
        near = nearest_by_power(spheres)(self._points, CANDIDATES)
        needed = np.linalg.norm(self._points[:, None] - spheres[near, :3], axis=2)
        n, most = len(spheres), spheres[:, 3].copy()
        np.maximum.at(most, near.reshape(-1), needed.reshape(-1))
        radii = most[:, None] * np.linspace(0, 1, RADII + 1)
        balls = np.concatenate([np.repeat(spheres[:, None, :3], RADII, 1), radii[:, 1:, None]], axis=2)
        table = np.zeros((n, RADII + 1))
        table[:, 1:] = self._volume(balls.reshape(-1, 4))[0].reshape(n, RADII)
        table = np.maximum.accumulate(table, axis=1) + EMPTY * radii**3

        def volume(who: Indices, radius: Array) -> Array:
            place = np.minimum(radius / most[who] * RADII, RADII)
            below = np.minimum(place.astype(int), RADII - 1)
            share = place - below
            return (1 - share) * table[who, below] + share * table[who, below + 1]

        return near, needed, volume

    def _owners(self, spheres: Array) -> Indices:
        """The sphere [m] that each point is handed to: of those that can hold it the one with most room."""
        near, needed, volume = self._candidates(spheres)
        radii = grow(SHRUNK * spheres[:, 3], near, needed, volume)
        return near[np.arange(len(near)), (radii[near] - needed).argmax(1)]

    def _replacements(self, spheres: Array, near: Indices, needed: Array, volume: Volume) -> Array:
        """What it costs the others [n] to take the points that only this sphere holds."""
        holds = needed <= spheres[near, 3]
        alone = np.flatnonzero(holds.sum(1) == 1)
        holder = near[alone, holds[alone].argmax(1)]
        everyone = np.arange(len(spheres))
        costs = np.zeros(len(spheres))
        for gone in range(len(spheres)):
            rows = alone[holder == gone]
            radii = spheres[:, 3] * (everyone != gone)
            others = _without(gone, volume)
            grown = grow(radii, near[rows], needed[rows], others)
            costs[gone] = others(everyone, grown).sum() - others(everyone, radii).sum()
        return costs

    def _moved(self, spheres: Array, owners: Indices) -> Array:
        """The spheres, each where it holds its points with least outside volume that a search finds.

        With radius r(c) = distance of the farthest point, the outside volume is a function of the center
        alone. All spheres step along its gradient, made smooth where several points are nearly farthest;
        a step counts only if it pays.
        """
        order = np.argsort(owners, kind="stable")
        points, owners = self._points[order], owners[order]
        used, starts, sizes = np.unique(owners, return_index=True, return_counts=True)
        index = np.repeat(np.arange(len(used)), sizes)
        rows = np.arange(len(used))

        def look(centers: Array) -> tuple[Array, Array, Array, Array]:
            """Balls [n, t, 4] around centers [n, t, 3], volume and gradient, distances of points [m, t]."""
            distance = np.linalg.norm(points[:, None] - centers[index], axis=2)
            radii = np.maximum(np.maximum.reduceat(distance, starts), SMALLEST)
            balls = np.concatenate([centers, radii[:, :, None]], axis=2)
            volume, gradient = self._volume(balls.reshape(-1, 4))
            return balls, volume.reshape(radii.shape), gradient.reshape(balls.shape), distance

        balls, volume, gradient, distance = (a[:, 0] for a in look(spheres[used, None, :3]))
        step = FIRST_STEP * balls[:, 3]
        for _ in range(TURNS):
            pull = np.exp((distance - balls[index, 3]) / np.maximum(FIRM * step, SMALLEST)[index])
            away = (balls[index, :3] - points) * (pull / np.maximum(distance, SMALLEST))[:, None]
            of_radius = np.add.reduceat(away, starts) / np.add.reduceat(pull, starts)[:, None]
            downhill = -_unit(gradient[:, :3] + gradient[:, 3:] * of_radius)
            tried = look(balls[:, None, :3] + (downhill * step[:, None])[:, None] * np.array(STEPS)[:, None])
            best = tried[1].argmin(1)
            paid = tried[1][rows, best] < volume
            chosen = best[paid]
            balls[paid], volume[paid], gradient[paid] = (a[paid, chosen] for a in tried[:3])
            distance = np.where(paid[index], tried[3][np.arange(len(points)), best[index]], distance)
            step *= np.where(paid, LONGER * np.array(STEPS)[best], SHORTER)
        moved = np.column_stack([spheres[:, :3], np.full(len(spheres), SMALLEST)])
        moved[used] = balls
        return moved


def _without(gone: int, volume: Volume) -> Volume:
    """Volumes under which one sphere never grows."""
    return lambda who, radius: np.where((who == gone) & (radius > 0), NEVER, volume(who, radius))


def _split(points: Array) -> Array | None:
    """Two spheres [2, 4] around the points nearer to either of two far apart; None where all are one."""
    if not len(points):
        return None
    ends = [points[np.linalg.norm(points - points.mean(0), axis=1).argmax()]]
    ends.append(points[np.linalg.norm(points - ends[0], axis=1).argmax()])
    first = np.linalg.norm(points - ends[0], axis=1) < np.linalg.norm(points - ends[1], axis=1)
    if not first.any():
        return None
    halves = []
    for half in (points[first], points[~first]):
        center = (half.min(0) + half.max(0)) / 2
        halves.append([*center, max(np.linalg.norm(half - center, axis=1).max(), SMALLEST)])
    return np.array(halves)


def _unit(v: Array) -> Array:
    length = np.linalg.norm(v, axis=-1, keepdims=True)
    return np.divide(v, length, out=np.zeros_like(v), where=length > 0)
