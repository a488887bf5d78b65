"""Sphere sets and sphere trees: plain data."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class SphereSet:
    """Spheres that together stand for a solid.

    Attributes
    ----------
    centers : float64 [n, 3]
        In the coordinates of the mesh file.
    radii : float64 [n]
    outside : float64 [n]
        Largest distance of each sphere's surface outside the mesh, >= 0.
    """

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    outside: NDArray[np.float64]

    @property
    def count(self) -> int:
        return len(self.radii)


@dataclass(frozen=True)
class Hierarchy:
    """Bounding spheres over the finest level as flat arrays; node 0 is the root.

    Children of node k are numbered `first_child[k]` to `first_child[k] + child_count[k] - 1`. A number below
    m is a node, number m + i is sphere i of the finest level. Every child lies wholly inside its parent.

    Attributes
    ----------
    centers : float64 [m, 3]
    radii : float64 [m]
    first_child, child_count : int32 [m]
    """

    centers: NDArray[np.float64]
    radii: NDArray[np.float64]
    first_child: NDArray[np.int32]
    child_count: NDArray[np.int32]


@dataclass(frozen=True)
class MeshInfo:
    """Which mesh a tree was fitted to."""

    file: str
    sha256: str
    vertices: int
    faces: int


@dataclass(frozen=True)
class SphereTree:
    """Levels of detail over one mesh, coarse to fine, with what is known about them.

    Attributes
    ----------
    levels : tuple of SphereSet
        Each is a fit of its own; the last has exactly the count that was asked for.
    parents : tuple of int32 arrays
        For each level, per sphere the index of its parent in the level before; -1 in the first.
    hierarchy : Hierarchy
        Bounds the finest level.
    mesh : MeshInfo
    method, quality, mode : str
    seed : int
    seconds : float
        Time of sampling and fitting.
    metrics : dict
        Figures of the finest level against the true mesh (see `metrics.measure`).
    """

    levels: tuple[SphereSet, ...]
    parents: tuple[NDArray[np.int32], ...]
    hierarchy: Hierarchy
    mesh: MeshInfo
    method: str
    quality: str
    mode: str
    seed: int
    seconds: float
    metrics: dict[str, Any] = field(default_factory=dict)

    @property
    def finest(self) -> SphereSet:
        return self.levels[-1]
