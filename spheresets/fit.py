"""From a mesh to a sphere tree: method, levels, hierarchy, cache."""

import hashlib
import time
import warnings
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from coslobe.core import cache
from coslobe.core.device import Device
from coslobe.core.errors import CoslobeError, InvalidInput
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.balanced import Balanced
from coslobe.spheresets.files import SUFFIX, read_spheres, write_spheres
from coslobe.spheresets.medial import Medial
from coslobe.spheresets.mesh import Mesh
from coslobe.spheresets.metrics import measure
from coslobe.spheresets.model import MeshInfo, SphereSet, SphereTree
from coslobe.spheresets.outside import outside_distances
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.solid import Solid, solid_of
from coslobe.spheresets.tree import bounding_hierarchy, level_counts, parents
from coslobe.spheresets.variational import Variational

METHODS = {"balanced": Balanced, "variational": Variational, "medial": Medial}


def fit_spheres(
    mesh: Mesh, settings: FitSettings, *, device: Device, progress: Progress = SILENT
) -> SphereTree:
    """Fit exactly `settings.count` spheres and the coarser levels 4, 16, 64, ... below it.

    `seconds` covers sampling and fitting. `metrics` stay empty; `metrics.measure` fills them.

    Raises
    ------
    InvalidInput
        The mesh encloses no volume.
    """
    started = time.perf_counter()
    with progress.task("sampling the mesh", 1) as advance:
        solid = solid_of(mesh)
        report, sheets = solid.report, solid.sheets
        if sheets.any() and not sheets.all() and settings.mode != "outer":  # covers hold sheets, too
            solid = Solid(replace(mesh, faces=mesh.faces[~sheets]))
        fits = METHODS[settings.method](solid, settings, device)
        advance()
    if report:
        progress.say(report)
    counts = level_counts(settings.count, settings.levels)
    fitted = [fits.fit(n, coarse=n != settings.count, progress=progress) for n in counts]
    # The hierarchy is built in file coordinates, where its containment has to hold to the last bit.
    order, hierarchy = bounding_hierarchy(_to_file(solid, fitted[-1]))
    fitted[-1] = fitted[-1][order]
    above = [np.full(counts[0], -1, np.int32)]
    above += [parents(below, coarser) for coarser, below in pairwise(fitted)]
    return SphereTree(
        levels=tuple(_level(solid, spheres) for spheres in fitted),
        parents=tuple(above),
        hierarchy=hierarchy,
        mesh=_info(mesh),
        method=settings.method,
        quality=settings.quality,
        mode=settings.mode,
        seed=settings.seed,
        seconds=time.perf_counter() - started,
    )


def cached_spheres(
    mesh: Mesh,
    settings: FitSettings,
    *,
    metrics: bool = False,
    device: Device,
    progress: Progress = SILENT,
) -> SphereTree:
    """`fit_spheres` from the cache; fitted and stored on first use, with a line that says so.

    With `metrics`, the tree has them; else only where an earlier call wanted them.
    """
    path = cache_file(mesh, settings, device=device)
    try:
        tree = replace(read_spheres(path), mesh=_info(mesh))
    except InvalidInput:  # not there yet, or damaged
        kept = " (kept for next time)" if cache.lasting() else ""
        progress.say(f"fitting {settings.count} spheres to {mesh.file}{kept}")
        tree = fit_spheres(mesh, settings, device=device, progress=progress)
        _keep(path, tree)
    if metrics and not tree.metrics:
        tree = replace(tree, metrics=measure(solid_of(mesh), tree.finest, device, progress))
        _keep(path, tree)
    return tree


def cache_file(mesh: Mesh, settings: FitSettings, *, device: Device) -> Path:
    """Where `cached_spheres` keeps the tree; there is no such file before the first fit."""
    code = cache.code_digest("spheresets", "spheresets.kernels")  # a changed recipe finds nothing
    key = cache.digest(code, _geometry(mesh), asdict(settings), _identity(device))
    return cache.entry("spheres", key, SUFFIX)


def _keep(path: Path, tree: SphereTree) -> None:
    """Store a tree; a full cache must not cost a finished fit."""
    try:
        write_spheres(path, tree)
    except CoslobeError as error:
        warnings.warn(f"{error}: the spheres are not kept for next time", stacklevel=3)


def _to_file(solid: Solid, spheres: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.column_stack([solid.center + solid.size * spheres[:, :3], solid.size * spheres[:, 3]])


def _level(solid: Solid, spheres: NDArray[np.float64]) -> SphereSet:
    placed = _to_file(solid, spheres)
    return SphereSet(placed[:, :3], placed[:, 3], solid.size * outside_distances(solid, spheres))


def _identity(device: Device) -> list[str | int]:
    """What results depend on: other devices round differently."""
    info = device.info
    return [info.platform, info.version, info.name, info.vector_width]


def _info(mesh: Mesh) -> MeshInfo:
    return MeshInfo(mesh.file, mesh.sha256, len(mesh.vertices), len(mesh.faces))


def _geometry(mesh: Mesh) -> str:
    """Hash of the triangles: unlike the file's, it covers the files that a glTF file refers to."""
    return hashlib.sha256(mesh.vertices.tobytes() + mesh.faces.tobytes()).hexdigest()
