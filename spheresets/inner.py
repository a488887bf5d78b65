"""Inner sets: balls inside the solid that together fill as much of it as they can."""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.descent import SMALLEST, State, adam
from coslobe.spheresets.power import nearest_by_power
from coslobe.spheresets.samples import PointSamples
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

STEPS = 200
LEARNT, LEAST = 12, 8000  # points that balls learn from: per ball, and at least
SOFTNESS, RATE = (0.2, 0.04), (0.08, 0.008)  # in median radii; ends of geometric schedules
NEIGHBOURS, RENEWED = 8, 10  # balls that may hold a point, and steps after which these are looked up again
DIFFERENCE = 1e-3  # over which the gradient of the depth is taken
FLOAT32 = 1e-6  # by which distances in unit coordinates may be wrong


def inner(solid: Solid, points: PointSamples, spheres: Array) -> Array:
    """As many balls [n, 4] inside the solid, from where the spheres [n, 4] are.

    A ball is as large as its center is deep, so only centers move: they descend on the mean of
    log(1 + exp(-z / tau)) over the points inside, z being the depth in the soft union of the balls. Centers
    outside start at the nearest point inside. Returned are the balls that held most points on the way.
    """
    from scipy.spatial import KDTree

    outside = ~solid.inside(spheres[:, :3])
    spheres = spheres.copy()
    spheres[outside, :3] = points.interior[KDTree(points.interior).query(spheres[outside, :3])[1]]
    best = balls = _balls(solid, spheres)
    most = -1
    radius = float(np.median(balls[:, 3]))
    taus, rates = (radius * np.geomspace(*ends, STEPS) for ends in (SOFTNESS, RATE))
    learnt = points.interior[:: max(1, len(points.interior) // max(LEARNT * len(balls), LEAST))]
    state = State(balls, np.zeros_like(balls), np.zeros_like(balls))
    near = np.empty((0, 0), np.int64)
    for step, (tau, rate) in enumerate(zip(taus, rates, strict=True)):
        if step % RENEWED == 0:
            near = nearest_by_power(balls)(learnt, NEIGHBOURS)
            offset = learnt - balls[near[:, 0], :3]
            held = int((np.linalg.norm(offset, axis=1) <= balls[near[:, 0], 3]).sum())
            if held > most:
                best, most = balls, held
        slope = _slopes(learnt, balls, near, tau)
        gradient = np.column_stack(
            [slope[:, :3] + slope[:, 3:] * _deeper(solid, balls), np.zeros(len(balls))]
        )
        state = adam(state, gradient, rate)
        moved = _balls(solid, state.spheres.astype(np.float64))
        stuck = moved[:, 3] <= SMALLEST  # it left the solid
        moved[stuck] = balls[stuck]
        balls = state.spheres = moved
    return best


def _balls(solid: Solid, spheres: Array) -> Array:
    """The largest balls around the centers of spheres [n, 4]; as good as points where these are outside."""
    centers = spheres[:, :3]
    depth = np.where(solid.inside(centers), solid.distance(centers) - FLOAT32, 0)
    return np.column_stack([centers, np.maximum(depth, SMALLEST)])


def _deeper(solid: Solid, balls: Array) -> Array:
    """Gradient [n, 3] of the distance to the surface, smooth where that has a ridge."""
    steps = DIFFERENCE * np.concatenate([np.eye(3), -np.eye(3)])
    distance = solid.distance((balls[:, None, :3] + steps).reshape(-1, 3)).reshape(-1, 2, 3)
    return (distance[:, 0] - distance[:, 1]) / (2 * DIFFERENCE)


def _slopes(points: Array, balls: Array, near: NDArray[np.int64], tau: float) -> Array:
    """Gradient [n, 4] of the mean of log(1 + exp(-z / tau)) with respect to centers and radii."""
    offset = points[:, None] - balls[near, :3]
    distance = np.maximum(np.linalg.norm(offset, axis=2), SMALLEST)
    e = np.exp(np.clip((balls[near, 3] - distance) / tau, -60, 60))
    S = e.sum(1, keepdims=True)
    pull = -e / (S * (1 + S)) / (tau * len(points))
    parts = [*(pull[:, :, None] * offset / distance[:, :, None]).transpose(2, 0, 1), pull]
    return np.stack(
        [np.bincount(near.ravel(), part.ravel(), len(balls)) for part in parts], axis=1, dtype=float
    )
