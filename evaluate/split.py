"""Where an error comes from: geometry, visibility or lobes, as maps that add up and as numbers."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.analysis import Analysis
from coslobe.evaluate.errors import ratio
from coslobe.evaluate.reference import Reference

PARTS = ("geometry", "visibility", "lobes")

FORMULAS = {
    "geometry": "R(spheres) − R(mesh), both path-traced: spheres stand for triangles",
    "visibility": "R(spheres, seen by masks) − R(spheres): one bit per cell, exact integrals",
    "lobes": "I − R(spheres, seen by masks): lobes, products, caps and tables, given the masks",
}


@dataclass(frozen=True)
class Split:
    """The signed parts of I − R(mesh) for one frame; they add up to it.

    Attributes
    ----------
    maps : dict of float64 [h, w, 3]
        By name of the part.
    squares : dict of float64 [h, w, 3]
        Estimates of the squared parts that noise does not bias; some are negative.
    """

    maps: dict[str, NDArray]
    squares: dict[str, NDArray]


def split_error(image: NDArray, mesh: Reference, spheres: Reference, analysis: Analysis) -> Split:
    """Split the error of `image` [h, w, 3] against the true meshes.

    The two references share their random numbers, so that most of their noise cancels in `geometry`. Two
    independent estimates of `visibility` give its square as their product, and their difference the noise
    to take off `lobes`.
    """
    first, second = analysis.visibility
    visibility = (first + second) / 2
    maps = {
        "geometry": spheres.radiance - mesh.radiance,
        "visibility": visibility,
        "lobes": image - spheres.radiance - visibility,
    }
    noise = spheres.variance + ((first - second) / 2) ** 2
    squares = {
        "geometry": maps["geometry"] ** 2,
        "visibility": first * second,
        "lobes": maps["lobes"] ** 2 - noise,
    }
    return Split(maps, squares)


def split_numbers(split: Split, region: NDArray, scale: float) -> dict[str, float | None]:
    """Root mean squares of the parts over `region` [h, w], in units of `scale`, without noise."""
    if not region.any():
        return dict.fromkeys(PARTS)
    return {
        name: ratio(np.sqrt(max(float(split.squares[name][region].mean()), 0.0)), scale) for name in PARTS
    }


def shares(numbers: dict[str, float | None]) -> dict[str, float] | None:
    """Each part's share of the sum of squares; None where there is no error."""
    squares = {name: (numbers[name] or 0.0) ** 2 for name in PARTS}
    total = sum(squares.values())
    return {name: square / total for name, square in squares.items()} if total > 0 else None
