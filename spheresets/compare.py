"""Sphere sets of one mesh side by side, all measured by the same evaluator."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.ground_shadow import LIGHT_RADII
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.metrics import measure
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.solid import solid_of


@dataclass(frozen=True)
class Row:
    """One figure of all sets.

    Attributes
    ----------
    name : str
        Of the metric; for shadows with the light's radius.
    values : tuple of float
        One per set.
    better : int or None
        Which set is better than all others; None where that is none.
    """

    name: str
    values: tuple[float, ...]
    better: int | None


def measure_all(
    mesh: Mesh, sets: Sequence[SphereSet], device: Device, progress: Progress = SILENT
) -> list[dict[str, Any]]:
    """`metrics.measure` of each set against `mesh`."""
    solid = solid_of(mesh)
    return [measure(solid, spheres, device, progress) for spheres in sets]


def side_by_side(metrics: Sequence[dict[str, Any]]) -> list[Row]:
    """Rows for all metrics, in their order; a metric per light becomes one row per light."""
    rows = []
    for name, first in metrics[0].items():
        if isinstance(first, list):
            labels = [f"{name} (light {radius:g})" for radius in LIGHT_RADII]
            columns = zip(*(one[name] for one in metrics), strict=True)
        else:
            labels, columns = [name], [tuple(one[name] for one in metrics)]
        rows += [
            Row(label, values, _better(name, values)) for label, values in zip(labels, columns, strict=True)
        ]
    return rows


def _better(name: str, values: Sequence[float]) -> int | None:
    """Larger is better for intersections over unions; all else should be near 0."""
    loss = [-value if "iou" in name else abs(value) for value in values]
    return loss.index(min(loss)) if loss.count(min(loss)) == 1 else None
