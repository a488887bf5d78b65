"""Monte Carlo integration over many points: work in blocks on all CPUs, with the variance of every mean."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import cpu_count
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.checkpoint import NO_CHECKPOINT, Checkpoint
from coslobe.evaluate.sampling import Strata

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


class Source(Protocol):
    """Where light comes from: one light, or all surfaces.

    Attributes
    ----------
    cost : float
        Of one sample, in light samples.
    decay : float
        The variance of a mean of n stratified samples falls about as n^-decay.
    """

    cost: float
    decay: float

    def estimate(self, points: NDArray, grid: Strata, rng: np.random.Generator) -> Estimate:
        """The light from this source on `points` of one material, each with a grid of samples of its own."""
        ...


@dataclass(frozen=True)
class Choice:
    """How many samples every source gets at every point.

    Attributes
    ----------
    grids : tuple of Strata
        The numbers to choose from.
    which : int8 [sources, n]
        Index of the grid.
    """

    grids: tuple[Strata, ...]
    which: NDArray

    @property
    def samples(self) -> NDArray:
        """Number of samples, float64 [sources, n]."""
        return np.array([grid.samples for grid in self.grids], np.float64)[self.which]


def uniform(grid: Strata, sources: int, points: int) -> Choice:
    """The same grid everywhere."""
    return Choice((grid,), np.zeros((sources, points), np.int8))


def integrate(
    sources: Sequence[Source],
    material: NDArray,
    choice: Choice,
    seed: tuple[int, ...],
    name: str,
    progress: Progress = SILENT,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> tuple[Estimate, NDArray]:
    """The sum over all sources at points of the given `material` (index, [n]).

    Random numbers depend on `seed` and the points only, not on the number of threads, and not on whether the
    work was interrupted: `checkpoint` keeps what was done under `name`.

    Returns
    -------
    estimate : Estimate
    spread : float32 [sources, n]
        The variance of each source, summed over the channels.
    """
    n = len(material)
    blocks = list(_blocks(choice, material))
    sums = {
        "radiance": np.zeros((n, 3)),
        "variance": np.zeros((n, 3)),
        "spread": np.zeros((len(sources), n), np.float32),
    }
    done = checkpoint.restore(name, sums)
    costs = [sources[block.source].cost * block.grid.samples * len(block.points) for block in blocks]

    def work(number: int) -> Estimate:
        block = blocks[number]
        rng = np.random.default_rng((*seed, number))
        return sources[block.source].estimate(block.points, block.grid, rng)

    with progress.task(name, sum(costs)) as advance:
        advance(sum(costs[:done]))
        numbers = range(done, len(blocks))
        for number, estimate in zip(numbers, _parallel(work, numbers), strict=True):
            block = blocks[number]
            sums["radiance"][block.points] += estimate.radiance
            sums["variance"][block.points] += estimate.variance
            sums["spread"][block.source, block.points] = estimate.variance.sum(axis=1)
            checkpoint.keep(name, sums, number + 1, last=number + 1 == len(blocks))
            advance(costs[number])
    return Estimate(sums["radiance"], sums["variance"]), sums["spread"]


@dataclass(frozen=True)
class _Block:
    source: int
    grid: Strata
    points: NDArray


def _blocks(choice: Choice, material: NDArray) -> Iterator[_Block]:
    """Neighbouring points of one material and as many samples, about BLOCK samples' worth at a time."""
    for source, which in enumerate(choice.which):
        for index, grid in enumerate(choice.grids):
            count = min(max(BLOCK // grid.samples, 1), BLOCK_POINTS)
            chosen = np.flatnonzero(which == index)
            for kind in np.unique(material[chosen]):
                points = chosen[material[chosen] == kind]
                for part in np.array_split(points, range(count, len(points), count)):
                    yield _Block(source, grid, part)


def _parallel(function: Callable[[Any], Any], tasks: Iterable[Any]) -> Iterator[Any]:
    """Results in the order of the tasks, computed by one thread per CPU; NumPy and Embree free the others."""
    executor = ThreadPoolExecutor(cpu_count())
    try:
        yield from executor.map(function, tasks)
    finally:
        executor.shutdown(cancel_futures=True)


def pair_moments(values: NDArray) -> tuple[NDArray, NDArray]:
    """Means [k, n] of functions sampled as [k, n, s], and the covariance of these means [k, k, n].

    Samples i and i + s/2 share a stratum. In a stratum with the difference d, the mean of the two has the
    variance d^2 / 4 in expectation, and the mean over all s/2 strata the sum of these over (s/2)^2.
    """
    strata = values.shape[-1] // 2
    first, second = values[..., :strata], values[..., strata:]
    differences = first - second
    covariance = np.einsum("kns,lns->kln", differences, differences) / (4 * strata * strata)
    return values.mean(axis=-1), covariance
