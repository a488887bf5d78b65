"""Whether anything has become slower: ratios of this run against those that were recorded."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from coslobe.core.files import write_json

TOLERANCE = 0.15

Ratios = dict[str, dict[str, float]]  # by device and name; all are costs: the lower, the better


@dataclass(frozen=True)
class Regression:
    """A cost that has grown."""

    device: str
    name: str
    recorded: float
    found: float

    def __str__(self) -> str:
        grown = 100 * (self.found / self.recorded - 1)
        return f"{self.device}: {self.name}: {self.found:.3g} instead of {self.recorded:.3g} ({grown:+.0f} %)"


def regressions(found: Mapping[str, Mapping[str, float]], recorded: Mapping[str, Any]) -> list[Regression]:
    """Costs beyond the recorded ones by more than TOLERANCE, of those that are known to both sides."""
    return [
        Regression(device, name, recorded[device][name], value)
        for device, ratios in found.items()
        for name, value in ratios.items()
        if name in recorded.get(device, {}) and value > recorded[device][name] * (1 + TOLERANCE)
    ]


def read(path: Path) -> Ratios:
    """The recorded ratios; none where nothing has been recorded yet."""
    return json.loads(path.read_text()) if path.is_file() else {}


def record(path: Path, found: Mapping[str, Mapping[str, float]]) -> None:
    """Replace the ratios that were measured, and keep the others."""
    before = read(path)
    write_json(
        path, {**before, **{device: {**before.get(device, {}), **new} for device, new in found.items()}}
    )
