"""How well spheres stand for a mesh: shape, silhouettes and shadows, always against the true mesh.

All samples are drawn here with seeds of their own, so no fit has seen them. Lengths are fractions of the
bounding box's diagonal, volumes fractions of the mesh's volume.
"""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.spheresets.directions import fibonacci_sphere, frames
from coslobe.spheresets.ground_shadow import LIGHT_RADII, shadow_errors
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.union import Union
from coslobe.spheresets.volumes import volumes

Array = NDArray[np.float64]

SEED = (2009, 4, 1)  # of all samples here; no --seed of a fit is three numbers
VIEWS, PIXELS, WINDOW = 32, 256, 1.1
SURFACE_POINTS = 50_000
UNION_POINTS = 100_000  # over all spheres; those inside other spheres are left out


def measure(solid: Solid, spheres: SphereSet, device: Device, progress: Progress = SILENT) -> dict[str, Any]:
    """The metrics of a sphere set, under the names of the sphere file.

    silhouette_iou_mean, _min
        Over 32 Fibonacci directions, orthographic masks of 256 x 256 pixels, window 1.1 diagonals.
    volume_iou, outside_volume, uncovered_volume, sum_outside_volume
        See `volumes`; the last counts what is outside once per sphere that holds it (Wang et al. 2006).
    max_gap
        Largest distance of 50,000 surface samples from the union. Surface that lies within the solid, where
        parts overlap, is left out here and below.
    hausdorff_mesh_to_union, hausdorff_union_to_mesh
        Largest distance of surface samples from 100,000 samples of the union's surface (the distance itself
        where they are outside), and of those from the mesh.
    shadow_rmse, shadow_rmse_no_contact, shadow_bias
        See `ground_shadow.shadow_errors`.

    Raises
    ------
    InvalidInput
        The mesh encloses no volume.
    """
    with progress.task("measuring", 3 + len(LIGHT_RADII)) as advance:
        unit = np.column_stack([(spheres.centers - solid.center) / solid.size, spheres.radii / solid.size])
        union = Union(device, unit)
        rng = np.random.default_rng(SEED)
        silhouettes = silhouette_ious(solid, unit)
        advance()
        shares = volumes(solid, union, unit, rng)
        advance()
        distances = _distances(solid, union, unit, rng)
        advance()
        shadows = shadow_errors(solid, union, unit, advance)
    return {
        "silhouette_iou_mean": float(silhouettes.mean()),
        "silhouette_iou_min": float(silhouettes.min()),
        **shares,
        **distances,
        **shadows,
    }


def silhouette_ious(solid: Solid, spheres: Array) -> Array:
    """Intersection over union [32] of the silhouettes of solid and spheres [n, 4], per direction."""
    steps = ((np.arange(PIXELS) + 0.5) / PIXELS - 0.5) * WINDOW
    ious = []
    for direction in fibonacci_sphere(VIEWS):
        right, up = (tangent[0] for tangent in frames(direction[None]))
        origins = (steps[:, None, None] * up + steps[:, None] * right).reshape(-1, 3) - direction
        mesh = solid.occluded(origins, direction, np.inf).reshape(PIXELS, PIXELS)
        discs = disc_mask(spheres[:, :3] @ np.stack([right, up], axis=1), spheres[:, 3], steps)
        ious.append((mesh & discs).sum() / max((mesh | discs).sum(), 1))
    return np.array(ious)


def disc_mask(centers: Array, radii: Array, steps: Array) -> NDArray[np.bool_]:
    """Which pixels [row, column] at (steps[column], steps[row]) are in one of the discs."""
    mask = np.zeros((len(steps), len(steps)), bool)
    first, last = (np.searchsorted(steps, centers + sign * radii[:, None]) for sign in (-1, 1))
    for (x, y), r, (left, bottom), (right, top) in zip(centers, radii, first, last, strict=True):
        dx, dy = steps[left:right] - x, steps[bottom:top] - y
        mask[bottom:top, left:right] |= dx * dx + (dy * dy)[:, None] < r * r
    return mask


def _distances(solid: Solid, union: Union, spheres: Array, rng: np.random.Generator) -> dict[str, float]:
    from scipy.spatial import KDTree

    surface, face = solid.sample_faces(SURFACE_POINTS, rng)
    surface = surface[solid.both_sides(surface, face) < 1.5]
    clearance, _ = union.points(surface)
    area = spheres[:, 3] ** 2
    counts = np.ceil(UNION_POINTS * area / area.sum()).astype(int)
    shell = np.concatenate([s[:3] + s[3] * fibonacci_sphere(n) for s, n in zip(spheres, counts, strict=True)])
    shell = shell[union.points(shell)[0] > -1e-5]
    covered = surface[clearance < 0]
    depth = KDTree(shell).query(covered)[0] if len(covered) and len(shell) else np.zeros(1)
    gap = max(float(clearance.max()), 0.0)
    return {
        "max_gap": gap,
        "hausdorff_mesh_to_union": max(gap, float(depth.max())),
        "hausdorff_union_to_mesh": float(solid.distance(shell).max()) if len(shell) else 0.0,
    }
