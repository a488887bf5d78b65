"""Fit one sphere set: `python fit_one.py MESH COUNT METHOD QUALITY OUT.json`.

A process of its own, so that a fit that takes too long can be ended. Times cover sampling and the finest
level: no start-up, no metrics, no other levels.
"""

import json
import sys
import time
from pathlib import Path

from coslobe.core.device import open_device
from coslobe.spheresets.fit import fit_spheres
from coslobe.spheresets.mesh import load_mesh
from coslobe.spheresets.settings import FitSettings


def main(mesh: str, count: str, method: str, quality: str, out: str) -> None:
    solid, device = load_mesh(mesh), open_device()
    settings = FitSettings(int(count), method, quality, levels=1)
    cpu = time.process_time()
    tree = fit_spheres(solid, settings, device=device)
    document = {
        "centers": tree.finest.centers.tolist(),
        "radii": tree.finest.radii.tolist(),
        "seconds": tree.seconds,
        "cpu_seconds": time.process_time() - cpu,
    }
    Path(out).write_text(json.dumps(document))


if __name__ == "__main__":
    main(*sys.argv[1:])
