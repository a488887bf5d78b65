"""How far a picture is from a reference, pixel by pixel: numbers over any set of pixels, each by its formula.

I is the picture, R the reference, both linear and float64 [pixels, channels]; means and sums run over pixels
that show a surface and over all channels together.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError

FORMULAS = {
    "relative_rmse": "sqrt(mean((I − R)²)) / mean(R)",
    "mean_abs": "mean(|I − R|) / mean(R)",
    "bias": "mean(I − R) / mean(R)",
    "max_abs": "max(|I − R|) / mean(R)",
    "noise": "sqrt(mean(variance of R)) / mean(R)",
}

NOISE_MARGIN = 1.1  # on an RMSE over a whole image, whose own statistical error is below a per cent


@dataclass(frozen=True)
class Errors:
    """Differences between an image and a reference, in units of the reference's mean.

    Attributes
    ----------
    relative_rmse, mean_abs, bias, max_abs : float
        See `FORMULAS`; 0 where both images are black, None where only the reference is.
    noise : float
        The relative RMSE that the reference's own noise causes: what a perfect image would show.
    pixels : int
        Number of pixels compared.
    """

    relative_rmse: float | None
    mean_abs: float | None
    bias: float | None
    max_abs: float | None
    noise: float | None
    pixels: int


def compare(
    image: NDArray,
    reference: NDArray,
    variance: NDArray,
    what: str = "image",
    scale: float | None = None,
) -> Errors:
    """Errors of `image` against `reference`, whose means have `variance`; all [pixels, channels].

    `scale` takes the place of mean(R), where the pixels are a part whose own mean may be 0.

    Raises
    ------
    CoslobeError
        A value is NaN or infinite; `what` names the image in the message.
    """
    image, reference, variance = (np.asarray(a, np.float64) for a in (image, reference, variance))
    require_finite(image, what)
    require_finite(reference, f"reference of {what}")
    require_finite(variance, f"variance of the reference of {what}")
    difference = image - reference
    pixels = len(reference)
    if pixels == 0:
        return Errors(None, None, None, None, None, 0)
    unit = float(np.mean(reference)) if scale is None else scale
    return Errors(
        relative_rmse=ratio(np.sqrt(np.mean(difference**2)), unit),
        mean_abs=ratio(np.mean(np.abs(difference)), unit),
        bias=ratio(np.mean(difference), unit),
        max_abs=ratio(np.max(np.abs(difference)), unit),
        noise=ratio(np.sqrt(np.mean(variance)), unit),
        pixels=pixels,
    )


def within_noise(relative_rmse: float | None, noise: float | None) -> bool:
    """Whether a difference is no larger than what the reference's noise alone may cause."""
    return relative_rmse is not None and noise is not None and relative_rmse <= NOISE_MARGIN * noise


def without_noise(relative_rmse: float, noise: float) -> float:
    """The relative RMSE against a reference without noise: squares add up, as the two are independent."""
    return float(np.sqrt(max(relative_rmse**2 - noise**2, 0.0)))


def ratio(value: np.floating | float, scale: float) -> float | None:
    """`value` over `scale`; of a black scale 0 where the value is 0, too, and else None."""
    if scale > 0:
        return float(value / scale)
    return 0.0 if value == 0 else None


def require_finite(values: NDArray, what: str) -> None:
    """Raise where a value is NaN or infinite: such a pixel would make every mean meaningless."""
    bad = np.argwhere(~np.isfinite(values))
    if len(bad):
        where = ", ".join(str(i) for i in bad[0])
        raise CoslobeError(
            f"{what}: {len(bad)} values are not finite, the first at [{where}]",
            "this is a defect of coslobe: please report it with the scene file",
        )
