"""BRDFs of the reference in float64, written from their definitions and not from the renderer's code.

Every BRDF here is a sum of terms, a colour times a scalar function of the directions. The estimator averages
the scalars and colours them afterwards, which costs a third of averaging colours.
"""

from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import InvalidInput

if TYPE_CHECKING:
    from coslobe.render.scene import Material

Vectors = tuple[NDArray, NDArray, NDArray]


class Brdf(Protocol):
    """f(view, light; normal) = sum over k of colours[k] * functions(...)[k].

    Attributes
    ----------
    colours : float64 [k, 3]
        Per steradian.
    """

    colours: NDArray

    def functions(self, normal: NDArray, view: NDArray, light: Vectors) -> list[NDArray | float]:
        """The scalar functions, each [n, s] or a constant.

        `normal`, `view` are unit vectors [n, 3], both on the viewer's side; `light` holds x, y and z of unit
        directions [n, s] from the surface to the light. The cosine to the normal is not included.
        """
        ...


class Lambert:
    """f = albedo / pi."""

    def __init__(self, albedo: NDArray) -> None:
        self.colours = np.atleast_2d(np.asarray(albedo, np.float64)) / np.pi

    def functions(self, normal: NDArray, view: NDArray, light: Vectors) -> list[NDArray | float]:
        return [1.0]


class Phong:
    """f = kd / pi + ks (n + 2) / (2 pi) max(r.l, 0)^n, with r the reflection of the view about the normal."""

    def __init__(self, kd: NDArray, ks: NDArray, exponent: float) -> None:
        self.exponent = float(exponent)
        scale = (self.exponent + 2) / (2 * np.pi)
        self.colours = np.stack([np.asarray(kd) / np.pi, np.asarray(ks) * scale]).astype(np.float64)

    def functions(self, normal: NDArray, view: NDArray, light: Vectors) -> list[NDArray | float]:
        reflected = 2 * np.einsum("ij,ij->i", normal, view)[:, None] * normal - view
        cosine = dot(reflected, light)
        # The comparison matters for n = 0 only: the lobe is then the hemisphere around r.
        return [1.0, np.maximum(cosine, 0.0) ** self.exponent * (cosine > 0)]


def create_brdf(material: "Material") -> Brdf:
    """The BRDF of a material of the scene file.

    Raises
    ------
    InvalidInput
        The reference does not know this kind of material.
    """
    if material.lambert is not None:
        return Lambert(np.asarray(material.lambert.albedo))
    if material.phong is not None:
        phong = material.phong
        return Phong(np.asarray(phong.kd), np.asarray(phong.ks), phong.exponent)
    raise InvalidInput("the reference knows lambert and phong materials only", "use one of these two")


def dot(vectors: NDArray, directions: Vectors) -> NDArray:
    """Products of one vector per point, [n, 3], with that point's directions, x, y and z of [n, s]."""
    x, y, z = directions
    product = vectors[:, 0:1] * x
    product += vectors[:, 1:2] * y
    product += vectors[:, 2:3] * z
    return product
