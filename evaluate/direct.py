"""Direct light by Monte Carlo integration: unbiased, with the variance of every mean."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import cpu_count
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.brdf import Lobe, Term, Vectors, brdf_terms, dot
from coslobe.evaluate.occlusion import Occluders, Segments, entry_distance
from coslobe.evaluate.sampling import Caps, Strata, light_caps, square_to_cap, square_to_lobe

if TYPE_CHECKING:
    from coslobe.render.gbuffer import GBuffer
    from coslobe.render.scene import Material, Scene, SphereLight

BLOCK = 1 << 15
"""Samples that are worked on at once: small enough for the caches of a core."""

BLOCK_POINTS = 256
"""Points at most in a block: what is made per point and sphere stays small, too."""


@dataclass(frozen=True)
class Estimate:
    """Means over samples and how far they may be off.

    Attributes
    ----------
    radiance : float64 [n, 3]
        Towards the viewer.
    variance : float64 [n, 3]
        An unbiased estimate of the variance of `radiance` (of the mean, not of one sample).
    """

    radiance: NDArray
    variance: NDArray


def direct_light(
    scene: "Scene",
    gbuffer: "GBuffer",
    occluders: Occluders,
    grid: Strata,
    seed: tuple[int, ...],
    progress: Progress = SILENT,
    name: str = "reference",
) -> Estimate:
    """Radiance of every shaded point: per light, the mean of f cos V L over the cap times its solid angle.

    A lobe that is narrower than the light's cap gets directions of its own, distributed as the lobe is.
    Random numbers depend on `seed` and the point only, not on the number of threads.
    """
    materials = list(scene.materials.values())
    lights = [light.sphere for light in scene.lights.values()]
    blocks = list(_blocks(gbuffer, grid.samples))
    radiance = np.zeros_like(gbuffer.position)
    variance = np.zeros_like(gbuffer.position)

    def work(task: tuple[int, NDArray]) -> Estimate:
        number, points = task
        rng = np.random.default_rng((*seed, number))
        material = materials[gbuffer.material[points[0]]]
        return _block_light(gbuffer, points, material, lights, occluders, grid, rng)

    with progress.task(name, len(gbuffer.position)) as advance:
        for points, estimate in zip(blocks, _parallel(work, enumerate(blocks)), strict=True):
            radiance[points], variance[points] = estimate.radiance, estimate.variance
            advance(len(points))
    return Estimate(radiance, variance)


def _blocks(gbuffer: "GBuffer", samples: int) -> Iterator[NDArray]:
    """Indices of neighbouring points of the same material, about BLOCK samples' worth at a time."""
    count = min(max(BLOCK // samples, 1), BLOCK_POINTS)
    for material in np.unique(gbuffer.material):
        points = np.flatnonzero(gbuffer.material == material)
        yield from np.array_split(points, range(count, len(points), count))


def _parallel(function: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterator[Any]:
    """Results in the order of the tasks, computed by one thread per CPU; NumPy and Embree free the others."""
    executor = ThreadPoolExecutor(cpu_count())
    try:
        yield from executor.map(function, tasks)
    finally:
        executor.shutdown(cancel_futures=True)


def _block_light(
    gbuffer: "GBuffer",
    points: NDArray,
    material: "Material",
    lights: "list[SphereLight]",
    occluders: Occluders,
    grid: Strata,
    rng: np.random.Generator,
) -> Estimate:
    """The light on points of one material."""
    radiance = np.zeros((len(points), 3))
    variance = np.zeros((len(points), 3))
    for index, light in enumerate(lights):
        center = np.asarray(light.center, np.float64)
        height = np.einsum("ij,ij->i", center - gbuffer.position[points], gbuffer.geometric_normal[points])
        lit = np.flatnonzero(height > -light.radius)  # elsewhere the light is wholly below the horizon
        if len(lit) == 0:
            continue
        at = points[lit]
        position = gbuffer.position[at]
        geometric, shading = gbuffer.geometric_normal[at], gbuffer.shading_normal[at]
        caps = light_caps(position, geometric, center, light.radius)
        for part in _parts(
            brdf_terms(material, gbuffer, at), caps, center - position, light.radius, grid, rng
        ):
            directions = part.directions
            cosine = np.maximum(dot(shading, directions), 0.0)
            wanted = (cosine > 0) & (dot(geometric, directions) > 0)
            if part.beyond:
                wanted &= dot(caps.axis, directions) >= 1 - caps.height[:, None]
            reach = entry_distance(position, directions, center, light.radius)
            segments = Segments(
                position,
                geometric,
                gbuffer.object[at],
                index,
                center,
                light.radius,
                directions,
                reach,
                wanted,
            )
            wanted &= ~occluders.blocked(segments)
            values = [
                value * np.where(wanted, cosine if term.cosine else 1.0, 0.0) for term, value in part.terms
            ]
            mean, covariance = _moments(values)
            colours = np.stack([term.colour for term, _ in part.terms]) * light.emission()
            radiance[lit] += part.measure[:, None] * np.einsum("pk,kpc->pc", mean, colours)
            variance[lit] += part.measure[:, None] ** 2 * np.einsum(
                "pkl,kpc,lpc->pc", covariance, colours, colours
            )
    return Estimate(radiance, variance)


@dataclass(frozen=True)
class _Part:
    """Terms of a BRDF that share their directions.

    Attributes
    ----------
    terms : list of (term, [n, s] or a number)
        With the term's scalar function over the density of the directions times `measure`.
    directions : x, y, z of [n, s]
    measure : float64 [n]
        What a mean over the directions stands for.
    beyond : bool
        Directions may miss the light.
    """

    terms: "list[tuple[Term, NDArray | float]]"
    directions: Vectors
    measure: NDArray
    beyond: bool


def _parts(
    terms: list[Term], caps: Caps, to_light: NDArray, radius: float, grid: Strata, rng: np.random.Generator
) -> Iterator[_Part]:
    """Directions of the light for broad terms, and its own for each lobe narrower than the light."""
    n = len(to_light)
    narrow = [
        term
        for term in terms
        if isinstance(term, Lobe) and radius > 0 and np.mean(1 / (term.exponent + 1)) < np.mean(caps.height)
    ]
    directions = square_to_cap(*grid.jittered(rng, n), caps)
    broad: list[tuple[Term, NDArray | float]] = [
        (term, term.values(directions)) for term in terms if term not in narrow
    ]
    yield _Part(broad, directions, _measure(caps, to_light, radius), beyond=False)
    for lobe in narrow:
        directions = square_to_lobe(*grid.jittered(rng, n), lobe.axis, lobe.exponent)
        yield _Part([(lobe, 1.0)], directions, lobe.integral(), beyond=True)


def _measure(caps: Caps, to_light: NDArray, radius: float) -> NDArray:
    """What the mean over the samples stands for: the cap's solid angle, or 1 / d^2 for a point light."""
    if radius > 0:
        return 2 * np.pi * caps.height
    return 1 / np.maximum(np.einsum("ij,ij->i", to_light, to_light), np.finfo(float).tiny)


def _moments(values: list[NDArray]) -> tuple[NDArray, NDArray]:
    """Means [n, k] of the k functions sampled as [n, s], and the covariance of these means [n, k, k].

    Samples i and i + s/2 share a stratum. In a stratum with the difference d, the mean of the two has the
    variance d^2 / 4 in expectation, and the mean over all s/2 strata the sum of these over (s/2)^2.
    """
    strata = values[0].shape[1] // 2
    means = np.stack([value.mean(axis=1) for value in values], axis=-1)
    differences = np.stack([value[:, :strata] - value[:, strata:] for value in values])
    return means, np.einsum("kns,lns->nkl", differences, differences) / (4 * strata * strata)
