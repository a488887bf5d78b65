"""Medial balls: inner Voronoi balls of surface samples, with more samples where the balls err.

The Voronoi cell of a surface sample is long and thin; its farthest vertex inside the solid, the inner pole,
approximates a point of the medial axis (Amenta, Choi and Kolluri, The power crust, 2001), and the ball around
it that touches the sample a maximal ball. Other inner vertices also lie near the surface, with small balls
that say little; only poles are kept.
"""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.power import nearest_by_power
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]
Indices = NDArray[np.int64]

FIRST_SITES = 1 / 3  # of the sites are drawn at random; fewer can miss thin parts
NEW_SITES = 0.25  # of the sites, at most, in one round: each shows where more are needed
JITTER = 1e-7  # of sites: no five on one sphere, no four in one plane


def medial_balls(solid: Solid, surface: Array, sites: int, rng: np.random.Generator) -> Array:
    """About `sites` balls [n, 4] along the medial axis, n <= sites; none where the solid is too thin.

    The samples `surface` [m, 3] are what sites are chosen from, and what the balls are judged by: a ball that
    holds samples protrudes, and the one nearest to its center becomes a new site; a sample outside the union
    marks a gap and becomes one itself. The worst come first, as in Bradshaw and O'Sullivan's sampling.
    Radii end at the nearest sample.
    """
    from scipy.spatial import KDTree

    nearest = KDTree(surface).query
    chosen = rng.permutation(len(surface))[: max(int(FIRST_SITES * sites), 8)]
    while True:
        balls = _polar_balls(solid, surface[chosen] + rng.normal(0, JITTER, (len(chosen), 3)))
        if not len(balls):
            return balls
        distance, held = nearest(balls[:, :3])
        most = min(int(NEW_SITES * len(chosen)) + 1, sites - len(chosen))
        gap, sample = _gaps(balls, surface, chosen)
        new = _worst(np.concatenate([balls[:, 3] - distance, gap]), np.concatenate([held, sample]), most)
        if not len(new):
            return np.column_stack([balls[:, :3], np.minimum(balls[:, 3], distance)])
        chosen = np.concatenate([chosen, new])


def _gaps(balls: Array, surface: Array, chosen: Indices) -> tuple[Array, Indices]:
    """Distance from the union, and number, of the sample farthest from it in each chosen sample's cell."""
    from scipy.spatial import KDTree

    near = balls[nearest_by_power(balls)(surface, 1)[:, 0]]
    gap = np.linalg.norm(surface - near[:, :3], axis=1) - near[:, 3]
    cell = np.asarray(KDTree(surface[chosen]).query(surface)[1])
    farthest = np.argsort(-gap, kind="stable")
    farthest = farthest[np.unique(cell[farthest], return_index=True)[1]]
    return gap[farthest], farthest


def _worst(error: Array, sample: Indices, most: int) -> Indices:
    """The samples with the largest errors, each once, at most `most`."""
    order = np.argsort(-error, kind="stable")
    order = order[error[order] > 10 * JITTER]
    order = order[np.sort(np.unique(sample[order], return_index=True)[1])]
    return sample[order[:most]]


def _polar_balls(solid: Solid, sites: Array) -> Array:
    """The ball [n, 4] around the inner pole of each site [m, 3] that has one, each once."""
    from scipy.spatial import Delaunay

    corners = Delaunay(sites).simplices
    a = sites[corners[:, 0]]
    edges = sites[corners[:, 1:]] - a[:, None]
    normals = np.cross(edges[:, [1, 2, 0]], edges[:, [2, 0, 1]])
    volume = np.einsum("nd,nd->n", edges[:, 0], normals[:, 0])  # six times the tetrahedron's, signed
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        offset = np.einsum("nk,nkd->nd", (edges**2).sum(2), normals) / (2 * volume[:, None])
    centers, radii = a + offset, np.linalg.norm(offset, axis=1)
    inner = np.flatnonzero(radii < 1)  # also drops what is not finite; the box has diagonal 1
    inner = inner[solid.inside(centers[inner])]
    inner = inner[np.argsort(radii[inner], kind="stable")]
    poles = np.full(len(sites), -1)
    np.maximum.at(poles, corners[inner], np.arange(len(inner))[:, None])  # the largest ball has the last rank
    kept = inner[np.unique(poles[poles >= 0])]
    return np.column_stack([centers[kept], radii[kept]])
