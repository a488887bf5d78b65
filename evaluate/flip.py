"""HDR-FLIP error maps (Andersson et al. 2021), made by a process of their own.

The library ends the whole process where it cannot work, as on a black reference without exposures. Run as a
module, this file is that process: it reads pairs from one file of arrays and writes maps to another.
"""

import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core.errors import CoslobeError

MOST_EXPOSURES = 3

# FLIP's tone curve is that of ACES by Narkowicz, (a x^2 + b x) / (c x^2 + d x + e) with exposure 0.6 in it.
_ACES = (0.6 * 0.6 * 2.51, 0.6 * 0.03, 0.6 * 0.6 * 2.43, 0.6 * 0.59, 0.14)
_BRIGHT = 0.85  # the tone that the exposures' ends give to the brightest and to the median luminance

_LUMINANCE = (0.2126, 0.7152, 0.0722)


def exposures(references: Sequence[NDArray]) -> tuple[float, float, int] | None:
    """Start, stop and number of the exposures for all pictures of a sequence; None where all is black.

    `references` are linear radiance [n, 3]. The rule is FLIP's own for one picture: the brightest luminance
    at the start, and the median at the stop, get the tone 0.85; one exposure per stop, here at most 3.
    """
    luminance = np.concatenate([reference @ np.array(_LUMINANCE) for reference in references])
    brightest, median = (float(np.max(luminance)), float(np.median(luminance))) if luminance.size else (0, 0)
    if brightest <= 0:
        return None
    a, b, c, d, e = _ACES
    a, b, c = a - _BRIGHT * c, b - _BRIGHT * d, -_BRIGHT * e
    bright = (-b + np.sqrt(b * b - 4 * a * c)) / (2 * a)
    start = float(np.log2(bright / brightest))
    stop = float(np.log2(bright / max(median, brightest / 2**MOST_EXPOSURES)))
    return start, stop, int(np.clip(np.ceil(stop - start), 2, MOST_EXPOSURES))


def flip_maps(pairs: Sequence[tuple[NDArray, NDArray]], chosen: tuple[float, float, int]) -> list[NDArray]:
    """The FLIP error, float32 [h, w], of each (reference, picture), both linear [h, w, 3].

    Raises
    ------
    CoslobeError
        The worker process failed.
    """
    with tempfile.TemporaryDirectory(prefix="coslobe-flip-") as folder:
        source, target = Path(folder, "pairs.npz"), Path(folder, "maps.npz")
        arrays = {
            f"{i}{side}": image
            for i, pair in enumerate(pairs)
            for side, image in zip("rt", pair, strict=True)
        }
        np.savez(source, chosen=np.array(chosen), count=len(pairs), **arrays)  # pyright: ignore[reportArgumentType]
        command = [sys.executable, "-m", "coslobe.evaluate.flip", str(source), str(target)]
        result = subprocess.run(command, capture_output=True, text=True, check=False)
        if result.returncode or not target.is_file():
            reason = (result.stderr or result.stdout).strip().splitlines()[-1:] or [
                f"status {result.returncode}"
            ]
            raise CoslobeError(f"FLIP failed: {reason[0]}", "pip install --force-reinstall flip-evaluator")
        with np.load(target) as maps:
            return [maps[str(i)] for i in range(len(pairs))]


def _work(source: str, target: str) -> None:
    from flip_evaluator import nbflip  # pyright: ignore[reportAttributeAccessIssue]

    with np.load(source) as data:
        start, stop, count = data["chosen"].tolist()
        settings = {"startExposure": start, "stopExposure": stop, "numExposures": int(count)}
        maps = {}
        for i in range(int(data["count"])):
            reference, picture = (
                np.ascontiguousarray(np.maximum(data[f"{i}{side}"], 0), np.float32) for side in "rt"
            )
            linear_input, coloured, with_mean = False, False, False
            error, _, _ = nbflip.evaluate(
                reference, picture, True, linear_input, coloured, with_mean, settings
            )
            maps[str(i)] = error[..., 0]
    np.savez(target, **maps)


if __name__ == "__main__":
    _work(*sys.argv[1:])
