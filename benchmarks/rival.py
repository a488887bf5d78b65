"""Run `multisphere` (Buchele et al. 2026, GPL) on one mesh: `python rival.py MESH.stl COUNT OUT.json`.

A process of its own that knows nothing of coslobe. Voxels as coarse as the package has them by default.
"""

import json
import sys
import time
from importlib.metadata import version
from pathlib import Path
from unittest.mock import MagicMock

sys.modules.setdefault("pyvista", MagicMock())  # 1.1.1 imports it for its plots without requiring it
import multisphere  # noqa: E402


def main(mesh: str, count: str, out: str) -> None:
    solid = multisphere.load_mesh(mesh)
    wall, cpu = time.perf_counter(), time.process_time()
    pack = multisphere.multisphere_from_mesh(solid, max_spheres=int(count))
    document = {
        "centers": pack.centers.tolist(),
        "radii": pack.radii.tolist(),
        "seconds": time.perf_counter() - wall,
        "cpu_seconds": time.process_time() - cpu,
        "version": version("multisphere"),
    }
    Path(out).write_text(json.dumps(document))


if __name__ == "__main__":
    main(*sys.argv[1:])
