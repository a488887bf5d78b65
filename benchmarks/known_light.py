"""What a polish for one known light would buy: an upper bound, trained on the light it is judged by.

Bundles run from receivers on the ground to points of the light instead of anywhere past an outline. Prints
silhouettes and shadow errors before and after, for 64 spheres. `python benchmarks/known_light.py MESH...`
takes mesh files or sample:bunny; two seconds for each.
"""

import sys

import numpy as np

from coslobe.core.device import Device, open_device
from coslobe.spheresets.balanced import Balanced
from coslobe.spheresets.descent import Descent, State
from coslobe.spheresets.ground_shadow import GROUND_SIZE, LIGHT_CENTER, LIGHT_RADII
from coslobe.spheresets.mesh import load_mesh
from coslobe.spheresets.metrics import measure
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.settings import FitSettings
from coslobe.spheresets.soft_lines import BUNDLE, SoftLines
from coslobe.spheresets.solid import Solid

COUNT = 64
RADIUS = LIGHT_RADII[1]
BATCHES, BATCH = 40, 512  # bundles
STEPS, WEIGHT = 600, 20.0
SOFTNESS, RATE = (0.004, 0.001), (0.002, 0.0002)


def bundles_to_light(solid: Solid, rng: np.random.Generator) -> np.ndarray:
    """Batches for SoftLines: bundles that hit with some of their lines, a quarter of them any."""
    longest = float((solid.upper - solid.lower).max())
    ground = np.array([0.0, solid.lower[1], 0.0])
    wanted = BATCHES * BATCH
    receivers = np.zeros((8 * wanted, 1, 3))
    receivers[:, 0, ::2] = rng.uniform(-0.5, 0.5, (len(receivers), 2)) * GROUND_SIZE * longest
    receivers += ground
    towards = ground + np.array(LIGHT_CENTER) * longest - receivers
    inside = rng.normal(
        size=(len(receivers), BUNDLE, 3)
    )  # seen from afar, the light is a disk: drop the depth
    axis = towards / np.linalg.norm(towards, axis=2, keepdims=True)
    inside -= (inside * axis).sum(2, keepdims=True) * axis
    inside *= np.sqrt(rng.random((*inside.shape[:2], 1))) / np.linalg.norm(inside, axis=2, keepdims=True)
    directions = towards + RADIUS * longest * inside
    directions /= np.linalg.norm(directions, axis=2, keepdims=True)
    starts = (receivers + 1e-4 * directions).reshape(-1, 3)
    hit = solid.occluded(starts, directions.reshape(-1, 3), np.inf).reshape(-1, BUNDLE)
    partly = np.flatnonzero(np.ptp(hit.astype(int), axis=1))[: 3 * wanted // 4]
    chosen = np.concatenate([partly, rng.choice(len(hit), wanted - len(partly), replace=False)])
    chosen = rng.permutation(chosen)
    origins, directions = np.broadcast_to(receivers, directions.shape)[chosen], directions[chosen]
    origins = (
        origins - (origins * directions).sum(2, keepdims=True) * directions
    )  # nearest to the box's middle
    rows = np.concatenate([origins, directions, hit[chosen, :, None]], axis=2).astype(np.float32)
    return np.ascontiguousarray(rows.reshape(BATCHES, -1, 7).transpose(0, 2, 1))


def report(solid: Solid, spheres: np.ndarray, device: Device, label: str) -> None:
    """One line of metrics."""
    placed = np.column_stack([solid.center + solid.size * spheres[:, :3], solid.size * spheres[:, 3]])
    m = measure(solid, SphereSet(placed[:, :3], placed[:, 3], np.zeros(len(placed))), device)
    print(
        f"{solid.name} {label}: silhouettes {m['silhouette_iou_mean']:.4f} / {m['silhouette_iou_min']:.3f}, "
        f"volume {m['volume_iou']:.3f}, shadow error at radius {RADIUS} {m['shadow_rmse'][1]:.4f}, "
        f"without contact {m['shadow_rmse_no_contact'][1]:.4f}, bias {m['shadow_bias'][1]:+.4f}"
    )


def main(meshes: list[str]) -> None:
    """Fits, polishes and reports."""
    device = open_device()
    for mesh in meshes:
        solid = Solid(load_mesh(mesh))
        fits = Balanced(solid, FitSettings(count=COUNT), device)
        spheres = fits.fit(COUNT)
        report(solid, spheres, device, "as fitted")
        samples = fits.samples(COUNT)
        lines = SoftLines(device, bundles_to_light(solid, np.random.default_rng(0)))
        descent = Descent(device, (samples.union, 1.0), (samples.lines, 5.0), (lines, WEIGHT))
        state = State.start(spheres)
        descent.run(state, np.geomspace(*SOFTNESS, STEPS), np.geomspace(*RATE, STEPS))
        report(solid, state.spheres.astype(np.float64), device, "for the light")


if __name__ == "__main__":
    main(sys.argv[1:] or ["sample:bunny"])
