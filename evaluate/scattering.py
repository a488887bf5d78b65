"""Directions in which the vertices of paths scatter light, sampled as the terms of their BRDFs."""

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate.brdf import Diffuse, Lobe, Term, Vectors, brdf_terms, dot
from coslobe.evaluate.sampling import square_to_lobe

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Material


@dataclass(frozen=True)
class _Group:
    """Vertices of one material.

    Attributes
    ----------
    at : int64 [m]
        Their indices.
    terms : list of Term
    share : float64 [terms, m]
        Probability with which each term is sampled: its part of the light that all reflect, about.
    """

    at: NDArray
    terms: list[Term]
    share: NDArray


class Scattering:
    """The BRDFs at the vertices of paths, float64 [n], one direction per vertex.

    A direction comes from one of the terms, chosen at random; its density is that of the mixture of all, so
    that light over density stays bounded (the balance heuristic for one sample).
    """

    def __init__(self, materials: "list[Material]", vertices: "GBuffer") -> None:
        self._vertices = vertices
        self._groups: list[_Group] = []
        for kind in np.unique(vertices.material):
            at = np.flatnonzero(vertices.material == kind)
            terms = brdf_terms(materials[kind], vertices, at)
            power = np.stack([term.colour.mean(axis=1) * _reflected(term) for term in terms])
            total = power.sum(axis=0)
            share = np.divide(power, total, out=np.full_like(power, 1 / len(terms)), where=total > 0)
            self._groups.append(_Group(at, terms, share))

    def sample(self, u: NDArray, v: NDArray, w: NDArray) -> NDArray:
        """Unit directions [n, 3] from uniform numbers [n]; w chooses the term."""
        result = np.empty((len(u), 3))
        for group in self._groups:
            chosen = (w[group.at] >= np.cumsum(group.share, axis=0)[:-1]).sum(axis=0)
            for k, term in enumerate(group.terms):
                mine = np.flatnonzero(chosen == k)
                at = group.at[mine]
                axis, exponent = self._lobe(term, group.at)
                found = square_to_lobe(u[at, None], v[at, None], axis[mine], exponent[mine])
                result[at] = np.concatenate(found, axis=1)
        return result

    def reflected(self, direction: NDArray) -> tuple[NDArray, NDArray]:
        """BRDF times cosine [n, 3] for light from unit directions [n, 3], and the density of `sample` [n].

        Light is cut at the geometric horizon and at that of the shading normal.
        """
        n = len(direction)
        value, density = np.zeros((n, 3)), np.zeros(n)
        for group in self._groups:
            at = group.at
            light: Vectors = (direction[at, 0:1], direction[at, 1:2], direction[at, 2:3])
            cosine = dot(self._vertices.shading_normal[at], light)[:, 0]
            above = (cosine > 0) & (dot(self._vertices.geometric_normal[at], light)[:, 0] > 0)
            for term, share in zip(group.terms, group.share, strict=True):
                scalar = term.values(light)[:, 0]
                density[at] += share * _density(term, scalar, cosine)
                weight = np.where(above, scalar * (cosine if term.cosine else 1.0), 0.0)
                value[at] += weight[:, None] * term.colour
        return value, density

    def _lobe(self, term: Term, at: NDArray) -> tuple[NDArray, NDArray]:
        """Axis [m, 3] and exponent [m] of the lobe that the term's directions are distributed as."""
        if isinstance(term, Lobe):
            return term.axis, term.exponent
        return self._vertices.shading_normal[at], np.ones(len(at))


def _density(term: Term, value: NDArray, cosine: NDArray) -> NDArray:
    """Per steradian, [m], where the term's scalar function has the given `value`."""
    if isinstance(term, Diffuse):
        return np.maximum(cosine, 0.0) / np.pi
    integral = term.integral()
    return np.divide(value, integral, out=np.zeros_like(value), where=integral > 0)


def _reflected(term: Term) -> NDArray | float:
    """Light that the term reflects of uniform light 1, without colour; about, for lobes."""
    return np.pi if isinstance(term, Diffuse) else term.integral()
