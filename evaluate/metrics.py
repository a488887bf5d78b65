"""Every error measure of a picture, over any of its regions, each beside that of a perfect picture.

A picture's errors are worked out once as maps; a region's are means over its pixels.
"""

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.evaluate import errors
from coslobe.evaluate.errors import NOISE_MARGIN, compare, require_finite
from coslobe.evaluate.reference import Reference
from coslobe.render.images import srgb

FORMULAS = {
    **{name: text for name, text in errors.FORMULAS.items() if name != "noise"},
    "local_max": "max |mean of I − R over 5 × 5 pixels| / mean(R)",
    "psnr": "−10 log₁₀ mean((S(I) − S(R))²) in dB; S is the sRGB curve at exposure 1, clipped to [0, 1]",
    "ssim": "mean structural similarity of S(I) and S(R) (Wang et al. 2004: Gaussian windows, σ = 1.5, "
    "K₁ = 0.01, K₂ = 0.03)",
    "flip": "mean HDR-FLIP (Andersson et al. 2021), 67 pixels per degree, exposures fixed for the sequence",
    "temporal": "sqrt(mean(((I′ − I) − (R′ − R))²)) / mean(R), where ′ is the frame before",
}

METRICS = tuple(FORMULAS)

HIGHER_IS_BETTER = ("psnr", "ssim")

LOCAL_PIXELS = 5

UNITS = {"psnr": "dB", "ssim": "", "flip": ""}
"""Units of the metrics that are no shares of the reference's mean."""


@dataclass(frozen=True)
class Before:
    """The frame before: its radiance [h, w, 3], and its reference."""

    image: NDArray
    reference: Reference


@dataclass(frozen=True)
class Maps:
    """Errors of one picture against one reference, pixel by pixel.

    Attributes
    ----------
    image, reference, variance : float64 [h, w, 3]
    local : float64 [h, w]
        I - R over all channels and 5 x 5 pixels, 0 off surfaces: what stands out is no single pixel.
    display : float64 [h, w, 3]
        Squared difference of the sRGB pictures.
    ssim, flip : float64 [h, w]
        None where they could not be had.
    temporal : float64 [h, w, 3] or None
        Difference of the changes since the frame before; None without one.
    """

    image: NDArray
    reference: NDArray
    variance: NDArray
    local: NDArray
    display: NDArray
    ssim: NDArray | None
    flip: NDArray | None
    temporal: NDArray | None


def error_maps(
    image: NDArray, reference: Reference, flip: NDArray | None, before: Before | None, what: str
) -> Maps:
    """The maps of `image` [h, w, 3]; `flip` [h, w] comes from `flip_maps`.

    Raises
    ------
    CoslobeError
        A value is NaN or infinite; `what` names the picture in the message.
    """
    require_finite(image, what)
    require_finite(reference.radiance, f"reference of {what}")
    shown, wanted = srgb(image), srgb(reference.radiance)
    temporal = None
    if before is not None:
        temporal = (before.image - image) - (before.reference.radiance - reference.radiance)
    return Maps(
        image,
        reference.radiance,
        reference.variance,
        _local((image - reference.radiance).mean(axis=-1) * reference.hit),
        (shown - wanted) ** 2,
        _ssim(shown, wanted),
        flip,
        temporal,
    )


def perfect(reference: Reference, seed: int) -> NDArray:
    """A picture without error as the reference's noise lets one see it: a second reference, [h, w, 3].

    Differences of samples that share a stratum give the variance of every pixel (`sampling`); this draws an
    error of that variance, the same in all channels, as visibility makes it.
    """
    noise = np.random.default_rng(seed).normal(size=reference.variance.shape[:2])
    return np.maximum(reference.radiance + np.sqrt(reference.variance) * noise[..., None], 0.0)


def measure(maps: Maps, region: NDArray, what: str, *, scale: float | None = None) -> dict[str, float | None]:
    """All `METRICS` over `region`, bool [h, w]; None for what cannot be had.

    `scale` takes the place of mean(R).
    """
    pixels = compare(maps.image[region], maps.reference[region], maps.variance[region], what, scale)
    result: dict[str, float | None] = {
        name: value for name, value in asdict(pixels).items() if name in FORMULAS
    }
    if not region.any():
        return dict.fromkeys(METRICS)
    display = float(maps.display[region].mean())
    unit = float(maps.reference[region].mean()) if scale is None else scale
    temporal = None
    if maps.temporal is not None:
        temporal = errors.ratio(np.sqrt(np.mean(maps.temporal[region] ** 2)), unit)
    return result | {
        "local_max": errors.ratio(np.abs(maps.local[region]).max(), unit),
        "psnr": -10 * float(np.log10(display)) if display > 0 else None,
        "ssim": None if maps.ssim is None else float(maps.ssim[region].mean()),
        "flip": None if maps.flip is None else float(maps.flip[region].mean()),
        "temporal": temporal,
    }


def noise_floor(
    maps: Maps, region: NDArray, what: str, before: Before | None, *, scale: float | None = None
) -> dict[str, float | None]:
    """What each metric would be for a perfect picture; `maps` are those of `perfect`.

    Those that are means of squares come from the variance itself, without drawing from it; the bias is one
    standard error of the mean.
    """
    drawn = measure(maps, region, what, scale=scale)
    if not region.any():
        return drawn
    variance, reference = maps.variance[region], maps.reference[region]
    unit = float(reference.mean()) if scale is None else scale
    changed = None if before is None else variance + before.reference.variance[region]
    deviation = np.sqrt(variance).mean(axis=1)  # channels err together
    return drawn | {
        "relative_rmse": errors.ratio(np.sqrt(np.mean(variance)), unit),
        "bias": errors.ratio(np.sqrt(np.sum(deviation**2)) / len(deviation), unit),
        "temporal": None if changed is None else errors.ratio(np.sqrt(np.mean(changed)), unit),
    }


def below_noise(metric: str, value: float | None, floor: float | None) -> bool:
    """Whether a value says no more than the reference's noise: nothing smaller can be told from no error."""
    if value is None or floor is None:
        return False
    if metric == "psnr":
        return value >= floor - 20 * float(np.log10(NOISE_MARGIN))
    if metric == "ssim":
        return 1 - value <= NOISE_MARGIN * (1 - floor)
    margin = 2 if metric == "bias" else NOISE_MARGIN  # a single number: two standard errors
    return abs(value) <= margin * abs(floor)


def _local(difference: NDArray) -> NDArray:
    from scipy.ndimage import uniform_filter

    return uniform_filter(difference, LOCAL_PIXELS, mode="constant")


def _ssim(shown: NDArray, wanted: NDArray) -> NDArray | None:
    """The map of the structural similarity; None for pictures smaller than its window."""
    from skimage.metrics import structural_similarity

    if min(shown.shape[:2]) < 11:
        return None
    found: tuple[Any, ...] = structural_similarity(
        wanted,
        shown,
        channel_axis=-1,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
        full=True,
    )
    return found[1].mean(axis=-1)
