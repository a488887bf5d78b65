"""`coslobe eval --compare A.json B.json`: what changed between two runs, and whether that is bearable."""

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from coslobe.core.errors import InvalidInput
from coslobe.core.files import read_bytes
from coslobe.evaluate.comparison import KINDS
from coslobe.evaluate.metrics import HIGHER_IS_BETTER, METRICS, below_noise

TIMES = ("kernel_seconds", "gbuffer_seconds", "seconds")

ROW_MEASURES = ("relative_rmse_spheres", "relative_rmse_mesh", *TIMES)
"""What the rows of other evaluations measure."""

ROW_NAMES = ("renderer", "material", "setting", "device", "value", "seed", "frame")
"""What tells such rows apart."""

SAME = 1e-9  # relative: what rounding in a file may change


@dataclass(frozen=True)
class Thresholds:
    """By which factor less one a number may get worse; None: by any.

    Attributes
    ----------
    error : float
        Of errors beyond the reference's noise. Errors that are better when higher may fall by it.
    time : float or None
        Of times.
    """

    error: float = 0.05
    time: float | None = None


@dataclass(frozen=True)
class Change:
    """One number in both runs.

    Attributes
    ----------
    place, metric : str
    before, after : float or None
    worse : float
        By which share it got worse; negative where it got better, infinite from 0.
    verdict : str
        "same", "noise" (within the reference's in both runs), "better", "worse", or "beyond" the threshold.
    """

    place: str
    metric: str
    before: float | None
    after: float | None
    worse: float
    verdict: str


def compare_results(first: Path, second: Path, thresholds: Thresholds) -> dict[str, Any]:
    """Compare two results files of the same kind, number by number.

    Returns
    -------
    dict
        a, b (paths), holds, changes (see `Change`), and missing: what only the first has.

    Raises
    ------
    InvalidInput
        A file cannot be read, holds no results, or the two are of different kinds.
    """
    documents = [_read(path) for path in (first, second)]
    kinds = [document["format"] for document in documents]
    if kinds[0] != kinds[1]:
        raise InvalidInput(
            f"{second}: format: {kinds[1]} cannot be compared with {kinds[0]}", "give two results of one kind"
        )
    before, after = (dict(_numbers(document)) for document in documents)
    changes = [_change(*key, before[key], after[key], thresholds) for key in before if key in after]
    missing = [f"{place}: {metric}" for place, metric in before if (place, metric) not in after]
    if not changes:
        raise InvalidInput(f"{second}: has nothing in common with {first}", "give results of the same scene")
    return {
        "a": first,
        "b": second,
        "thresholds": asdict(thresholds),
        "holds": not missing and all(change.verdict != "beyond" for change in changes),
        "changes": [
            asdict(change) | {"worse": change.worse if math.isfinite(change.worse) else None}
            for change in sorted(changes, key=lambda change: -change.worse)
        ],
        "missing": missing,
    }


Key = tuple[str, str]
Number = tuple[float | None, float | None]  # with its noise floor


def _read(path: Path) -> dict[str, Any]:
    try:
        document = json.loads(read_bytes(path, "results file"))
        kind = document["format"]
        if not isinstance(kind, str) or not {"frames", "rows"} & set(document):
            raise KeyError("frames")
    except (ValueError, KeyError, TypeError) as error:
        hint = "give a results.json that coslobe eval wrote"
        raise InvalidInput(f"{path}: holds no results of coslobe eval ({error})", hint) from error
    return document


def _numbers(document: Mapping[str, Any]) -> Iterator[tuple[Key, Number]]:
    if "rows" in document:
        for row in document["rows"]:
            place = ", ".join(f"{name} {_text(row[name])}" for name in ROW_NAMES if name in row)
            for metric in ROW_MEASURES:
                if metric in row:
                    floor = row.get(metric.replace("relative_rmse", "noise"))
                    yield (place, metric), (row[metric], floor if metric.startswith("relative") else None)
        return
    for frame in document["frames"]:
        start = f"frame {frame['index']}"
        parts = {start: frame}
        parts |= {
            f"{start}, {name}": part for kind in ("objects", "zones") for name, part in frame[kind].items()
        }
        for place, part in parts.items():
            for kind in KINDS:
                for metric in METRICS:
                    yield (
                        (place, f"{metric}_{kind}"),
                        (part[f"{metric}_{kind}"], part["noise_floor"][kind][metric]),
                    )
        for metric in TIMES:
            yield (start, metric), (frame[metric], None)


def _text(value: Any) -> str:
    return value if isinstance(value, str) else json.dumps(value, sort_keys=True)


def _change(place: str, metric: str, before: Number, after: Number, thresholds: Thresholds) -> Change:
    (a, floor_a), (b, floor_b) = before, after
    name = metric.removesuffix("_mesh").removesuffix("_spheres")
    if a is None or b is None:
        return Change(place, metric, a, b, 0.0, "same" if a is b else "noise")
    worse = _worse(a, b, higher_is_better=name in HIGHER_IS_BETTER)
    limit = thresholds.time if name in TIMES else thresholds.error
    if abs(worse) <= SAME:
        verdict = "same"
    elif below_noise(name, a, floor_a) and below_noise(name, b, floor_b):
        verdict = "noise"
    elif limit is not None and worse > limit:
        verdict = "beyond"
    else:
        verdict = "worse" if worse > 0 else "better"
    return Change(place, metric, a, b, worse, verdict)


def _worse(a: float, b: float, *, higher_is_better: bool) -> float:
    """The share by which |b| is larger than |a|; where higher is better, by which it is lower."""
    a, b = abs(a), abs(b)
    if higher_is_better:
        return (a - b) / a if a else 0.0
    if a == 0:
        return math.inf if b > 0 else 0.0
    return b / a - 1
