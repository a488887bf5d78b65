"""The demo: the whole main job on the Stanford bunny, from the mesh to a measured picture."""

from pathlib import Path
from typing import Any

from coslobe import configs
from coslobe.core.device import Device
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.evaluation import evaluate
from coslobe.render.scene import load_scene

COMPARED = (0, 12)  # the two ends of the light's way
SAMPLES = 256  # noise of the reference: 0.2 %


def run_demo(out_dir: Path, device: Device, command: str, progress: Progress = SILENT) -> dict[str, Any]:
    """Render the shipped bunny sequence and hold two of its frames against references; see `evaluate`.

    Spheres and tables are made and cached on first use; what is there already is kept.
    """
    scene_file = load_scene(configs.path("bunny"))
    return evaluate(
        scene_file,
        out_dir,
        frames=COMPARED,
        rendered=range(scene_file.frames),
        samples=SAMPLES,
        device=device,
        command=command,
        progress=progress,
    )
