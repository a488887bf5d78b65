"""Tables of Lafortune fits: measured materials, one per row (Ngan, Durand and Matusik 2005)."""

import csv
import math
from dataclasses import dataclass
from pathlib import Path

from coslobe.core.errors import InvalidInput
from coslobe.render.scenepaths import suggestion

COLUMNS = ("name", "kd_r", "kd_g", "kd_b", "ks_r", "ks_g", "ks_b", "Cxy", "Cz", "sharpness")


@dataclass(frozen=True)
class Fit:
    """kd / pi + rho max(c_x v_x l_x + c_y v_y l_y + c_z v_z l_z, 0)^n, with the largest of c at +-1.

    Attributes
    ----------
    kd, rho, c : three numbers each
    exponent : float
    """

    kd: tuple[float, ...]
    rho: tuple[float, ...]
    c: tuple[float, ...]
    exponent: float


def read_fit(path: Path, name: str) -> Fit:
    """The fit of the material `name` in a CSV file with the `COLUMNS`; further columns are ignored.

    The table means kd / pi + ks (n + 2) / (2 pi max(|Cxy|, |Cz|)^n) max(Cxy (vx lx + vy ly) + Cz vz lz, 0)^n.
    Dividing Cxy and Cz by the larger of both takes the power out of the scale, which no number could hold:
    0.577^16600 is 1e-3965.

    Raises
    ------
    InvalidInput
        The file cannot be read, lacks a column or the material, or a value of the material is wrong.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            reader = csv.DictReader(file, strict=True)
            rows = [(reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise InvalidInput(f"{path}: cannot be read as a table ({error})", "save it as CSV") from error
    if missing := [column for column in COLUMNS if column not in (reader.fieldnames or ())]:
        raise InvalidInput(
            f"{path}:1: no column {missing[0]}{suggestion(missing[0], reader.fieldnames or ())}",
            f"a table of fits has the columns {','.join(COLUMNS)}",
        )
    found = next(((line, row) for line, row in rows if row["name"] == name), None)
    if found is None:
        known = suggestion(name, (row["name"] for _, row in rows))
        raise InvalidInput(f"{path}: no material {name!r}{known}", "the first column holds the names")
    line, row = found
    numbers = [_number(path, line, column, row[column]) for column in COLUMNS[1:]]
    c_xy, c_z, n = numbers[6:]
    largest = max(abs(c_xy), abs(c_z))
    if largest == 0:
        raise InvalidInput(f"{path}:{line}: Cxy and Cz are both 0", "correct the table")
    if min(*numbers[:6], n) < 0:
        raise InvalidInput(f"{path}:{line}: kd, ks and sharpness must be >= 0", "correct the table")
    rho = tuple(ks * (n + 2) / (2 * math.pi) for ks in numbers[3:6])
    return Fit(tuple(numbers[:3]), rho, (c_xy / largest, c_xy / largest, c_z / largest), n)


def _number(path: Path, line: int, column: str, text: str | None) -> float:
    try:
        value = float(text or "")
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        message = f"{path}:{line}: {column}: must be a number (got {text or ''})"
        raise InvalidInput(message, "correct the table")
    return value
