"""What the numbers of an evaluation say, in words, each with a grade."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from coslobe.evaluate.errors import within_noise, without_noise
from coslobe.evaluate.split import PARTS, shares

LIGHT_GRADES = (0.005, 0.02)
"""Relative RMSE against the same spheres, without the reference's noise, up to which it is good, and fair."""

SHAPE_GRADES = (0.04, 0.08)
"""The same against the true meshes."""

BIAS_GRADES = (0.01, 0.03)
"""Bias against the true meshes, either sign."""


LOCAL_GRADES = (0.03, 0.08)
"""Largest mean error of 5 x 5 pixels against the same spheres, beyond twice what the reference's noise shows:
a largest value scatters, and so does the variance that predicts it."""


@dataclass(frozen=True)
class Verdict:
    """One statement: a title, a grade (good, fair, poor, or info where nothing is judged), and its reason."""

    title: str
    grade: str
    text: str


def percent(value: float | None) -> str:
    """A share as text with two significant digits, but no more than two decimals: "0.21 %", "-12 %"."""
    if value is None:
        return "–"
    shown = float(f"{100 * value:.2g}")
    text = f"{shown:.{2 if abs(shown) < 1 else 1 if abs(shown) < 10 else 0}f}"
    text = text.replace("-0.00", "0.00").replace("-", "−")
    return f"{text}\N{NO-BREAK SPACE}%"


def verdicts(mean: dict[str, Any], frames: Sequence[dict[str, Any]]) -> list[Verdict]:
    """Statements about an evaluation from its `mean` over all frames and its frame records.

    A fault of the light integration turns the first or the second of them to "poor": one that is everywhere
    shows in the relative RMSE, one that is in a single place in the largest error of a neighbourhood.
    """
    light, shape = mean["relative_rmse_spheres"], mean["relative_rmse_mesh"]
    bias, noise = mean["bias_mesh"], mean["noise_spheres"]
    if light is None or shape is None or bias is None or noise is None:
        return [Verdict("Nothing to judge", "info", "No pixel of the reference shows a lit surface.")]
    found = [
        _light_verdict(light, noise),
        *_local_verdicts(frames),
        Verdict(
            _by_grade(shape, SHAPE_GRADES, "Spheres stand {} for the meshes", ("well", "roughly", "badly")),
            _grade(shape, SHAPE_GRADES),
            f"Against the true meshes, pictures are off by {percent(shape)} (relative RMSE).",
        ),
        *_split_verdicts(mean, frames),
        Verdict(
            _by_grade(abs(bias), BIAS_GRADES, "Brightness is {}", ("right", "slightly off", "off")),
            _grade(abs(bias), BIAS_GRADES),
            f"Summed over the picture, there is {percent(abs(bias))} too "
            f"{'much' if bias > 0 else 'little'} light compared with the true meshes.",
        ),
    ]
    return found + _time_verdicts(frames)


def _grade(value: float, limits: tuple[float, float]) -> str:
    good, fair = limits
    return "good" if value <= good else "fair" if value <= fair else "poor"


def _by_grade(value: float, limits: tuple[float, float], text: str, words: tuple[str, str, str]) -> str:
    return text.format(words[("good", "fair", "poor").index(_grade(value, limits))])


def _local_verdicts(frames: Sequence[dict[str, Any]]) -> list[Verdict]:
    """Of the frame with the largest error in one place."""
    judged = [
        (frame["local_max_spheres"] - 2 * (frame["noise_floor"]["spheres"]["local_max"] or 0.0), frame)
        for frame in frames
        if frame["local_max_spheres"] is not None
    ]
    if not judged:
        return []
    excess, frame = max(judged, key=lambda pair: pair[0])
    value, floor = frame["local_max_spheres"], frame["noise_floor"]["spheres"]["local_max"]
    return [
        Verdict(
            _by_grade(
                excess, LOCAL_GRADES, "{}", ("No place stands out", "A place stands out", "A place is wrong")
            ),
            _grade(excess, LOCAL_GRADES),
            f"Over 5 × 5 pixels, frame {frame['index']} is off by up to {percent(value)} of the picture's "
            f"mean against the same spheres; the reference's noise alone reaches {percent(floor)}.",
        )
    ]


