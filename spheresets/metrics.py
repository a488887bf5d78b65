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
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.union import Union

Array = NDArray[np.float64]

SEED = 20090401  # of all samples here; no fit uses it
VIEWS, PIXELS, WINDOW = 32, 256, 1.1
VOLUME_POINTS, VOLUME_BOX = 200_000, 1.25
SURFACE_POINTS = 50_000
UNION_POINTS = 100_000

# The ground-shadow set-up, for a mesh whose longest side is 1, standing on y = 0, centered in x and z.
LIGHT_CENTER, LIGHT_RADII = (1.0, 2.2, 0.6), (0.05, 0.3, 0.8)
GROUND_SIZE, GROUND_CELLS, CAP_STRATA = 3.0, 96, 16
RAY_OFFSET = 1e-4
CONTACT = 0.02


def measure(solid: Solid, spheres: SphereSet, device: Device, progress: Progress = SILENT) -> dict[str, Any]:
    """The metrics of a sphere set, under the names of the sphere file.

    silhouette_iou_mean, _min
        Over 32 Fibonacci directions, orthographic masks of 256 x 256 pixels, window 1.1 diagonals.
    volume_iou, outside_volume, uncovered_volume, sum_outside_volume
        From 200,000 points in the 1.25 times larger box; the last counts a point once per sphere that holds
        it (Wang et al. 2006).
    max_gap
        Largest distance of 50,000 surface samples from the union.
    hausdorff_mesh_to_union, hausdorff_union_to_mesh
        Largest distance of surface samples from the union's surface, and of samples of that from the mesh.
    shadow_rmse, shadow_rmse_no_contact, shadow_bias
        Irradiance on the ground at light radii 0.05, 0.3 and 0.8 times the longest side, against rays to the
        mesh, divided by the mean; without receivers within 0.02 of the mesh; signed (> 0: too light).
    """
    with progress.task("measuring", 3 + len(LIGHT_RADII)) as advance:
        unit = np.column_stack([(spheres.centers - solid.center) / solid.size, spheres.radii / solid.size])
        union = Union(device, unit)
        rng = np.random.default_rng(SEED)
        silhouettes = silhouette_ious(solid, union)
        advance()
        volumes = _volumes(solid, union, rng)
        advance()
        distances = _distances(solid, union, unit, rng)
        advance()
        shadows = []
        for radius in LIGHT_RADII:
            shadows.append(_shadow_errors(solid, union, radius))
            advance()
    rmse, no_contact, bias = (list(column) for column in zip(*shadows, strict=True))
    return {
        "silhouette_iou_mean": float(silhouettes.mean()),
        "silhouette_iou_min": float(silhouettes.min()),
        **volumes,
        **distances,
        "shadow_rmse": rmse,
        "shadow_rmse_no_contact": no_contact,
        "shadow_bias": bias,
    }


