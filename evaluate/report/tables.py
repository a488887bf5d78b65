"""The tables of a scene's report."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from coslobe.evaluate.metrics import METRICS, UNITS, below_noise
from coslobe.evaluate.report.page import Cell, Table
from coslobe.evaluate.split import PARTS, shares
from coslobe.evaluate.verdicts import duration, percent

Frames = Sequence[Mapping[str, Any]]
Formulas = Mapping[str, str]

NAMES = {
    "relative_rmse": "relative RMSE",
    "mean_abs": "mean |error|",
    "bias": "bias",
    "max_abs": "largest",
    "local_max": "largest, 5 × 5",
    "psnr": "PSNR",
    "ssim": "SSIM",
    "flip": "FLIP",
    "temporal": "temporal",
}

PIXELS = ("I, R", "picture and reference, linear, over all channels of the pixels that show a surface")


def error_table(frames: Frames, formulas: Formulas) -> Table:
    """Errors against both references, by frame and object."""
    rows, strong = [], set()
    for name, part, whole in _regions(frames, ("objects",)):
        if whole:
            strong.add(len(rows))
        rows.append(
            [
                name,
                _count(part["pixels"]),
                *(
                    cell
                    for kind in ("spheres", "mesh")
                    for cell in (
                        _metric(part, "relative_rmse", kind),
                        _share(part[f"noise_{kind}"], faint=True),
                        _metric(part, "bias", kind),
                    )
                ),
                _metric(part, "mean_abs", "mesh"),
                _metric(part, "max_abs", "mesh"),
            ]
        )
    shown = ("relative_rmse", "mean_abs", "bias", "max_abs")
    return Table(
        title="Errors",
        text="≈ marks a difference that is no larger than the reference's own noise.",
        groups=[("", 2), ("against the same spheres", 3), ("against the true meshes", 5)],
        columns=[
            "",
            "pixels",
            *("relative RMSE", "noise", "bias") * 2,
            "mean |error|",
            "largest",
        ],
        rows=rows,
        strong=frozenset(strong),
        notes=[
            *((NAMES[name], formulas[name]) for name in shown),
            ("noise", "relative RMSE of a perfect picture: sqrt(mean(variance of R)) / mean(R)"),
            PIXELS,
        ],
    )


def split_table(frames: Frames, formulas: Formulas) -> Table:
    """Where errors come from, by frame, zone and object."""
    rows, strong = [], set()
    for name, part, whole in _regions(frames, ("zones", "objects")):
        if whole:
            strong.add(len(rows))
        numbers, share = part["split"], shares(part["split"])
        largest = "–" if share is None else max(PARTS, key=lambda part, share=share: share[part])
        portion = Cell("–") if share is None else _share(share[largest])
        rows.append(
            [name, _count(part["pixels"]), *(_share(numbers[key]) for key in PARTS), largest, portion]
        )
    return Table(
        title="Where the error comes from",
        text="Root mean squares of three parts that add up to the error against the true meshes, without the "
        "references' noise. Zones are in units of the whole picture's mean, objects in units of their own.",
        columns=["", "pixels", *PARTS, "largest part", "its share of squares"],
        rows=rows,
        strong=frozenset(strong),
        notes=[
            *((name, formulas[name]) for name in PARTS),
            ("zones", "lit: all of the unshadowed irradiance arrives, umbra: none, with the true meshes"),
        ],
    )


def metric_table(frames: Frames, formulas: Formulas) -> Table:
    """Every metric over every region against either reference, each beside its noise floor."""
    rows = []
    for name, part, _ in _regions(frames, ("zones", "objects")):
        for kind, words in (("spheres", "same spheres"), ("mesh", "true meshes")):
            for metric in METRICS:
                floor = part["noise_floor"][kind][metric]
                if part[f"{metric}_{kind}"] is None and floor is None:
                    continue
                rows.append(
                    [
                        name,
                        words,
                        NAMES[metric],
                        _metric(part, metric, kind),
                        _value(metric, floor, faint=True),
                    ]
                )
    return Table(
        title="All metrics",
        text="The noise floor is what a perfect picture would show against this reference; ≈ marks what "
        "is no further off than that.",
        columns=["", "reference", "metric", "value", "noise floor"],
        rows=rows,
        notes=[*((NAMES[name], formulas[name]) for name in METRICS), PIXELS],
    )


def time_table(frames: Frames) -> Table:
    """Times by stage."""
    rows = []
    for frame in frames:
        kernel = frame["kernel_seconds"]
        rate = frame["points"] / kernel / 1e6 if kernel else None
        rows.append(
            [
                f"Frame {frame['index']}",
                _count(frame["points"]),
                _seconds(kernel),
                Cell(f"{rate:.3g}" if rate else "–", rate),
                *(_seconds(frame[name]) for name in ("gbuffer_seconds", "seconds")),
                *(_seconds(frame[f"reference_seconds_{kind}"]) for kind in ("spheres", "mesh")),
            ]
        )
    return Table(
        title="Times",
        text="What was there already keeps the time that it took when it was made.",
        groups=[("", 2), ("rendering", 4), ("references", 2)],
        columns=[
            "",
            "points",
            "light kernels",
            "Mpoints/s",
            "visibility",
            "whole frame",
            "same spheres",
            "true meshes",
        ],
        rows=rows,
        notes=[
            ("light kernels", "all kernels of the frame by the device's own clock, without transfers"),
            ("visibility", "which points the camera sees, by Embree on the host"),
            ("whole frame", "everything, writing the files included"),
        ],
    )


SKIPPED = {
    "fully_lit": ("points that see all of a light", percent),
    "fully_dark": ("points that see none of it", percent),
    "penumbra": ("points in penumbra, the only ones whose mask is looked into", percent),
    "below_horizon": ("points with the light below their horizon", percent),
    "spheres_culled_per_pair": ("spheres left out per point and light", "{:.1f}".format),
    "spheres_tested_per_pair": ("spheres looked at", "{:.1f}".format),
    "spheres_splatted_per_pair": ("spheres rasterised", "{:.2f}".format),
    "products_per_pair": ("lobe products", "{:.2f}".format),
    "leaves_per_pair": ("leaves of the mask", "{:.2f}".format),
}


def skip_table(skipped: Mapping[str, float]) -> Table:
    """What rendering did not have to compute, on average over the frames."""
    found = [(*SKIPPED[name], skipped[name]) for name in SKIPPED if name in skipped]
    return Table(
        "What was skipped",
        ("of all pairs of a point and a light", "share or number"),
        [(what, Cell(text(value), value)) for what, text, value in found],
    )


def _regions(frames: Frames, kinds: Sequence[str]) -> Iterator[tuple[str, Mapping[str, Any], bool]]:
    """Name, numbers, and whether it is the whole picture, of each frame and its parts."""
    for frame in frames:
        start = f"Frame {frame['index']}"
        yield start, frame, True
        for kind in kinds:
            for name, part in frame[kind].items():
                yield f"{start} · {name}", part, False


def _metric(part: Mapping[str, Any], metric: str, kind: str) -> Cell:
    value = part[f"{metric}_{kind}"]
    shown = _value(metric, value)
    mark = "≈ " if below_noise(metric, value, part["noise_floor"][kind][metric]) else ""
    return Cell(mark + shown.text, value)


def _value(metric: str, value: float | None, *, faint: bool = False) -> Cell:
    if value is None:
        return Cell("–", None, faint)
    if metric not in UNITS:
        return _share(value, faint=faint)
    digits = {"psnr": f"{value:.1f}", "ssim": f"{value:.5f}", "flip": f"{value:.4f}"}[metric]
    return Cell(f"{digits}\N{NO-BREAK SPACE}{UNITS[metric]}".rstrip(), value, faint)


def _share(value: float | None, *, faint: bool = False) -> Cell:
    return Cell(percent(value), value, faint)


def _count(value: int | None) -> Cell:
    return Cell("–" if value is None else f"{value:,}", value)


def _seconds(value: float | None) -> Cell:
    return Cell(duration(value), value)