_CAUSES = {
    "geometry": "spheres in place of meshes",
    "visibility": "the bit masks",
    "lobes": "lobes and tables",
}


def _split_verdicts(mean: dict[str, Any], frames: Sequence[dict[str, Any]]) -> list[Verdict]:
    """Which part of the error dominates, in the picture and in each zone."""
    share = shares(mean["split"])
    if share is None:
        return []
    first = max(PARTS, key=lambda part: share[part])
    sizes = ", ".join(f"{_CAUSES[part]} {percent(mean['split'][part])}" for part in PARTS)
    found: dict[str, list[str]] = {}
    for zone in dict.fromkeys(name for frame in frames for name in frame["zones"]):
        parts = [frame["zones"][zone]["split"] for frame in frames if zone in frame["zones"]]
        sums = {part: sum((numbers[part] or 0.0) ** 2 for numbers in parts) ** 0.5 for part in PARTS}
        own = shares(sums)
        if own is not None:
            largest = max(PARTS, key=lambda part, own=own: own[part])
            found.setdefault(largest, []).append(f"{_ZONE_WORDS[zone]} ({percent(own[largest])})")
    zones = "; ".join(f"{_CAUSES[part]} {' and '.join(where)}" for part, where in found.items())
    text = f"Without noise: {sizes}, as root mean squares. Of the squared error, most comes from {zones}."
    return [Verdict(f"Most of the error comes from {_CAUSES[first]}", "info", text)]


_ZONE_WORDS = {"lit": "where it is lit", "penumbra": "in penumbra", "umbra": "in umbra"}


def _light_verdict(light: float, noise: float) -> Verdict:
    start = f"Against a reference with the same spheres, pictures are off by {percent(light)} (relative RMSE)"
    if within_noise(light, noise):
        text = f"{start}, no more than the reference's own noise of {percent(noise)} explains."
        if noise <= LIGHT_GRADES[0]:
            return Verdict("Light is integrated accurately", "good", text)
        text += " More samples (--spp) would show how much smaller the true error is."
        return Verdict("The reference is too noisy to judge the light", "info", text)
    own = without_noise(light, noise)
    return Verdict(
        _by_grade(own, LIGHT_GRADES, "Light is integrated {}", ("accurately", "roughly", "badly")),
        _grade(own, LIGHT_GRADES),
        f"{start}. The reference's own noise is {percent(noise)}; without it, {percent(own)} would be left.",
    )


def _time_verdicts(frames: Sequence[dict[str, Any]]) -> list[Verdict]:
    timed = [frame for frame in frames if frame["kernel_seconds"] and frame["reference_seconds_mesh"]]
    if not timed:
        return []
    kernel = sum(frame["kernel_seconds"] for frame in timed) / len(timed)
    reference = sum(frame["reference_seconds_mesh"] for frame in timed) / len(timed)
    text = (
        f"Per frame, the light kernels took {duration(kernel)}, the reference on the true meshes "
        f"{duration(reference)} for its {timed[0]['spp']} samples per pixel: {reference / kernel:,.0f} times "
        "as long, at its own, lower error."
    )
    return [Verdict("Time", "info", text)]


def own_error(own: float | None, noise: float | None) -> str:
    """An error without noise as text; 0 is what cannot be told from it."""
    return f"below the noise ({percent(noise)})" if own == 0 else percent(own)


def counted(n: int, what: str) -> str:
    """ "1 frame", "2 frames"."""
    return f"{n} {what}" if n == 1 else f"{n} {what}s"


def duration(seconds: float | None) -> str:
    """A time as text: milliseconds below one second."""
    if seconds is None:
        return "–"
    return f"{1000 * seconds:.3g} ms" if seconds < 1 else f"{seconds:.3g} s"
