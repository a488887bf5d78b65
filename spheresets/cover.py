"""Outer covers: the least growth of radii that puts the whole surface into the spheres, without sampling.

A ball holds a triangle if it holds the three corners. A triangle that no single sphere holds is halved until
its pieces lie in one sphere each, or are so small that a sphere may grow to take them. So every point of the
surface is covered, not only those that somebody looked at.
"""

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.power import nearest_by_power
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

BLOCK = 1 << 17  # triangles at a time
CANDIDATES = 12  # spheres that may hold or take a piece: those nearest by power distance
SAMPLES, ROUNDS = 50_000, 8  # points of the surface that are covered first, until
FEW = 100  # or fewer of them are not: then little else is left
PIECE = 0.1  # longest edge of pieces with an uncovered corner, in radii of the largest candidate
SEAM = PIECE / 32  # the same for pieces whose corners are in several spheres
SHELL_POINTS = 64  # on each sphere, for the share of its growth that is outside
LEAST_SHARE = 0.05  # of a growth that counts as outside: growth inside the solid is not quite free
ROUNDINGS = 16  # of a coordinate, by which radii exceed what float64 finds necessary


def cover(solid: Solid, spheres: Array) -> Array:
    """The spheres [n, 4] with radii grown so that every point of the surface is in one of them.

    Holds in file coordinates too, after rounding. Growth is greedy: what costs most is taken first, by the
    sphere for which that adds least volume outside the solid.
    """
    rng = np.random.default_rng(0)
    shares = _outside_shares(solid, spheres)
    for _ in range(ROUNDS):
        points = _uncovered(solid.sample_surface(SAMPLES, rng)[:, None], spheres)
        spheres = _grown(spheres, shares, [points])
        if len(points[0]) <= FEW:
            break
    spheres = _grown(spheres, shares, [_uncovered(part, spheres) for part in _blocks(solid)])
    return np.column_stack([spheres[:, :3], spheres[:, 3] + rounding(solid)])


def rounding(solid: Solid) -> float:
    """How far, in unit coordinates, points can move on the way to file coordinates and back."""
    farthest = np.abs(solid.center).max() / solid.size + 1
    return float(ROUNDINGS * np.finfo(np.float64).eps * farthest)


def _blocks(solid: Solid) -> Iterator[Array]:
    """The triangles' corners, [<= BLOCK, 3, 3] at a time."""
    for start in range(0, len(solid.faces), BLOCK):
        yield solid.vertices[solid.faces[start : start + BLOCK]]


def _uncovered(pieces: Array, spheres: Array) -> tuple[Indices, Array]:
    """The small parts of convex pieces [n, corners, 3] (points or triangles) that no sphere holds.

    Returns the spheres that may take each, [m, k], and the radii they would then need.
    """
    nearest = nearest_by_power(spheres)
    candidates, needed = [], []
    while len(pieces):
        near = nearest(pieces.mean(1), 2)  # holds most of them
        pieces = pieces[~np.any(np.all(_within(pieces, spheres[near]), axis=0), axis=1)]
        near = nearest(pieces.mean(1), CANDIDATES)
        within = _within(pieces, spheres[near])
        left = ~np.any(np.all(within, axis=0), axis=1)
        pieces, near, seam = pieces[left], near[left], np.all(np.any(within[:, left], axis=2), axis=0)
        edges = np.linalg.norm(pieces - np.roll(pieces, -1, axis=1), axis=2)
        small = edges.max(1) <= spheres[near, 3].max(1) * np.where(seam, SEAM, PIECE)
        candidates.append(near[small])
        needed.append(_distances(pieces[small], spheres[near[small]]).max(0))
        pieces = _halved(pieces[~small], edges[~small])
    return np.concatenate(candidates), np.concatenate(needed)


def _distances(pieces: Array, spheres: Array) -> Array:
    """Distance [corners, n, k] of the corners [n, corners, 3] of pieces from centers of spheres [n, k, 4]."""
    return np.linalg.norm(pieces.swapaxes(0, 1)[:, :, None] - spheres[:, :, :3], axis=3)


def _within(pieces: Array, spheres: Array) -> NDArray[np.bool_]:
    return _distances(pieces, spheres) <= spheres[:, :, 3]


def _halved(pieces: Array, edges: Array) -> Array:
    """Both halves of each piece [n, 3, 3], cut at the middle of its longest edge."""
    rows, first = np.arange(len(pieces)), edges.argmax(1)
    a, b, c = (pieces[rows, (first + k) % 3] for k in range(3))
    middle = (a + b) / 2
    return np.concatenate([np.stack([a, middle, c], axis=1), np.stack([middle, b, c], axis=1)])


def _grown(spheres: Array, shares: Array, demands: list[tuple[Indices, Array]]) -> Array:
    candidates, needed = (np.concatenate(part) for part in zip(*demands, strict=True))
    radii = grow(spheres[:, 3], candidates, needed, lambda who, radius: shares[who] * radius**3)
    return np.column_stack([spheres[:, :3], radii])


def grow(
    radii: Array, candidates: Indices, needed: Array, volume: Callable[[Indices, Array], Array]
) -> Array:
    """Radii [n] grown until one of each piece's `candidates` [m, k] has the radius that it `needed` [m, k].

    Greedy, hardest first: the piece whose cheapest candidate costs most is taken first, by that candidate,
    which then holds others for free. `volume(sphere, radius)` is what counts: its increase is the cost.
    """
    radii = radii.copy()
    if not len(needed):
        return radii
    paid = volume(np.arange(len(radii)), radii)
    volumes = volume(candidates, needed)
    cost = np.maximum(volumes - paid[candidates], 0).min(1)  # of each piece, by its cheapest candidate
    entries = np.argsort(candidates, axis=None, kind="stable")  # sphere by sphere
    bounds = np.searchsorted(candidates.reshape(-1)[entries], np.arange(len(radii) + 1))
    rows, sorted_volumes = entries // candidates.shape[1], volumes.reshape(-1)[entries]
    while cost[hardest := int(cost.argmax())] > 0:
        best = int((volumes[hardest] - paid[candidates[hardest]]).argmin())
        sphere = candidates[hardest, best]
        radii[sphere], paid[sphere] = needed[hardest, best], volumes[hardest, best]
        own = slice(*bounds[sphere : sphere + 2])
        cost[rows[own]] = np.minimum(cost[rows[own]], np.maximum(sorted_volumes[own] - paid[sphere], 0))
    return radii


def _outside_shares(solid: Solid, spheres: Array) -> Array:
    """Share [n] of each sphere's surface that is outside the solid."""
    points = spheres[:, None, :3] + spheres[:, None, 3:] * fibonacci_sphere(SHELL_POINTS)
    out = ~solid.inside(points.reshape(-1, 3)).reshape(points.shape[:2])
    return np.maximum(out.mean(1), LEAST_SHARE)
