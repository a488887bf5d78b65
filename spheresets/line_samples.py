"""Lines and which of them hit a solid: what its silhouettes and soft shadows are made of."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.directions import frames
from coslobe.spheresets.soft_lines import BUNDLE
from coslobe.spheresets.solid import Solid

Array = NDArray[np.float64]

LINES = 100_000
BATCH = 512  # bundles
UNIFORM = 4  # one bundle in so many lies anywhere, the others at outlines
SPREAD = (0.0067, 0.02)  # standard deviations of bundles around their outline, half of them each
BLUR = (0.003, 0.08)  # radii of bundles at the solid, log-uniform
RECEIVER = 1.0  # distance of the point in which a bundle's lines meet
HALVINGS = 9  # of the way across an outline: to 1/500 of it


@dataclass(frozen=True)
class LineSamples:
    """Isotropic random lines, uniform through the box's circumsphere, and which of them hit the solid.

    Attributes
    ----------
    origins, directions : float64 [n, 3]
    hit : bool [n]
    """

    origins: Array
    directions: Array
    hit: NDArray[np.bool_]


def draw_lines(solid: Solid, rng: np.random.Generator) -> LineSamples:
    """Lines under which the mean projected area of any shape in the box is its share of hits."""
    directions = _directions(LINES, rng)
    origins = 0.5 * _in_disks(directions, rng)
    return LineSamples(origins, directions, _hit(solid, origins, directions))


def draw_bundles(
    solid: Solid, batches: int, fineness: float, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Batches of bundles for `soft_lines.SoftLines`, [batches, 7, BATCH * BUNDLE].

    A bundle is the lines of a narrow cone: what a receiver sees around a direction. Most go past an outline
    of the solid, where errors are. It is found by halving the way between a line that hits and one that
    misses, both in the same random direction, which works for all that can be hit. `fineness` scales widths.
    """
    n = batches * BATCH
    middle = _directions(n, rng)
    through = 0.5 * _in_disks(middle, rng)
    outline = np.arange(n) % UNIFORM > 0
    through[outline] = _outlines(solid, middle[outline], fineness, rng)

    blur = fineness * np.exp(rng.uniform(np.log(BLUR[0]), np.log(BLUR[1]), n))
    cone = np.repeat(middle, BUNDLE, axis=0)
    offset = np.repeat(blur, BUNDLE)[:, None] * _in_disks(cone, rng)
    receiver = np.repeat(through - RECEIVER * middle, BUNDLE, axis=0)
    directions = RECEIVER * cone + offset
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = receiver - (receiver * directions).sum(1, keepdims=True) * directions
    rows = np.column_stack([origins, directions, _hit(solid, origins, directions)]).astype(np.float32)
    return np.ascontiguousarray(rows.reshape(batches, -1, 7).transpose(0, 2, 1))


def _outlines(solid: Solid, directions: Array, fineness: float, rng: np.random.Generator) -> Array:
    """A point near the solid's outline as seen along each direction."""
    n = len(directions)
    inner = solid.sample_surface(n, rng)[rng.permutation(n)]  # its order is that of the triangles
    inner -= (inner * directions).sum(1, keepdims=True) * directions
    outer = _in_disks(directions, rng)
    outer /= 2 * np.linalg.norm(outer, axis=1, keepdims=True)  # on the circumsphere
    for _ in range(HALVINGS):
        middle = (inner + outer) / 2
        hit = _hit(solid, middle, directions)[:, None]
        inner, outer = np.where(hit, middle, inner), np.where(hit, outer, middle)
    s, t = frames(directions)
    away = fineness * rng.choice(SPREAD, n)[:, None] * rng.normal(size=(n, 2))
    return (inner + outer) / 2 + away[:, :1] * s + away[:, 1:] * t


def _directions(count: int, rng: np.random.Generator) -> Array:
    directions = rng.normal(size=(count, 3))
    return directions / np.linalg.norm(directions, axis=1, keepdims=True)


def _in_disks(normals: Array, rng: np.random.Generator) -> Array:
    """A uniform point in the unit disk around the origin at right angles to each normal."""
    s, t = frames(normals)
    radius = np.sqrt(rng.random((len(normals), 1)))
    angle = 2 * np.pi * rng.random((len(normals), 1))
    return radius * (np.cos(angle) * s + np.sin(angle) * t)


def _hit(solid: Solid, origins: Array, directions: Array) -> NDArray[np.bool_]:
    """Whether the lines hit; `origins` are their points nearest to the box's center."""
    return solid.occluded(origins - directions, directions, np.inf)
