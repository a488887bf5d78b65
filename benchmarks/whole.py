"""Whole commands in processes of their own: what a frame costs outside its kernels, builds, and memory."""

import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import Any

from coslobe import configs
from coslobe.core import cache

COMMAND = (sys.executable, "-c", "from coslobe.cli.main import main; main()")


def render(device: int, scene: str, *arguments: str, **environment: str) -> tuple[dict[str, Any], int]:
    """The JSON document of `coslobe render`, and the most memory that it took, in bytes."""
    with tempfile.TemporaryDirectory(prefix="coslobe-bench-") as folder:
        command = [*COMMAND, "render", str(configs.path(scene)), "-o", folder, "--device", str(device)]
        command += ["--json", *arguments]
        with Path(folder, "document.json").open("w+") as document:
            child = subprocess.Popen(command, stdout=document, env={**os.environ, **environment})
            _, status, usage = os.wait4(child.pid, 0)
            child.returncode = os.waitstatus_to_exitcode(status)
            if child.returncode:
                raise SystemExit(f"failed with {child.returncode}: {' '.join(command)}")
            document.seek(0)
            return json.loads(document.read()), usage.ru_maxrss * 1024


def outside_share(device: int, frames: int = 12) -> dict[str, float]:
    """Shares of a frame of the demo's sequence that are not its kernels, and that are primary rays."""
    document, _ = render(device, "bunny", "--frames", f"0:{frames}")
    parts = document["frames"][2:]  # after the first, the disk and the caches are warm
    total = sum(part["seconds"] for part in parts)
    return {
        "seconds": total / len(parts),
        "outside": 1 - sum(part["kernel_seconds"] for part in parts) / total,
        "gbuffer": sum(part["gbuffer_seconds"] for part in parts) / total,
    }


def build_seconds(device: int) -> tuple[float, float]:
    """Of the programs of Fig. 17, with empty caches of the runtimes, and with what that left there."""
    own = {"COSLOBE_CACHE_DIR": str(cache.folder())}
    with tempfile.TemporaryDirectory(prefix="coslobe-cold-") as folder:
        own |= {"XDG_CACHE_HOME": folder, "POCL_CACHE_DIR": folder}
        cold, warm = (render(device, "fig17", "--frames", "0", **own)[0] for _ in range(2))
    return cold["build_seconds"], warm["build_seconds"]


def memory_of_4k(device: int) -> int:
    """Bytes at most, of a 3840 x 2160 frame of the demo with 1024 spheres."""
    size = ("--set", "image.width=3840", "--set", "image.height=2160")
    arguments = (*size, "--set", "objects.bunny.spheres.count=1024", "--frames", "0")
    return render(device, "bunny", *arguments)[1]
