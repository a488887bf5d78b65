"""Blockers in groups of neighbours, so that one test rejects sixteen spheres."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.render.layout import GROUP, NO_OWNER


@dataclass(frozen=True)
class Groups:
    """Sphere sets as the kernel reads them: structures of arrays, padded with spheres of radius -1.

    Attributes
    ----------
    spheres : float32 [5, n]
        x, y, z, radius, outside; group g owns columns g GROUP to (g + 1) GROUP.
    owner : int32 [n]
    bounds : float32 [4, n / GROUP]
        x, y, z and radius of a sphere around each group.
    """

    spheres: NDArray
    owner: NDArray
    bounds: NDArray

    @property
    def n_groups(self) -> int:
        return self.bounds.shape[1]


def group(centers: NDArray, radii: NDArray, outside: NDArray, owner: NDArray, multiple: int) -> Groups:
    """Sort spheres [n, 3] into groups of neighbours from one object; the number of groups is a `multiple`."""
    leaves: list[NDArray] = []
    whole = np.maximum(owner, NO_OWNER)  # emitters together: each is an owner of its own
    for one in np.unique(whole):
        _split(centers, np.flatnonzero(whole == one), leaves)
    n_groups = -(-len(leaves) // multiple) * multiple
    spheres = np.zeros((5, n_groups * GROUP))
    spheres[3] = -1.0
    owners = np.full(n_groups * GROUP, NO_OWNER, np.int32)
    bounds = np.zeros((4, n_groups))
    bounds[3] = -1.0
    for g, leaf in enumerate(leaves):
        columns = slice(g * GROUP, g * GROUP + len(leaf))
        spheres[:3, columns] = centers[leaf].T
        spheres[3, columns] = radii[leaf]
        spheres[4, columns] = outside[leaf]
        owners[columns] = owner[leaf]
        low = (centers[leaf] - radii[leaf, None]).min(axis=0)
        high = (centers[leaf] + radii[leaf, None]).max(axis=0)
        middle = (low + high) / 2
        distance = np.linalg.norm(centers[leaf] - middle, axis=1) + radii[leaf]
        bounds[:3, g] = middle
        bounds[3, g] = distance.max() * (1 + 1e-5)  # rounding to float32 must not uncover a sphere
    return Groups(spheres.astype(np.float32), owners, bounds.astype(np.float32))


def _split(centers: NDArray, members: NDArray, leaves: list[NDArray]) -> None:
    """Halve along the longest axis, at a multiple of GROUP so that few groups stay unfilled."""
    if len(members) <= GROUP:
        leaves.append(members)
        return
    points = centers[members]
    axis = int(np.argmax(points.max(axis=0) - points.min(axis=0)))
    order = members[np.argsort(points[:, axis], kind="stable")]
    half = -(-len(members) // (2 * GROUP)) * GROUP
    _split(centers, order[:half], leaves)
    _split(centers, order[half:], leaves)
