"""Weights of shadow lobes (39): how much of its lobe a leaf of the visibility mask takes from the light.

Neighbouring lobes overlap, and a light's lobe reaches beyond the light, so that a leaf of amplitude 1 would
be wrong. The paper sets w(dist, depth) by hand; here the weight of the root makes a covered light exactly
dark (the umbra rule), and those of the other depths fit the visible share of random masks by least squares.

The paper's dist is 1 / (2 tan alpha_cap). Weights are sampled over sin^2 alpha_cap = 1 / (1 + 4 dist^2), in
which they are smooth and whose 0 is the limit of small lights. They belong to the depth of the mask, too:
leaves at its last level share the light's outline and the shadow's edge.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from coslobe.tables.cap import CapTable
from coslobe.tables.grid import cells
from coslobe.tables.product import ProductTable
from coslobe.tables.quadtree import cell_centres, disk, shadow_leaves

MASK_DEPTHS = (2, 3, 4, 5)
LEVELS = MASK_DEPTHS[-1] + 1
SAMPLES = 33
LARGEST_SINE2 = 0.75  # cones of 60 degrees; wider ones have no mask
MASKS = 3000


@dataclass(frozen=True)
class WeightTable:
    """w over sin^2 alpha_cap in [0, LARGEST_SINE2], equally spaced.

    Attributes
    ----------
    values : float64 [len(MASK_DEPTHS), SAMPLES, LEVELS]
        0 at levels that a mask does not have.
    """

    values: NDArray

    def lookup(self, mask_depth: int, sine2: ArrayLike) -> NDArray:
        """Weights of the leaves at every level, float64 [..., LEVELS], linear between samples."""
        position = np.asarray(sine2, np.float64) / LARGEST_SINE2 * (SAMPLES - 1)
        at = cells(position, SAMPLES)
        samples = self.values[MASK_DEPTHS.index(mask_depth)]
        return at.weight[0][..., None] * samples[at.index] + at.weight[1][..., None] * samples[at.index + 1]


class LeafLobes(NamedTuple):
    """The lobes of all blocks of one depth, before weights.

    Attributes
    ----------
    directions : float64 [2^d, 2^d, 3]
        Unit vectors in the mask's frame.
    amplitude : float64 [2^d, 2^d]
        The block's solid angle relative to that of one at the square's centre.
    exponent : float
        Of the cap through the corners of a block at the square's centre: the same for all of a depth.
    """

    directions: NDArray
    amplitude: NDArray
    exponent: float


def leaf_lobes(caps: CapTable, tangent: float, depth: int) -> LeafLobes:
    """Lobes of the blocks of a `depth` of the quadtree over a light with tan alpha_cap = `tangent`."""
    x = cell_centres(2**depth) * tangent
    corner2 = 2 * (tangent / 2**depth) ** 2
    length = np.sqrt(x[:, None] ** 2 + x**2 + 1)
    vectors = np.stack(np.broadcast_arrays(x[None, :], x[:, None], 1.0), axis=-1)
    cap_depth = corner2 / (np.sqrt(1 + corner2) * (1 + np.sqrt(1 + corner2)))  # 1 - 1 / sqrt(1 + corner2)
    return LeafLobes(vectors / length[..., None], length**-3, float(caps.exponent(cap_depth)))


def build(products: ProductTable, caps: CapTable) -> WeightTable:
    """The umbra rule and one least-squares fit per mask depth and sample."""
    values = np.zeros((len(MASK_DEPTHS), SAMPLES, LEVELS))
    for index, mask_depth in enumerate(MASK_DEPTHS):
        masks = random_masks(np.random.default_rng(mask_depth), MASKS, 2**mask_depth)
        leaves = shadow_leaves(masks)
        for sample, sine2 in enumerate(np.linspace(0, LARGEST_SINE2, SAMPLES)):
            parts = shadow_parts(products, caps, leaves, _tangent(sine2))
            root = 1 / shadow_parts(products, caps, [np.ones((1, 1, 1), bool)], _tangent(sine2))[0, 0]
            blocked = 1 - visible_share(masks, _tangent(sine2))
            rest = np.linalg.lstsq(parts[:, 1:], blocked, rcond=None)[0]
            values[index, sample, : mask_depth + 1] = [root, *rest]
    return WeightTable(values)


def _tangent(sine2: float) -> float:
    """tan alpha_cap; the limit of small lights is reached at a milliradian."""
    return max(np.sqrt(sine2 / (1 - sine2)), 1e-3)


def shadow_parts(products: ProductTable, caps: CapTable, leaves: list[NDArray], tangent: float) -> NDArray:
    """What leaves of weight 1 take from a diffuse surface that faces the light: float64 [n, depths].

    Relative to the light without shadow; `leaves` bool [n, 2^d, 2^d] per depth.
    """
    cosine = 1 / np.sqrt(1 + tangent**2)
    e = float(caps.exponent(tangent**2 * cosine**2 / (1 + cosine)))
    columns = []
    for depth, level in enumerate(leaves):
        lobes = leaf_lobes(caps, tangent, depth)
        z = lobes.directions[..., 2]
        angle = np.arctan2(np.hypot(lobes.directions[..., 0], lobes.directions[..., 1]), z)
        product = products.lookup(e, lobes.exponent, angle)
        mean = (product.exponent + 1) / (product.exponent + 2) * np.cos(product.axis_angle)
        part = lobes.amplitude * product.integral * mean * (e + 2) / (2 * np.pi)
        columns.append((level * part).sum(axis=(1, 2)))
    return np.stack(columns, axis=1)


def visible_share(masks: NDArray, tangent: float) -> NDArray:
    """The share of a light's irradiance on a surface facing it that masks let through, float64 [n]."""
    x = cell_centres(masks.shape[-1]) * tangent
    energy = disk(masks.shape[-1]) / (x[:, None] ** 2 + x**2 + 1) ** 2  # solid angle times cosine
    return 1 - (masks * energy).sum(axis=(1, 2)) / energy.sum()


def random_masks(rng: np.random.Generator, n: int, rows: int) -> NDArray:
    """Masks of lights in penumbra, bool [n, rows, rows]: one to four spheres' outlines cross the light."""
    x = cell_centres(rows)
    inside = disk(rows)
    masks = np.zeros((n, rows, rows), bool)
    found = 0
    while found < n:
        count = rng.integers(1, 5)
        radius, turn = 10 ** rng.uniform(-1, 1.5, count), rng.uniform(0, 2 * np.pi, count)
        distance = np.abs(radius + rng.uniform(-1, 1, count))
        cx, cy = distance * np.cos(turn), distance * np.sin(turn)
        gap2 = (x[:, None] - cx) ** 2 + (x[:, None, None] - cy) ** 2
        blocked = np.any(gap2 <= radius**2, axis=-1)
        if 0 < (blocked & inside).sum() < inside.sum():
            masks[found] = blocked
            found += 1
    return masks