def silhouette_masks(
    solid: Solid, union: Union, direction: Array, pixels: int = PIXELS
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Orthographic masks [pixels, pixels] of mesh and union seen along `direction`."""
    s, t = (tangent[0] for tangent in frames(direction[None]))
    steps = ((np.arange(pixels) + 0.5) / pixels - 0.5) * WINDOW
    origins = (steps[:, None, None] * t + steps[None, :, None] * s).reshape(-1, 3) - direction
    mesh = solid.occluded(origins, direction, np.inf)
    spheres = union.lines(origins, np.broadcast_to(direction, origins.shape)) < 0
    return mesh.reshape(pixels, pixels), spheres.reshape(pixels, pixels)


def silhouette_ious(solid: Solid, union: Union) -> Array:
    """Intersection over union of the two silhouettes for each of the 32 directions."""
    ious = []
    for direction in fibonacci_sphere(VIEWS):
        mesh, spheres = silhouette_masks(solid, union, direction)
        ious.append((mesh & spheres).sum() / max((mesh | spheres).sum(), 1))
    return np.array(ious)


def _volumes(solid: Solid, union: Union, rng: np.random.Generator) -> dict[str, float]:
    points = rng.uniform(solid.lower, solid.upper, (VOLUME_POINTS, 3)) * VOLUME_BOX
    inside = solid.inside(points)
    _, containing = union.points(points)
    covered = containing > 0
    volume = max(int(inside.sum()), 1)
    return {
        "volume_iou": float((inside & covered).sum() / max((inside | covered).sum(), 1)),
        "outside_volume": float((covered & ~inside).sum() / volume),
        "uncovered_volume": float((inside & ~covered).sum() / volume),
        "sum_outside_volume": float(containing[~inside].sum() / volume),
    }


def _distances(solid: Solid, union: Union, spheres: Array, rng: np.random.Generator) -> dict[str, float]:
    from scipy.spatial import KDTree

    surface = solid.sample_surface(SURFACE_POINTS, rng)
    clearance, _ = union.points(surface)
    each = int(np.clip(UNION_POINTS // len(spheres), 32, 400))
    shell = (spheres[:, None, :3] + spheres[:, None, 3:] * fibonacci_sphere(each)).reshape(-1, 3)
    shell = shell[union.points(shell)[0] > -1e-5]
    covered = surface[clearance < 0]
    depth = KDTree(shell).query(covered)[0] if len(covered) and len(shell) else np.zeros(1)
    gap = max(float(clearance.max()), 0.0)
    return {
        "max_gap": gap,
        "hausdorff_mesh_to_union": max(gap, float(depth.max())),
        "hausdorff_union_to_mesh": float(solid.distance(shell).max()) if len(shell) else 0.0,
    }


def _shadow_errors(solid: Solid, union: Union, radius: float) -> tuple[float, float, float]:
    """Relative RMSE, the same without contact, and relative bias of the ground's irradiance."""
    longest = float((solid.upper - solid.lower).max())
    ground = np.array([0.0, solid.lower[1], 0.0])
    steps = ((np.arange(GROUND_CELLS) + 0.5) / GROUND_CELLS - 0.5) * GROUND_SIZE * longest
    x, z = (axis.reshape(-1) for axis in np.meshgrid(steps, steps))
    receivers = ground + np.stack([x, np.zeros_like(x), z], axis=1)
    light = np.append(ground + np.array(LIGHT_CENTER) * longest, radius * longest)

    axes, directions, solid_angles = _cap_directions(receivers, light)
    weights = directions[:, :, 1] * solid_angles[:, None]
    starts = np.repeat(receivers + np.array([0, RAY_OFFSET * longest, 0]), directions.shape[1], axis=0)
    in_shadow = solid.occluded(starts, directions.reshape(-1, 3), np.inf).reshape(weights.shape)
    truth = (weights * ~in_shadow).mean(1)
    error = (weights * ~union.caps(receivers, axes, directions, light)).mean(1) - truth
    far = solid.distance(receivers) > CONTACT * longest
    mean = truth.mean()
    return (
        float(np.sqrt((error**2).mean()) / mean),
        float(np.sqrt((error[far] ** 2).mean()) / mean),
        float(error.mean() / mean),
    )


def _cap_directions(receivers: Array, light: Array) -> tuple[Array, Array, Array]:
    """Stratified directions [m, k, 3] to a light sphere, their cap [m, 4] (axis, cosine), solid angle [m]."""
    offset = light[:3] - receivers
    distance = np.linalg.norm(offset, axis=1)
    axis = offset / distance[:, None]
    cos_cap = np.sqrt(1 - (light[3] / distance) ** 2)
    u = (np.arange(CAP_STRATA) + 0.5) / CAP_STRATA
    u1, u2 = (grid.reshape(-1) for grid in np.meshgrid(u, u))
    cos = 1 - u1 * (1 - cos_cap[:, None])
    sin = np.sqrt(1 - cos**2)
    s, t = frames(axis)
    around = np.cos(2 * np.pi * u2)[:, None] * s[:, None] + np.sin(2 * np.pi * u2)[:, None] * t[:, None]
    directions = cos[:, :, None] * axis[:, None] + sin[:, :, None] * around
    return np.column_stack([axis, cos_cap]), directions, 2 * np.pi * (1 - cos_cap)
