"""From a mesh to a sphere tree: method, levels, hierarchy, cache."""

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.model import SphereTree

METHODS = ("balanced",)
QUALITIES = ("fast", "best")
MODES = ("balanced",)


def fit_spheres(
    mesh: Mesh,
    count: int = 64,
    *,
    method: str = "balanced",
    quality: str = "fast",
    mode: str = "balanced",
    seed: int = 0,
    levels: int | None = None,
    device: Device,
    progress: Progress = SILENT,
) -> SphereTree:
    """Fit exactly `count` spheres and the coarser levels 4, 16, 64, ... below it.

    `levels` is the number of levels to keep, the finest included (None: all). `seconds` covers sampling and
    fitting. `metrics` stay empty; `metrics.measure` fills them.

    Raises
    ------
    UsageError
        `method`, `quality` or `mode` is unknown, or `count` or `levels` is below 1.
    """
    raise NotImplementedError


def cached_spheres(
    mesh: Mesh,
    count: int = 64,
    *,
    method: str = "balanced",
    quality: str = "fast",
    seed: int = 0,
    device: Device,
    progress: Progress = SILENT,
) -> SphereTree:
    """The fitted tree from the cache; fitted and stored on first use, with a line that says so."""
    raise NotImplementedError
