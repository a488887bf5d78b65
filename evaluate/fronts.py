"""Error-against-time fronts, and how much sooner one renderer reaches an error than another."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import pairwise
from typing import Any

Row = Mapping[str, Any]

SLOPE = 2.0
"""Beyond a front's ends, time grows with error^-SLOPE, as for independent samples."""


CLOSE = 1.5
"""A setting stands for a number of spheres only if its error is at most so many times the least of them."""


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
    may differ in their number of points. `cpu_speedup` is the same by the processor time of all cores.
    """
    return [
        {**row, "speedup": _against_all(row, rows)} if row["renderer"] == "coslobe" else dict(row)
        for row in rows
    ]


def _against_all(row: Row, rows: Sequence[Row]) -> dict[str, Any]:
    found: dict[str, Any] = {}
    for rival in sorted({other["renderer"] for other in rows} - {"coslobe"}):
        same = [other for other in rows if (other["renderer"], other["material"]) == (rival, row["material"])]
        ratios = {name: _ratio(row, same, name) for name in ("seconds", "cpu_seconds")}
        if ratios["seconds"]:
            speedup, extrapolated = ratios["seconds"]
            cpu_speedup = ratios["cpu_seconds"][0] if ratios["cpu_seconds"] else None
            found[rival] = {
                "speedup": speedup,
                "cpu_speedup": cpu_speedup,
                "extrapolated": extrapolated,
            }
    return found


def _ratio(row: Row, rival: Sequence[Row], clock: str) -> tuple[float, bool] | None:
    """How much longer the rival takes to the row's error, and whether its front had to be continued."""
    curve = front((other["relative_rmse_mesh"], other[clock] / other["points"]) for other in rival)
    own = row[clock] / row["points"]
    if not curve or row["relative_rmse_mesh"] <= 0 or own <= 0:
        return None
    seconds, extrapolated = time_at(curve, row["relative_rmse_mesh"])
    return seconds / own, extrapolated


def best_speedups(rows: Sequence[Row]) -> list[dict[str, Any]]:
    """By rival, material, number of spheres and device: the setting that is fastest at its own error.

    `rows` as from `with_speedups`. Settings whose error is far above what so many spheres can reach are left
    out (`CLOSE`). `extrapolated` says that the rival's front was continued to that error.
    """
    ours = [row for row in rows if row["renderer"] == "coslobe"]
    least: dict[tuple[Any, ...], float] = {}
    for row in ours:
        least[_place(row)] = min(row["relative_rmse_mesh"], least.get(_place(row), math.inf))
    best: dict[tuple[Any, ...], dict[str, Any]] = {}
    for row in ours:
        if row["relative_rmse_mesh"] > CLOSE * least[_place(row)]:
            continue
        for rival, found in row["speedup"].items():
            key = (rival, *_place(row))
            if key not in best or found["speedup"] > best[key]["speedup"]:
                best[key] = {
                    "against": rival,
                    "material": row["material"],
                    "spheres": row["setting"]["spheres"],
                    "device": row["device"],
                    "at_error": row["relative_rmse_mesh"],
                    **found,
                    "setting": row["setting"],
                }
    return list(best.values())


def _place(row: Row) -> tuple[Any, ...]:
    return row["material"], row["setting"]["spheres"], row["device"]
