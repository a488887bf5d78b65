"""Samples where the noise is: an image of a given standard error at the least cost, without bias.

A pilot with few samples measures the variance of every source at every point. From it follow the numbers of
samples that reach the wanted error most cheaply. The image is then made of new samples: which numbers were
chosen does not depend on them, so every pixel stays an unbiased mean. Where the image's error still is above
what was asked for, its variances are the pilot of the next round, and its samples are dropped as well: one
pattern of n strata is worth more than several small ones. Only whether there is another round depends on the
kept samples, through their variance averaged over the whole image.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.checkpoint import NO_CHECKPOINT, Checkpoint
from coslobe.evaluate.integration import Choice, Estimate, Source, integrate, uniform
from coslobe.evaluate.sampling import strata

PILOT = 32
"""Samples of every source in the pilot, shared by the points of a pixel."""

FEWEST = 8
"""Samples at least: a point where the pilot found no variance may have some."""

NEIGHBOURS = 64
"""Points of a tile of pixels: what one of them missed in the pilot, others have found."""

SAFETY = 0.8
"""Part of the allowed variance that is aimed at, so that one round is mostly enough."""

ROUNDS = 8
"""Rounds at most: each at least doubles the samples of the points that matter."""


@dataclass(frozen=True)
class Goal:
    """When an image is good enough.

    Attributes
    ----------
    error : float
        Root mean square of the pixels' standard errors, over the mean of the image.
    most : int
        Samples at most per source and point; where they do not suffice, the error stays larger.
    pixels : int
        Pixels that the points belong to.
    """

    error: float
    most: int
    pixels: int

    def allowed_variance(self, radiance: NDArray) -> float:
        """Sum over points and channels of the variances at which the error is reached.

        With s points per pixel, its variance is the sum over its points over s^2, its radiance the sum
        over s: s cancels.
        """
        return (self.error * float(radiance.sum())) ** 2 / (3 * self.pixels)


def integrate_adaptively(
    sources: Sequence[Source],
    material: NDArray,
    goal: Goal,
    seed: tuple[int, ...],
    name: str,
    progress: Progress = SILENT,
    checkpoint: Checkpoint = NO_CHECKPOINT,
) -> tuple[Estimate, Choice]:
    """As `integrate`, with as many samples as `goal` needs; returns what they were, too."""
    points = max(len(material) // max(goal.pixels, 1), 1)  # of a pixel
    few = strata(min(max(PILOT // points, FEWEST), goal.most))
    choice = uniform(few, len(sources), len(material))
    pilot = (*seed, 0), f"{name}: pilot", progress, checkpoint
    estimate, spread = integrate(sources, material, choice, *pilot)
    costs, decays = (np.array([getattr(source, key) for source in sources]) for key in ("cost", "decay"))
    for number in range(1, ROUNDS + 1):
        allowed = goal.allowed_variance(estimate.radiance)
        choice = allocate(spread, choice.samples, costs, decays, SAFETY * allowed, goal.most)
        mean = choice.samples.mean() if choice.which.size else 0
        text = f"{name}: {mean:.0f} samples per point" + (f", round {number}" if number > 1 else "")
        estimate, spread = integrate(sources, material, choice, (*seed, number), text, progress, checkpoint)
        allowed = goal.allowed_variance(estimate.radiance)
        exhausted = bool((choice.samples == choice.grids[-1].samples)[spread > 0].all())
        if estimate.variance.sum() <= allowed or exhausted:
            break
    return estimate, choice


def allocate(
    spread: NDArray, samples: NDArray, costs: NDArray, decays: NDArray, allowed: float, most: int
) -> Choice:
    """The cheapest numbers of samples, powers of two, whose variances add up to what is `allowed`.

    Parameters
    ----------
    spread, samples : float [sources, n]
        Variances found, and with how many samples.
    costs, decays : float64 [sources]
        Of one sample; the variance of n samples is taken to fall as n^-decay.
    allowed : float
        Sum of all variances.
    most : int
        Samples at most.

    Notes
    -----
    The sum of cost n under a given sum of c n^-p is least where p c n^(-p-1) / cost is the same everywhere
    (Lagrange), so that n is proportional to (p c / cost)^(1 / (p+1)).
    """
    grids = tuple(strata(2**k) for k in range(int(np.log2(FEWEST)), max(int(np.log2(most)), 3) + 1))
    p = np.broadcast_to(decays[:, None], spread.shape)
    c = _smooth(spread.astype(np.float64)) * samples**p
    slope = np.power(p * c / costs[:, None], 1 / (p + 1))
    power = np.log2(slope, where=slope > 0, out=np.full(slope.shape, -np.inf))
    least, last = int(np.log2(grids[0].samples)), len(grids) - 1

    def at(level: float, p_plus_1: NDArray = p + 1) -> tuple[NDArray, float]:
        which = np.clip(np.rint(power + level / p_plus_1) - least, 0, last).astype(np.int8)
        return which, float((c * np.exp2(-p * (which + least))).sum())

    low, high = -200.0, 200.0  # in octaves of the Lagrange multiplier
    for _ in range(14):
        middle = (low + high) / 2
        low, high = (low, middle) if at(middle)[1] <= allowed else (middle, high)
    return Choice(grids, at(high)[0])


def _smooth(spread: NDArray) -> NDArray:
    """Half a point's own variance and half the mean of its tile: a single one is known badly."""
    n = spread.shape[1]
    if n == 0:
        return spread
    starts = np.arange(0, n, NEIGHBOURS)
    sizes = np.minimum(NEIGHBOURS, n - starts)
    means = np.add.reduceat(spread, starts, axis=1) / sizes
    return (spread + np.repeat(means, sizes, axis=1)) / 2
