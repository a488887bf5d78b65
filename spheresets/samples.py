"""Points and which of them are in a solid: what fits learn it from, drawn once and shared by the levels."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput
from coslobe.spheresets.soft_union import CHUNK
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

BATCH = 64 * CHUNK
NEAR_BATCHES = (8, 7)  # surface points with the smaller and the larger noise
BOX_BATCHES = 5
WIDEST = 0.03  # noise, in square roots of the surface: a large box can hold little but rods or specks
THIN = 9.0  # in the smaller noise: where a part or a gap is thinner, that noise shrinks with it
LEAST_NOISE = 0.01  # share of it that stays where surfaces coincide
LOOKED_AT = 200  # points inside a connected part, for a ball inside it
MARGIN, LEAST_SIDE = 0.035, 0.3  # of the box for uniform points: spheres bulge far out of flat solids
JUDGED = 0.35  # share of the points over which exchanges are judged, at scale 1


@dataclass(frozen=True)
class PointSamples:
    """Points, in unit coordinates, and on which side of the surface they are.

    Attributes
    ----------
    batches : float32 [k, 4, BATCH]
        Rows x, y, z, inside (1 or 0). Each batch is a stratified sample of the whole, in the order of a
        space-filling curve.
    judged : float32 [4, m]
        A part of the batches as one.
    interior : float64 [n, 3]
        Some of the points inside.
    depth : float64 [n]
        Their distance to the surface.
    parts : float64 [k, 4]
        A ball inside each connected part, the largest surface first; none where all is one part.
    area : float
        Of the surface.
    """

    batches: NDArray[np.float32]
    judged: NDArray[np.float32]
    interior: Array
    depth: Array
    parts: Array
    area: float

    @cached_property
    def tree(self) -> Any:
        """A scipy KDTree over `interior`."""
        from scipy.spatial import KDTree

        return KDTree(self.interior)

    def uncovered(self, spheres: Array) -> NDArray[np.int64]:
        """Which interior points lie in none of the spheres [n, 4]."""
        free = np.ones(len(self.interior), bool)
        for held in self.tree.query_ball_point(spheres[:, :3], spheres[:, 3], return_sorted=False):
            free[held] = False
        return np.flatnonzero(free)


def draw_points(
    solid: Solid, noise: tuple[float, float], scale: int, interior: int, rng: np.random.Generator
) -> PointSamples:
    """`scale` times 20 batches: 15 of surface points displaced by normal noise, 5 uniform in the box.

    Surface points count alike, so the loss weighs the mesh by area, which is what silhouettes want; only very
    small connected parts get more than that. The two widths of `noise` place some points close to the
    surface, closer where a part is thin, and some where they can call a sphere from afar.

    Raises
    ------
    InvalidInput
        The mesh encloses no volume.
    """
    area = float(solid.areas.sum())
    near, parts = [], []
    for batches, width in zip(NEAR_BATCHES, noise, strict=True):
        surface, face = solid.sample_parts(batches * scale * BATCH, rng)
        offset = rng.normal(0, min(width, WIDEST * np.sqrt(area)), surface.shape)
        if width == noise[0]:
            thin = solid.clearance(surface, face) / (THIN * width)
            offset *= np.clip(thin, LEAST_NOISE, 1)[:, None]
        near.append(surface + offset)
        parts.append(solid.parts[face])
    margin = np.maximum(MARGIN, (LEAST_SIDE - (solid.upper - solid.lower)) / 2)
    box = rng.uniform(solid.lower - margin, solid.upper + margin, (BOX_BATCHES * scale * BATCH, 3))
    points = np.concatenate([*near, box])
    inside = solid.inside(points)
    if not solid.encloses(points[inside]):
        raise InvalidInput(
            f"{solid.name}: the mesh encloses no volume (open sheets?)",
            "close it, or give its sheets thickness",
        )

    # Consecutive points of the curve go to different batches: each batch holds one of every group.
    curve = np.argsort(_morton(points), kind="stable").reshape(BATCH, -1)
    rows = np.column_stack([points, inside]).astype(np.float32)
    batches = np.ascontiguousarray(rows[rng.permuted(curve, axis=1).T].transpose(0, 2, 1))
    judged = np.concatenate(batches[: round(JUDGED * len(batches) / np.sqrt(scale))], axis=1)

    part = np.concatenate(parts)
    there = inside[: len(part)]
    balls = _balls(solid, points[: len(part)][there], part[there])

    chosen = np.flatnonzero(inside)
    chosen = np.sort(rng.choice(chosen, min(interior, len(chosen)), replace=False))
    return PointSamples(batches, judged, points[chosen], solid.distance(points[chosen]), balls, area)


def _balls(solid: Solid, points: Array, part: NDArray[np.int32]) -> Array:
    """For each connected part the largest ball around some of the points [n, 3] inside it, [k, 4]."""
    area = np.bincount(solid.parts, solid.areas)
    if np.count_nonzero(area) == 1:
        return np.empty((0, 4))
    order = np.lexsort((part, -area[part]))
    first = np.flatnonzero(np.diff(part[order], prepend=-1))
    rank = np.arange(len(part)) - np.repeat(first, np.diff(first, append=len(part)))
    some = order[rank < LOOKED_AT]
    depth = solid.distance(points[some])
    first = np.flatnonzero(np.diff(part[some], prepend=-1))
    group = np.repeat(np.arange(len(first)), np.diff(first, append=len(some)))
    last = np.append(first[1:], len(some)) - 1
    deepest = np.lexsort((depth, group))[last]
    return np.column_stack([points[some[deepest]], depth[deepest]])


def _morton(points: Array) -> NDArray[np.int64]:
    """Position of each point on the Z-order curve through a grid of 1024^3 cells."""
    lower, upper = points.min(0), points.max(0)
    cells = ((points - lower) / (upper - lower).max() * 1023).astype(np.int64)
    code = np.zeros(len(points), np.int64)
    for axis in range(3):
        x = cells[:, axis]
        for shift, mask in ((16, 0x30000FF), (8, 0x300F00F), (4, 0x30C30C3), (2, 0x9249249)):
            x = (x | (x << shift)) & mask  # two zeros between neighbouring bits, in four steps
        code |= x << axis
    return code
