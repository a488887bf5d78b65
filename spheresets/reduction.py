"""Fewer spheres for the same surface: expand, merge and settle, after Bradshaw and O'Sullivan."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.power import nearest_by_power
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

SMALLEST = 1e-5  # radius
RAYS = 64  # per center, for volumes outside the solid
BLOCK = 1 << 19  # rays or distances at a time: bounds the memory

STAND_OFFS, BISECTIONS = (1e-4, 0.5), 10
FEW_SAMPLES, SAMPLES_PER_BALL = 4000, 16  # to be covered by expanded balls: a rough choice will do
NEIGHBOURS = 8  # of each sphere, with which it may merge
MERGED = 0.25  # of the spheres, at most, in one round of merging
MERGE_SETTLING = 2  # rounds of settling after each
TRIALS = 8  # centers that each sphere tries in one round of settling, its own included
FIRST_STEP, STEP_DECAY = 0.3, 0.85  # how far from its own, in radii, and how that falls by round


class Reducer:
    """Spheres that cover given samples of one solid's surface with little volume outside the solid.

    Each sample belongs to the sphere nearest by power distance, so a sample in any sphere is in its own.

    Parameters
    ----------
    solid : Solid
    samples : float64 [m, 3]
    rng : numpy.random.Generator
    """

    def __init__(self, solid: Solid, samples: Array, rng: np.random.Generator) -> None:
        self._solid = solid
        self._samples = samples
        self._rng = rng

    def stand_off(self, balls: Array, count: int) -> float:
        """How far all balls [n, 4] have to grow until about `count` of them cover all samples.

        Bisects for the largest growth with which a greedy cover still takes more. What has to be covered is a
        part of the samples, another one in each call.
        """
        samples = self._some(count)
        low, high = STAND_OFFS
        for _ in range(BISECTIONS):
            middle = float(np.sqrt(low * high))
            if len(greedy_cover(samples, grown(balls, middle), count + 1)) <= count:
                high = middle
            else:
                low = middle
        return low

    def expand(self, balls: Array, count: int) -> Array:
        """At least `count` balls of `balls` [n, 4], grown by one stand-off, that together cover.

        All that are needed where even the least stand-off needs fewer.
        """
        balls = grown(balls, self.stand_off(balls, count))
        chosen = greedy_cover(self._some(count), balls, len(balls))
        others = np.setdiff1d(np.arange(len(balls)), chosen)[: max(count - len(chosen), 0)]
        return balls[np.concatenate([chosen, others])]

    def _some(self, count: int) -> Array:
        stride = len(self._samples) // max(FEW_SAMPLES, SAMPLES_PER_BALL * count) + 1
        return self._samples[self._rng.integers(stride) :: stride]

    def merge(self, spheres: Array, count: int) -> Array:
        """`count` spheres [count, 4], by merging neighbours whose union costs least, in rounds.

        What two spheres become holds both their samples, from the best of four centers: either one's, the
        middle, and the point that divides their distance as their radii do.
        """
        while len(spheres) > count:
            clusters = self._clusters(spheres)
            pairs = _neighbours(spheres)
            (a, b), alone = spheres[pairs.T], outside_volumes(self._solid, spheres)
            share = (a[:, 3] / (a[:, 3] + b[:, 3]))[:, None]
            centers = np.stack([a, b, (a + b) / 2, share * a + (1 - share) * b], axis=1)[:, :, :3]
            radii = np.maximum(*(clusters.farthest(who, centers) for who in pairs.T))
            merged, volume = self._least(centers, radii)
            cost = volume - alone[pairs].sum(1)
            most = min(len(spheres) - count, max(1, int(MERGED * len(spheres))))
            free, taken = np.ones(len(spheres), bool), []
            for k in np.argsort(cost, kind="stable"):
                if len(taken) < most and free[pairs[k]].all():
                    free[pairs[k]] = False
                    taken.append(k)
            spheres = self.settle(np.concatenate([spheres[free], merged[taken]]), MERGE_SETTLING)
        return spheres

    def settle(self, spheres: Array, rounds: int) -> Array:
        """The spheres [n, 4], all samples covered, after each has `rounds` times looked for a better center.

        In a round every sphere tries a few random steps and takes the center from which its samples are
        covered with least volume outside.
        """
        for k in range(rounds):
            steps = self._rng.normal(size=(len(spheres), TRIALS, 3))
            steps[:, 0] = 0
            scale = FIRST_STEP * STEP_DECAY**k * spheres[:, 3]
            centers = spheres[:, None, :3] + scale[:, None, None] * steps
            radii = self._clusters(spheres).farthest(np.arange(len(spheres)), centers)
            spheres, _ = self._least(centers, radii)
        return spheres

    def _clusters(self, spheres: Array) -> "_Clusters":
        owner = nearest_by_power(spheres)(self._samples, 1)[:, 0]
        sizes = np.bincount(owner, minlength=len(spheres))
        return _Clusters(self._samples[np.argsort(owner, kind="stable")], np.cumsum(sizes) - sizes, sizes)

    def _least(self, centers: Array, radii: Array) -> tuple[Array, Array]:
        """Of trials [n, k] (centers, radii) those with the least volume outside, [n, 4], and that [n]."""
        trials = np.concatenate([centers, np.maximum(radii, SMALLEST)[:, :, None]], axis=2)
        volumes = outside_volumes(self._solid, trials.reshape(-1, 4)).reshape(radii.shape)
        rows, best = np.arange(len(trials)), volumes.argmin(1)
        return trials[rows, best], volumes[rows, best]


@dataclass(frozen=True)
class _Clusters:
    """Points [m, 3], cluster by cluster: each begins at `starts` and has `sizes` of them."""

    points: Array
    starts: Indices
    sizes: Indices

    def farthest(self, clusters: Indices, centers: Array) -> Array:
        """Distance [q, k] of each cluster's [q] farthest point from its centers [q, k, 3]; 0 if empty."""
        filled = np.flatnonzero(self.sizes[clusters])
        result = np.zeros(centers.shape[:2])
        total = int(self.sizes[clusters].sum())
        for part in np.array_split(filled, total // BLOCK + 1):
            sizes = self.sizes[clusters[part]]
            first = np.cumsum(sizes) - sizes
            rows = np.repeat(part, sizes)
            points = self.points[np.arange(len(rows)) + np.repeat(self.starts[clusters[part]] - first, sizes)]
            for k in range(centers.shape[1]):
                offset = points - centers[rows, k]
                squares = np.einsum("nd,nd->n", offset, offset)
                result[part, k] = np.sqrt(np.maximum.reduceat(squares, first))
        return result


def grown(balls: Array, by: float) -> Array:
    """The balls [n, 4] with radii larger by one length."""
    return np.column_stack([balls[:, :3], balls[:, 3] + by])


def greedy_cover(points: Array, balls: Array, most: int) -> Indices:
    """Which balls [n, 4] a greedy cover of the points [m, 3] takes, in order.

    Each time the ball that holds most of the points still uncovered; ends after `most`, or where no ball
    holds another point.
    """
    from scipy.sparse import csr_array
    from scipy.spatial import KDTree

    held = KDTree(points).query_ball_point(balls[:, :3], balls[:, 3], return_sorted=False)
    gain = np.array([len(part) for part in held])
    columns = np.concatenate([np.asarray(part, np.int32) for part in held])
    starts = np.concatenate([[0], np.cumsum(gain)])
    entries = csr_array((np.ones(len(columns), bool), columns, starts), shape=(len(balls), len(points)))
    holders = entries.T.tocsr()
    left = np.ones(len(points), bool)
    chosen = []
    while len(chosen) < most and gain[best := int(gain.argmax())] > 0:
        own = columns[starts[best] : starts[best + 1]]
        new = own[left[own]]
        left[new] = False
        gain -= np.bincount(holders[new].indices, minlength=len(balls))
        chosen.append(best)
    return np.array(chosen, np.int64)


def outside_volumes(solid: Solid, spheres: Array) -> Array:
    """Volume [n] of each sphere [n, 4] outside the solid, from rays of its center.

    Along a ray everything behind the first surface counts as outside; around a center outside the solid, or
    along a ray that leaves through a hole, everything does.
    """
    w = fibonacci_sphere(RAYS)
    volumes = []
    for part in np.array_split(spheres, len(spheres) * RAYS // BLOCK + 1):
        centers, r = part[:, :3], part[:, 3:]
        distance = solid.first_hit(np.repeat(centers, RAYS, axis=0), np.tile(w, (len(part), 1)))[0]
        t = np.where(np.isfinite(distance).reshape(-1, RAYS), distance.reshape(-1, RAYS), 0)
        t *= solid.inside(centers)[:, None]
        volumes.append(4 / 3 * np.pi * np.maximum(r**3 - t**3, 0).mean(1))
    return np.concatenate(volumes)


def _neighbours(spheres: Array) -> Indices:
    """Pairs [m, 2] of spheres [n, 4] with close centers, each once."""
    from scipy.spatial import KDTree

    centers = spheres[:, :3]
    k = min(NEIGHBOURS + 1, len(spheres))
    near = np.reshape(KDTree(centers).query(centers, k=k)[1], (-1, k))
    own = np.repeat(np.arange(len(near)), k)
    pairs = np.sort(np.column_stack([own, near.reshape(-1)]), axis=1)
    return np.unique(pairs[pairs[:, 0] < pairs[:, 1]], axis=0)
