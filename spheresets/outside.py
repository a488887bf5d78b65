"""How far spheres reach out of the solid."""

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.directions import fibonacci_sphere
from coslobe.spheresets.solid import Solid

POINTS = 256


def outside_distances(solid: Solid, spheres: NDArray[np.float64]) -> NDArray[np.float64]:
    """Largest distance [n] outside the solid over 256 points on each sphere [n, 4]; 0 where none is outside.

    Unit coordinates. Points are on the sphere itself, whether or not another sphere holds them.
    """
    points = spheres[:, None, :3] + spheres[:, None, 3:] * fibonacci_sphere(POINTS)
    distance = np.zeros(points.shape[:2])
    out = ~solid.inside(points.reshape(-1, 3)).reshape(distance.shape)
    distance[out] = solid.distance(points[out])
    return distance.max(1)
