"""BRDFs of the reference in float64, written from their definitions and not from the renderer's code.

Every BRDF here is a sum of terms, a colour times a scalar function of the directions. The estimator averages
the scalars and colours them afterwards, which costs a third of averaging colours.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput

if TYPE_CHECKING:
    from coslobe.render.scene import Material

Vectors = tuple[NDArray, NDArray, NDArray]


@dataclass(frozen=True)
class Diffuse:
    """A constant.

    Attributes
    ----------
    colour : float64 [3]
        Per steradian.
    """

    colour: NDArray

    def values(self, normal: NDArray, view: NDArray, light: Vectors) -> NDArray:
        """The scalar function, [n, s]; the cosine to the normal is not part of it.

        `normal` and `view` are unit vectors [n, 3], `light` holds x, y and z of unit directions [n, s]
        from the surface to the light.
        """
        return np.ones_like(light[0])


@dataclass(frozen=True)
class Lobe:
    """max(r.l, 0)^exponent around the reflection r of the view about the normal.

    Attributes
    ----------
    colour : float64 [3]
        Per steradian.
    exponent : float
        With 0, the lobe is the hemisphere around r.
    """

    colour: NDArray
    exponent: float

    def values(self, normal: NDArray, view: NDArray, light: Vectors) -> NDArray:
        """As in `Diffuse`."""
        cosine = dot(self.axis(normal, view), light)
        return np.maximum(cosine, 0.0) ** self.exponent * (cosine > 0)

    def axis(self, normal: NDArray, view: NDArray) -> NDArray:
        """The unit vector r = 2 (normal.view) normal - view, [n, 3]."""
        return 2 * np.einsum("ij,ij->i", normal, view)[:, None] * normal - view


Term = Diffuse | Lobe


def brdf_terms(material: "Material") -> list[Term]:
    """The terms of a material's BRDF: Lambert = albedo / pi; Phong = kd / pi + ks (n + 2) / (2 pi) (r.l)^n.

    Raises
    ------
    InvalidInput
        The reference does not know this kind of material.
    """
    if material.lambert is not None:
        return [Diffuse(np.asarray(material.lambert.albedo, np.float64) / np.pi)]
    if material.phong is not None:
        kd, ks = (np.asarray(c, np.float64) for c in (material.phong.kd, material.phong.ks))
        n = material.phong.exponent
        return [Diffuse(kd / np.pi), Lobe(ks * (n + 2) / (2 * np.pi), n)]
    raise InvalidInput("the reference knows lambert and phong materials only", "use one of these two")


def dot(vectors: NDArray, directions: Vectors) -> NDArray:
    """Products of one vector per point, [n, 3], with that point's directions, x, y and z of [n, s]."""
    x, y, z = directions
    product = vectors[:, 0:1] * x
    product += vectors[:, 1:2] * y
    product += vectors[:, 2:3] * z
    return product
