"""Outer covers: the least growth of radii that puts the whole surface into the spheres, without sampling.

A ball holds a triangle if it holds the three corners. A triangle that no single sphere holds is halved until
its pieces lie in one sphere each, or are so small that a sphere may grow to take them. So every point of the
surface is covered, not only those that somebody looked at.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

BLOCK = 1 << 16  # triangles at a time
CANDIDATES = 12  # spheres that may hold or take a piece: those nearest by power distance
PIECE = 0.05  # longest edge of pieces with an uncovered corner, in median radii
SEAM = PIECE / 16  # the same for pieces whose corners are in several spheres
SHELL_POINTS = 64  # on each sphere, for the share of its growth that is outside
LEAST_SHARE = 0.05  # of a growth that counts as outside: growth inside the solid is not quite free
ROUNDINGS = 16  # of a coordinate, by which radii exceed what float64 finds necessary


def cover(solid: Solid, spheres: Array) -> Array:
    """The spheres [n, 4] with radii grown so that every point of the surface is in one of them.

    Holds in file coordinates too, after rounding. Growth is greedy: the piece that costs most is taken first,
    by the sphere for which that adds least volume outside the solid.
    """
    radii = spheres[:, 3].copy()
    nearest = _Nearest(spheres)
    size = float(np.median(radii))
    pieces = [_uncovered(part, spheres, nearest, size) for part in _blocks(solid)]
    candidates = np.concatenate([part[0] for part in pieces])
    needed = np.concatenate([part[1] for part in pieces])
    if len(needed):
        radii = _grown(radii, candidates, needed, _outside_shares(solid, spheres))
    return np.column_stack([spheres[:, :3], radii + rounding(solid)])


def rounding(solid: Solid) -> float:
    """How far, in unit coordinates, points can move on the way to file coordinates and back."""
    farthest = np.abs(solid.center).max() / solid.size + 1
    return float(ROUNDINGS * np.finfo(np.float64).eps * farthest)


def _blocks(solid: Solid) -> Iterator[Array]:
    """The triangles' corners, [<= BLOCK, 3, 3] at a time."""
    for start in range(0, len(solid.faces), BLOCK):
        yield solid.vertices[solid.faces[start : start + BLOCK]]


class _Nearest:
    """Which spheres are nearest to points by power distance |p - c|^2 - r^2.

    Lifting each center to (c, sqrt(max r^2 - r^2)) turns that into an ordinary distance.
    """

    def __init__(self, spheres: Array) -> None:
        from scipy.spatial import KDTree

        r2 = spheres[:, 3] ** 2
        self._tree = KDTree(np.column_stack([spheres[:, :3], np.sqrt(r2.max() - r2)]))
        self._count = min(CANDIDATES, len(spheres))

    def __call__(self, points: Array) -> Indices:
        """Indices [n, k], nearest first."""
        found = self._tree.query(np.column_stack([points, np.zeros(len(points))]), k=self._count)[1]
        return found.reshape(len(points), self._count)


def _uncovered(pieces: Array, spheres: Array, nearest: _Nearest, size: float) -> tuple[Indices, Array]:
    """The small pieces of triangles [n, 3, 3] that no sphere holds.

    Returns the spheres that may take each, [m, k], and the radii they would then need.
    """
    candidates, needed = [], []
    while len(pieces):
        near = nearest(pieces.mean(1))
        centers = spheres[near, :3]
        radii = spheres[near, 3]
        distance = np.stack([np.linalg.norm(centers - pieces[:, None, k], axis=2) for k in range(3)])
        within = distance <= radii
        open_ = ~within.all(0).any(1)
        pieces, near, distance = pieces[open_], near[open_], distance[:, open_]
        seam = within[:, open_].any(2).all(0)
        edges = np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2)
        small = edges.max(1) <= size * np.where(seam, SEAM, PIECE)
        candidates.append(near[small])
        needed.append(distance[:, small].max(0))
        pieces = _halved(pieces[~small], edges[~small])
    return np.concatenate(candidates), np.concatenate(needed)


def _halved(pieces: Array, edges: Array) -> Array:
    """Both halves of each piece [n, 3, 3], cut at the middle of its longest edge."""
    rows, first = np.arange(len(pieces)), edges.argmax(1)
    a, b, c = (pieces[rows, (first + k) % 3] for k in range(3))
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _outside_shares(solid: Solid, spheres: Array) -> Array:
    """Share [n] of each sphere's surface that is outside the solid."""
    points = spheres[:, None, :3] + spheres[:, None, 3:] * fibonacci_sphere(SHELL_POINTS)
    out = ~solid.inside(points.reshape(-1, 3)).reshape(points.shape[:2])
    return np.maximum(out.mean(1), LEAST_SHARE)


def _grown(radii: Array, candidates: Indices, needed: Array, shares: Array) -> Array:
    """Radii [n] under which one of each piece's `candidates` [m, k] has the radius `needed` [m, k]."""
    radii = radii.copy()
    entries = np.argsort(candidates, axis=None, kind="stable")
    starts = np.searchsorted(candidates.reshape(-1)[entries], np.arange(len(radii) + 1))

    def costs(rows: Indices) -> Array:
        """What the cheapest candidate of each of these pieces costs."""
        grown = np.maximum(needed[rows] ** 3 - radii[candidates[rows]] ** 3, 0)
        return (shares[candidates[rows]] * grown).min(1)

    cost = costs(np.arange(len(needed)))
    while cost[hardest := int(cost.argmax())] > 0:
        options = candidates[hardest]
        grown = np.maximum(needed[hardest] ** 3 - radii[options] ** 3, 0)
        best = int((shares[options] * grown).argmin())
        sphere = options[best]
        radii[sphere] = needed[hardest, best]
        rows = entries[starts[sphere] : starts[sphere + 1]] // candidates.shape[1]
        cost[rows] = costs(rows)
    return radii
