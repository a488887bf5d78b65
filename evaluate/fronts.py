"""Error-against-time fronts, and how much sooner one renderer reaches an error than another."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

Row = Mapping[str, Any]

SLOPE = 2.0
"""Beyond a front's ends, time grows with error^-SLOPE, as for independent samples."""


def front(points: Iterable[tuple[float, float]]) -> list[tuple[float, float]]:
    """The (error, seconds) that no other point beats in both, by growing time and falling error."""
    best: list[tuple[float, float]] = []
    for error, seconds in sorted(points, key=lambda point: (point[1], point[0])):
        if error > 0 and seconds > 0 and (not best or error < best[-1][0]):
            best.append((error, seconds))
    return best


def time_at(curve: Sequence[tuple[float, float]], error: float) -> tuple[float, bool]:
    """Seconds in which a `front` reaches an error, and whether that lies beyond its ends.

    Straight in logarithms between neighbouring points; beyond the ends by `SLOPE` from the nearest one.
    """
    first, last = curve[0], curve[-1]
    if not last[0] <= error <= first[0]:
        nearest = first if error > first[0] else last
        return nearest[1] * (nearest[0] / error) ** SLOPE, True
    for (high, early), (low, late) in pairwise(curve):
        if error >= low:
            share = math.log(high / error) / math.log(high / low)
            return early * (late / early) ** share, False
    return last[1], False


def with_speedups(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """The rows; those of coslobe with `speedup`: how much sooner than each rival, at equal error.

    A rival's front is that of its settings with the same material. Times are taken per point, because rows
    may differ in their number of points.
    """
    curves: dict[tuple[str, str], list[tuple[float, float]]] = {}
    for key in {(row["renderer"], row["material"]) for row in rows if row["renderer"] != "coslobe"}:
        of_rival = [row for row in rows if (row["renderer"], row["material"]) == key]
        if curve := front((row["relative_rmse_mesh"], row["seconds"] / row["points"]) for row in of_rival):
            curves[key] = curve
    return [
        {**row, "speedup": _against_all(row, curves)} if row["renderer"] == "coslobe" else dict(row)
        for row in rows
    ]


def _against_all(row: Row, curves: Mapping[tuple[str, str], Any]) -> dict[str, Any]:
    found = {}
    for (rival, material), curve in sorted(curves.items()):
        if material == row["material"]:
            seconds, extrapolated = time_at(curve, row["relative_rmse_mesh"])
            ratio = seconds / (row["seconds"] / row["points"])
            found[rival] = {"speedup": ratio, "extrapolated": extrapolated}
    return found


def best_speedups(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """By rival, material, number of spheres and device: the setting that is fastest at its own error.

    `rows` as from `with_speedups`. `extrapolated` says that the rival's front was continued to that error.
    """
    best: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in rows:
        for rival, found in row.get("speedup", {}).items():
            spheres = row["setting"]["spheres"]
            key = (rival, row["material"], spheres, row["device"])
            if key not in best or found["speedup"] > best[key]["speedup"]:
                best[key] = {
                    "against": rival,
                    "material": row["material"],
                    "spheres": spheres,
                    "device": row["device"],
                    "at_error": row["relative_rmse_mesh"],
                    "speedup": found["speedup"],
                    "extrapolated": found["extrapolated"],
                    "setting": row["setting"],
                }
    return list(best.values())
