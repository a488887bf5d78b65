"""Errors on measured materials: 20 Lafortune fits of Ngan et al. 2005, exponents from 2 to 16,600.

A ball and a torus on a plane, all of one material, against the reference with the same spheres; seen with the
light's mirror image clear on the plane, and with the image cut by a shadow, the worst case of sharp lobes.
The table of fits is not part of coslobe: `python benchmarks/merl.py TABLE.csv [ESTIMATOR] [COUNT] [FOLDER]`
prints rows for docs/accuracy.md, and writes image, reference and error side by side into FOLDER. It takes a
quarter of an hour on two cores.
"""

import csv
import sys
from pathlib import Path

import numpy as np

from coslobe import configs
from coslobe.core.device import Device, select
from coslobe.evaluate.direct import direct_light
from coslobe.evaluate.errors import compare, without_noise
from coslobe.evaluate.occlusion import sphere_occluders
from coslobe.evaluate.sampling import strata
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.images import write_png
from coslobe.render.methods import create_method
from coslobe.render.scene import Scene

COUNT = 20
SAMPLES, SAMPLES_OF_SHARP_LOBES = 4096, 16384
SHARP = 1000

# Camera and light.
VIEWS = {"clear": ([-1.6, 1.9, 2.6], [0.9, 2.2, -0.6]), "cut": ([-2.9, 2.6, 2.5], [1.8, 1.6, -1.0])}


def scene(fit: Path, name: str, estimator: str, view: str) -> Scene:
    """The scene in one material."""
    shapes = configs.path("bunny").parent / "shapes"
    origin, light = VIEWS[view]
    torus = {"rotate_x": 20, "rotate_z": 15, "translate": [0.45, 0.25, 0], "scale": 0.8}
    return Scene.model_validate(
        {
            "camera": {"look_at": {"origin": origin, "target": [0.05, 0.2, 0.12]}, "fov": 32},
            "image": {"width": 128, "height": 96},
            "shading": {"estimator": estimator},
            "materials": {"m": {"lafortune": {"fit": str(fit), "name": name}}},
            "lights": {"key": {"sphere": {"center": light, "radius": 0.3, "radiance": 30}}},
            "objects": {
                "ground": {"plane": {"size": 4}, "material": "m"},
                "ball": {
                    "mesh": str(shapes / "ball.glb"),
                    "spheres": {"count": 1},
                    "material": "m",
                    "transform": {"translate": [-0.45, 0, 0.1], "scale": 0.7},
                },
                "torus": {
                    "mesh": str(shapes / "torus.glb"),
                    "spheres": {"count": 64},
                    "material": "m",
                    "transform": torus,
                },
            },
        }
    )


def fits(table: Path, count: int) -> list[tuple[str, float]]:
    """`count` materials of the table, evenly among all in the order of their exponents."""
    with table.open(newline="") as file:
        rows = [(row["name"], float(row["sharpness"])) for row in csv.DictReader(file)]
    rows.sort(key=lambda row: row[1])
    return [rows[k] for k in np.linspace(0, len(rows) - 1, count).round().astype(int)]


def main(table: Path, estimator: str = "accurate", count: int = COUNT, pictures: Path | None = None) -> None:
    """Print the rows."""
    device = Device(select())
    assets, method = Assets(device), create_method("cosine_lobes", device)
    print("| material | exponent | clear | noise | rest | cut | noise | rest |")
    print("|---|---|---|---|---|---|---|---|")
    for name, exponent in fits(table, count):
        cells = [name, f"{exponent:g}"]
        for view in VIEWS:
            of = scene(table, name, estimator, view)
            gbuffer = trace_gbuffer(of, assets)
            image = method.shade(of, gbuffer, world_blockers(of, assets)).radiance
            grid = strata(SAMPLES if exponent < SHARP else SAMPLES_OF_SHARP_LOBES)
            truth = direct_light(of, gbuffer, sphere_occluders(of, assets), grid, (0,))
            errors = compare(image, truth.radiance, truth.variance)
            assert errors.relative_rmse is not None
            assert errors.noise is not None
            rest = without_noise(errors.relative_rmse, errors.noise)
            cells += [f"{100 * x:.2f} %" for x in (errors.relative_rmse, errors.noise, rest or 0)]
            if pictures is not None:
                error = np.abs(image - truth.radiance) / truth.radiance.mean()
                row = [gbuffer.image(part) for part in (image, truth.radiance, error)]
                write_png(pictures / f"{name}.{view}.png", np.concatenate(row, axis=1))
        print("| " + " | ".join(cells) + " |", flush=True)


if __name__ == "__main__":
    main(
        Path(sys.argv[1]),
        *sys.argv[2:3],
        *(int(n) for n in sys.argv[3:4]),
        *(Path(folder) for folder in sys.argv[4:5]),
    )
