"""Direct light: directions of the light and of sharp lobes, each used where it is good."""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.brdf import Lobe, Term, Vectors, brdf_terms, dot
from coslobe.evaluate.integration import Estimate, integrate, pair_moments, uniform
from coslobe.evaluate.occlusion import Occluders, Segments, entry_distance
from coslobe.evaluate.sampling import Caps, Strata, light_caps, light_measure, square_to_cap, square_to_lobe

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Scene

SHARP = 0.2
"""Lobes get directions of their own up to this width, in widths of the light's cap (by solid angle).
Measured: the strata of the light resolve broader ones as well, with half of the rays."""


def direct_light(
    scene: "Scene",
    gbuffer: "GBuffer",
    occluders: Occluders,
    grid: Strata,
    seed: tuple[int, ...],
    progress: Progress = SILENT,
    name: str = "reference",
) -> Estimate:
    """Radiance of every shaded point from all lights, with the same grid of samples everywhere.

    Random numbers depend on `seed` and the point only, not on the number of threads.
    """
    sources = direct_sources(scene, gbuffer, occluders)
    choice = uniform(grid, len(sources), len(gbuffer.position))
    return integrate(sources, gbuffer.material, choice, seed, name, progress)[0]


def direct_sources(scene: "Scene", gbuffer: "GBuffer", occluders: Occluders) -> "list[DirectLight]":
    """One per light of the scene, in its order."""
    return [DirectLight(scene, gbuffer, occluders, index) for index in range(len(scene.lights))]


class DirectLight:
    """Light that comes straight from one light: a `Source` of `integrate`.

    The mean of f cos V L over the light's cap times its solid angle. A lobe that is sharp beside the cap also
    gets directions that are distributed as it is; both kinds are combined by multiple importance sampling
    with the power heuristic (Veach and Guibas 1995).
    """

    cost = 1.0
    decay = 1.5  # the edge of a shadow crosses sqrt(n) of n strata

    def __init__(self, scene: "Scene", gbuffer: "GBuffer", occluders: Occluders, index: int) -> None:
        self._gbuffer = gbuffer
        self._occluders = occluders
        self._index = index
        self._light = list(scene.lights.values())[index].sphere
        self._center = np.asarray(self._light.center, np.float64)
        self._materials = list(scene.materials.values())

    def estimate(self, points: NDArray, grid: Strata, rng: np.random.Generator) -> Estimate:
        """The light on points of one material."""
        gbuffer, radius = self._gbuffer, self._light.radius
        radiance, variance = np.zeros((2, len(points), 3))
        offset = self._center - gbuffer.position[points]
        height = np.einsum("ij,ij->i", offset, gbuffer.geometric_normal[points])
        lit = np.flatnonzero(height > -radius)  # elsewhere the light is wholly below the horizon
        if len(lit) == 0:
            return Estimate(radiance, variance)
        at, offset = points[lit], offset[lit]
        position = gbuffer.position[at]
        geometric, shading = gbuffer.geometric_normal[at], gbuffer.shading_normal[at]
        caps = light_caps(position, geometric, self._center, radius)
        terms = brdf_terms(self._materials[gbuffer.material[at[0]]], gbuffer, at)
        for part in _parts(terms, caps, offset, radius, grid, rng):
            directions = part.directions
            cosine = np.maximum(dot(shading, directions), 0.0)
            wanted = (cosine > 0) & (dot(geometric, directions) > 0)
            if part.beyond:
                wanted &= dot(caps.axis, directions) >= 1 - caps.height[:, None]
            reach = entry_distance(position, directions, self._center, radius)
            owner = gbuffer.object[at]
            place = (self._index, self._center, radius)
            segments = Segments(position, geometric, owner, *place, directions, reach, wanted)
            wanted &= ~self._occluders.blocked(segments)
            lit_cosine = np.where(wanted, cosine, 0.0)
            mean, covariance = pair_moments(
                np.stack([value * (lit_cosine if term.cosine else wanted) for term, value in part.terms])
            )
            colours = np.stack([term.colour for term, _ in part.terms]) * self._light.emission()
            radiance[lit] += part.measure[:, None] * np.einsum("kp,kpc->pc", mean, colours)
            variance[lit] += part.measure[:, None] ** 2 * np.einsum(
                "klp,kpc,lpc->pc", covariance, colours, colours
            )
        return Estimate(radiance, variance)


@dataclass(frozen=True)
class _Part:
    """Terms of a BRDF that share their directions.

    Attributes
    ----------
    terms : list of (term, [n, s])
        With the term's scalar function over the density of the directions times `measure`, weighted.
    directions : x, y, z of [n, s]
    measure : float64 [n]
        What a mean over the directions stands for.
    beyond : bool
        Directions may miss the light.
    """

    terms: "list[tuple[Term, NDArray]]"
    directions: Vectors
    measure: NDArray
    beyond: bool


def _parts(
    terms: list[Term], caps: Caps, to_light: NDArray, radius: float, grid: Strata, rng: np.random.Generator
) -> Iterator[_Part]:
    """Directions of the light for all terms, and its own for each lobe that is sharp beside the light.

    With q = density of the lobe's directions / density of the light's, the power heuristic gives the light's
    the weight 1 / (1 + q^2), and the lobe's q^2 / (1 + q^2).
    """
    n = len(to_light)
    measure = light_measure(caps, to_light, radius)
    sharp = [term for term in terms if isinstance(term, Lobe) and radius > 0 and _is_sharp(term, caps)]
    directions = square_to_cap(*grid.jittered(rng, n), caps)
    values = [(term, term.values(directions)) for term in terms]
    weighted = [
        (term, value / (1 + _ratio(term, value, measure) ** 2) if term in sharp else value)
        for term, value in values
    ]
    yield _Part(weighted, directions, measure, beyond=False)
    for lobe in sharp:
        directions = square_to_lobe(*grid.jittered(rng, n), lobe.axis, lobe.exponent)
        squared = _ratio(lobe, lobe.values(directions), measure) ** 2
        yield _Part([(lobe, squared / (1 + squared))], directions, lobe.integral(), beyond=True)


def _is_sharp(lobe: Lobe, caps: Caps) -> bool:
    return bool(np.mean(1 / (lobe.exponent + 1)) < SHARP * np.mean(caps.height))


def _ratio(term: Term, value: NDArray, measure: NDArray) -> NDArray:
    """Density of the lobe's own directions over the light's, which is 1 / measure within the cap."""
    assert isinstance(term, Lobe)
    integral = term.integral()
    scale = np.divide(measure, integral, out=np.zeros_like(measure), where=integral > 0)
    return value * scale[:, None]
