"""The error that spheres make in the soft shadow on the ground: what the fits are for."""

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from coslobe.spheresets.directions import frames
from coslobe.spheresets.solid import Solid
from coslobe.spheresets.union import Union

Array = NDArray[np.float64]

# For a mesh whose longest side is 1, standing on y = 0, centered in x and z.
LIGHT_CENTER, LIGHT_RADII = (1.0, 2.2, 0.6), (0.05, 0.3, 0.8)
GROUND_SIZE, GROUND_CELLS = 3.0, 96
STRATA = 16  # directions to the light: 16 x 16
RAY_OFFSET = 1e-4
CONTACT = 0.02


def shadow_errors(
    solid: Solid, union: Union, spheres: Array, advance: Callable[..., None]
) -> dict[str, list[float]]:
    """Errors of the irradiance on a ground plane under the mesh, for three radii of a spherical light.

    shadow_rmse
        Root of the mean square over 96 x 96 receivers, divided by the mean irradiance under the mesh.
    shadow_rmse_no_contact
        The same without receivers within 0.02 of the mesh: those few are noisy and often dominate.
    shadow_bias
        Mean signed error, divided likewise; > 0 is too light.

    Spheres and mesh are tested on the same 256 stratified directions per receiver, so that most of their
    sampling error cancels. `advance` is called once per radius.
    """
    longest = float((solid.upper - solid.lower).max())
    ground = np.array([0.0, solid.lower[1], 0.0])
    steps = ((np.arange(GROUND_CELLS) + 0.5) / GROUND_CELLS - 0.5) * GROUND_SIZE * longest
    x, z = (axis.reshape(-1) for axis in np.meshgrid(steps, steps))
    receivers = ground + np.stack([x, np.zeros_like(x), z], axis=1)
    free = solid.distance(receivers) > CONTACT * longest
    reach = max(0.5, float((np.linalg.norm(spheres[:, :3], axis=1) + spheres[:, 3]).max()))

    rmse, no_contact, bias = [], [], []
    for radius in LIGHT_RADII:
        light = np.append(ground + np.array(LIGHT_CENTER) * longest, radius * longest)
        axes, directions, solid_angles = cap_directions(receivers, light)
        weights = directions[:, :, 1] * solid_angles[:, None]  # the ground's normal is y
        some = in_reach(receivers, axes, reach)  # of the others no direction is blocked
        starts = np.repeat(receivers[some] + np.array([0, RAY_OFFSET * longest, 0]), STRATA**2, axis=0)
        dark = solid.occluded(starts, directions[some].reshape(-1, 3), np.inf).reshape(-1, STRATA**2)
        blocked = union.caps(receivers[some], axes[some], directions[some], light)
        truth = weights.mean(1)
        truth[some] = (weights[some] * ~dark).mean(1)
        error = np.zeros_like(truth)
        error[some] = (weights[some] * ~blocked).mean(1) - truth[some]
        rmse.append(float(np.sqrt((error**2).mean()) / truth.mean()))
        no_contact.append(float(np.sqrt((error[free] ** 2).mean()) / truth.mean()))
        bias.append(float(error.mean() / truth.mean()))
        advance()
    return {"shadow_rmse": rmse, "shadow_rmse_no_contact": no_contact, "shadow_bias": bias}


def in_reach(receivers: Array, caps: Array, reach: float) -> NDArray[np.bool_]:
    """Which of the caps [n, 4] of directions from receivers [n, 3] meet the ball of radius `reach` at 0."""
    distance = np.linalg.norm(receivers, axis=1)
    towards = -(receivers * caps[:, :3]).sum(1) / distance
    wide = np.arccos(caps[:, 3]) + np.arcsin((reach / distance).clip(max=1))
    return (distance < reach) | (np.arccos(towards.clip(-1, 1)) < wide)


def cap_directions(receivers: Array, light: Array) -> tuple[Array, Array, Array]:
    """Directions [m, k, 3] to a light sphere [4], their cap [m, 4] (axis, cosine), and its solid angle [m].

    The directions are the middles of equal parts of the cap's solid angle. Receivers are outside the light.
    """
    offset = light[:3] - receivers
    distance = np.linalg.norm(offset, axis=1)
    axis = offset / distance[:, None]
    cos_cap = np.sqrt(1 - (light[3] / distance) ** 2)
    u = (np.arange(STRATA) + 0.5) / STRATA
    u1, u2 = (grid.reshape(-1) for grid in np.meshgrid(u, u))
    cos = 1 - u1 * (1 - cos_cap[:, None])
    sin = np.sqrt(1 - cos**2)
    s, t = frames(axis)
    around = np.cos(2 * np.pi * u2)[:, None] * s[:, None] + np.sin(2 * np.pi * u2)[:, None] * t[:, None]
    directions = cos[:, :, None] * axis[:, None] + sin[:, :, None] * around
    return np.column_stack([axis, cos_cap]), directions, 2 * np.pi * (1 - cos_cap)
