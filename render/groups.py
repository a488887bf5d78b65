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


def clusters(centers: NDArray, owner: NDArray) -> NDArray[np.intp]:
    """Spheres [n, 3] in clusters of up to GROUP neighbours of one object: indices [g, GROUP], -1 for none.

    Objects that move as wholes keep good clusters, so that the frames of a sequence share them.
    """
    found: list[NDArray] = []
    whole = np.maximum(owner, NO_OWNER)  # emitters together: each is an owner of its own
    for one in np.unique(whole):
        _split(centers, np.flatnonzero(whole == one), found)
    members = np.full((len(found), GROUP), -1, np.intp)
    for row, cluster in zip(members, found, strict=True):
        row[: len(cluster)] = cluster
    return members


def group(
    members: NDArray, centers: NDArray, radii: NDArray, outside: NDArray, owner: NDArray, multiple: int
) -> Groups:
    """Spheres as `clusters` has put them together; the number of groups is a `multiple`."""
    n_groups = -(-len(members) // multiple) * multiple
    spheres = np.zeros((5, n_groups, GROUP))
    spheres[3] = -1.0
    owners = np.full((n_groups, GROUP), NO_OWNER, np.int32)
    bounds = np.zeros((4, n_groups))
    bounds[3] = -1.0
    if len(members):
        there = members >= 0
        own = centers[members], np.where(there, radii[members], -1.0)
        filled = slice(0, len(members))
        spheres[:3, filled] = np.where(there, own[0].transpose(2, 0, 1), 0.0)
        spheres[3, filled] = own[1]
        spheres[4, filled] = np.where(there, outside[members], 0.0)
        owners[filled] = np.where(there, owner[members], NO_OWNER)
        nothing = np.where(there, 0.0, np.inf)[..., None]
        low = (own[0] - own[1][..., None] + nothing).min(axis=1)
        high = (own[0] + own[1][..., None] - nothing).max(axis=1)
        middle = (low + high) / 2
        distance = np.linalg.norm(own[0] - middle[:, None], axis=2) + own[1]
        bounds[:3, filled] = middle.T
        # Rounding to float32 must not uncover a sphere.
        bounds[3, filled] = np.where(there, distance, 0.0).max(axis=1) * (1 + 1e-5)
    flat = spheres.reshape(5, -1)
    return Groups(flat.astype(np.float32), owners.reshape(-1), bounds.astype(np.float32))


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
