"""Kernel throughput on every OpenCL device of this machine, written to benchmarks/RESULTS.md.

Times are profiling events of all kernels of a frame (no transfers), the median of REPEATS launches after two
warm-up launches. Seconds depend on the machine and on what else it does: compare rows of one run only.
"""

import datetime
import platform
import statistics
import subprocess
from dataclasses import dataclass
from pathlib import Path

from coslobe import configs
from coslobe.core.device import Device, DeviceInfo, cpu_count, devices
from coslobe.render.assets import Assets, world_blockers
from coslobe.render.gbuffer import trace_gbuffer
from coslobe.render.methods import create_method
from coslobe.render.scene import load_scene

HERE = Path(__file__).parent
REPEATS = 41
WARM_UP = 2
PAPER_FPS = (15.9, 10.1, 4.75)  # Fig. 17 (a) to (c), on a laptop of 2007


@dataclass(frozen=True)
class Row:
    """One measurement."""

    title: str
    points: int
    seconds: float
    spheres: int
    splats: float  # spheres rasterised per point and light
    paper_fps: float | None = None


def measure(device: Device, title: str, scene: str, frame: int, overrides: tuple[str, ...] = ()) -> Row:
    """Shade one frame of a shipped scene again and again."""
    at = load_scene(configs.path(scene), overrides).at(frame)
    assets = Assets(device)
    gbuffer, blockers = trace_gbuffer(at, assets), world_blockers(at, assets)
    method = create_method(at.shading.method, device)
    shadings = [method.shade(at, gbuffer, blockers) for _ in range(WARM_UP + REPEATS)][WARM_UP:]
    seconds = statistics.median(shading.kernel_seconds for shading in shadings)
    splats = shadings[0].skipped["spheres_splatted_per_pair"]
    return Row(title, len(gbuffer.position), seconds, len(blockers.radii), splats)


def measure_all(device: Device) -> list[Row]:
    """The set-ups of the table, in its order."""
    rows = []
    for frame, (letter, fps) in enumerate(zip("abc", PAPER_FPS, strict=True)):
        row = measure(device, f"Fig. 17 ({letter}), 128x128 plane points, Lambert", "fig17", frame)
        rows.append(Row(row.title, row.points, row.seconds, row.spheres, row.splats, fps))
    for count in (64, 256):
        plane = ("image.width=512", "image.height=512", f"objects.bunny.spheres.count={count}")
        rows.append(measure(device, "512x512 plane points, Lambert", "fig17", 0, plane))
    rows.append(measure(device, "bunny.yaml, 512x512, Phong and Lambert", "bunny", 0))
    return rows


def table(info: DeviceInfo, rows: list[Row]) -> str:
    """Markdown for one device."""
    lines = [
        f"## {info.name}, {info.version.split(',')[0]}, vectors of {info.vector_width}",
        "",
        "| set-up | spheres | splats per point | kernel, ms | Mpoints/s | fps | paper, fps | ratio |",
        "|---|---|---|---|---|---|---|---|",
    ]
    for row in rows:
        fps = 1 / row.seconds
        paper = f"{row.paper_fps} | {fps / row.paper_fps:.0f}x" if row.paper_fps else "- | -"
        lines.append(
            f"| {row.title} | {row.spheres} | {row.splats:.2f} | {row.seconds * 1e3:.2f} "
            f"| {row.points / row.seconds / 1e6:.1f} | {fps:.0f} | {paper} |"
        )
    return "\n".join(lines) + "\n"


def commit() -> str:
    """Short hash of the checkout, with a mark where it has changes."""
    command = ["git", "-C", str(HERE), "describe", "--always", "--dirty"]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def processor() -> str:
    """Name of the CPU."""
    cpuinfo = Path("/proc/cpuinfo")
    lines = cpuinfo.read_text().splitlines() if cpuinfo.exists() else []
    names = [line.split(":")[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor()


def main() -> None:
    parts = [
        "# Kernel throughput",
        "",
        f"{datetime.date.today()}, commit {commit()}, {cpu_count()} CPU cores ({processor()}).",
        f"Median of {REPEATS} launches after {WARM_UP}, profiling events, no transfers.",
        "The paper's figures are whole shading loops on a laptop CPU of 2007 (Core 2 Duo T7500).",
        "",
    ]
    for info in devices():
        if info.ok:
            parts.append(table(info, measure_all(Device(info))))
            print(parts[-1])
    (HERE / "RESULTS.md").write_text("\n".join(parts))


if __name__ == "__main__":
    main()
