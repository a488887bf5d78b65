"""BRDFs of the reference in float64, written from their definitions and not from the renderer's code.

Every BRDF here is a sum of terms, a colour times a scalar function of the directions. The estimator averages
the scalars and colours them afterwards, which costs a third of averaging colours.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.render.fields import Texture

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Material

Vectors = tuple[NDArray, NDArray, NDArray]


@dataclass(frozen=True, eq=False)
class Diffuse:
    """A constant.

    Attributes
    ----------
    colour : float64 [n, 3]
        Per steradian, at n points.
    """

    colour: NDArray
    cosine = True

    def values(self, light: Vectors) -> NDArray:
        """The scalar function, [n, s]; where `cosine` is true, the cosine to the normal is not part of it.

        `light` holds x, y and z of unit directions [n, s] from the surface to the light.
        """
        return np.ones_like(light[0])


@dataclass(frozen=True, eq=False)
class Lobe:
    """max(w.l, 0)^exponent.

    Attributes
    ----------
    colour : float64 [n, 3]
        Per steradian, at n points.
    axis : float64 [n, 3]
        w, not of unit length.
    exponent : float64 [n]
        With 0, the lobe is the hemisphere around w.
    cosine : bool
        False: the lobe stands for BRDF times cosine.
    """

    colour: NDArray
    axis: NDArray
    exponent: NDArray
    cosine: bool = True

    def values(self, light: Vectors) -> NDArray:
        """As in `Diffuse`."""
        cosine = dot(self.axis, light)
        return np.maximum(cosine, 0.0) ** self.exponent[:, None] * (cosine > 0)

    def integral(self) -> NDArray:
        """Of the scalar function over all directions, [n]."""
        length = np.linalg.norm(self.axis, axis=1)
        return length**self.exponent * 2 * np.pi / (self.exponent + 1)


Term = Diffuse | Lobe


def brdf_terms(material: "Material", gbuffer: "GBuffer", points: NDArray) -> list[Term]:
    """The terms of a material's BRDF at some `points` of `gbuffer`, which all show the material.

    Lambert = albedo / pi; Phong = kd / pi + ks (n + 2) / (2 pi) (r.l)^n; Phong 1975, with the cosine:
    kd (n.l) + ks (r.l)^n; Lafortune = kd / pi + sum of rho (cx vx lx + cy vy ly + cz vz lz)^n, in the frame
    of tangent, normal x tangent, and normal; every power of a negative number counts as 0.
    """
    normal, view = gbuffer.shading_normal[points], gbuffer.view[points]
    height = np.einsum("ij,ij->i", normal, view)[:, None]
    mirror = 2 * height * normal - view

    def numbers(value: float | Texture) -> NDArray:
        texel = np.ones(len(points))
        if isinstance(value, Texture):
            return value.offset * texel + value.scale * gbuffer.texels[value.source][points]
        return value * texel

    def colours(value: tuple[float, float, float] | Texture) -> NDArray:
        if isinstance(value, Texture):
            return value.offset + value.scale * gbuffer.texels[value.source][points]
        return np.tile(np.asarray(value, np.float64), (len(points), 1))

    if material.lambert is not None:
        return [Diffuse(colours(material.lambert.albedo) / np.pi)]
    if material.phong is not None:
        phong, n = material.phong, numbers(material.phong.exponent)
        specular = colours(phong.ks) * (n + 2)[:, None] / (2 * np.pi)
        return [Diffuse(colours(phong.kd) / np.pi), Lobe(specular, mirror, n)]
    if material.phong_1975 is not None:
        old, n = material.phong_1975, numbers(material.phong_1975.exponent)
        return [Diffuse(colours(old.kd)), Lobe(colours(old.ks), mirror, n, cosine=False)]
    assert material.lafortune is not None
    terms: list[Term] = [Diffuse(colours(material.lafortune.kd) / np.pi)]
    for lobe in material.lafortune.lobes:
        cx, cy, cz = (numbers(component)[:, None] for component in lobe.c)
        axis = cx * (view - height * normal) + cz * height * normal
        if gbuffer.tangent is not None:
            y = np.cross(normal, gbuffer.tangent[points])
            axis += (cy - cx) * np.einsum("ij,ij->i", y, view)[:, None] * y
        terms.append(Lobe(colours(lobe.rho), axis, numbers(lobe.exponent)))
    return terms


def dot(vectors: NDArray, directions: Vectors) -> NDArray:
    """Products of one vector per point, [n, 3], with that point's directions, x, y and z of [n, s]."""
    x, y, z = directions
    product = vectors[:, 0:1] * x
    product += vectors[:, 1:2] * y
    product += vectors[:, 2:3] * z
    return product
