"""Quality and time of sphere fits, of every method and of an installable rival, written to FITS.md.

All sets are measured by the same evaluator against the same mesh. Rows are kept in out/fits.json as they
are finished, under a hash of the code that made them: an interrupted run goes on where it was.
"""

import argparse
import datetime
import json
import subprocess
import sys
import tempfile
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

from coslobe.core import cache
from coslobe.core.device import Device, cpu_count, open_device
from coslobe.core.files import write_json
from coslobe.evaluate.provenance import commit, processor
from coslobe.spheresets.fit import METHODS
from coslobe.spheresets.mesh import Mesh, load_mesh
from coslobe.spheresets.metrics import measure
from coslobe.spheresets.model import SphereSet
from coslobe.spheresets.solid import Solid

HERE = Path(__file__).parent
ROWS = HERE.parent / "out" / "fits.json"
DATA = HERE.parents[1] / "shared" / "data" / "meshes"
MESHES = {
    "bunny": "sample:bunny",
    "spot": "spot.obj",
    "hand": "hand_closed.obj",
    "torus": "torus.obj",
    "suzanne": "suzanne_pmndrs.glb",
    "penguin": "penguin.obj",
    "goathead": "goathead.obj",
    "Fox": "Fox.glb",
}
SUMMED_UP = ("bunny", "spot", "hand", "torus")
COUNTS = (16, 64, 256, 1024)
RIVAL = "multisphere"
TOOLS = ("balanced fast", "balanced best", *(f"{name} fast" for name in METHODS if name != "balanced"), RIVAL)

COLUMNS = (
    "spheres",
    "silhouette IoU mean",
    "min",
    "volume IoU",
    "outside",
    "sum outside",
    "uncovered",
    "gap",
    "Hausdorff to union",
    "to mesh",
    "shadow .05",
    ".3",
    ".8",
    "bias .3",
    "CPU s",
    "s",
)
SUMMARY = ("tool", "silhouette IoU mean", "volume IoU", "gap", "shadow .3", "CPU s")


def fit(tool: str, source: str, mesh: Mesh, count: int, timeout: float, folder: Path) -> dict[str, Any]:
    """Centers, radii and times; or, in words, what went wrong."""
    out = folder / "spheres.json"
    out.unlink(missing_ok=True)
    if tool == RIVAL:
        path = folder / "mesh.stl"
        trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).export(path)
        command = [HERE / "rival.py", path, str(count), out]
    else:
        command = [HERE / "fit_one.py", source, str(count), *tool.split(), out]
    try:
        done = subprocess.run(
            [sys.executable, *command], capture_output=True, text=True, timeout=timeout, check=False
        )
    except subprocess.TimeoutExpired:
        return {"failed": f"not done in {timeout:.0f} s"}
    if done.returncode or not out.exists():
        lines = done.stderr.strip().splitlines()
        return {"failed": lines[-1] if lines else f"exit status {done.returncode}"}
    return json.loads(out.read_text())


def judge(found: dict[str, Any], solid: Solid, device: Device) -> dict[str, Any]:
    """The row: times and metrics, without the spheres."""
    if "failed" in found:
        return found
    centers, radii = np.array(found.pop("centers")), np.array(found.pop("radii"))
    metrics = measure(solid, SphereSet(centers, radii, np.zeros(len(radii))), device)
    return {**found, "count": len(radii), "metrics": metrics}


def cells(row: dict[str, Any]) -> list[str]:
    """Text for COLUMNS."""
    if "failed" in row:
        return [row["failed"].replace("|", "/"), *["-"] * (len(COLUMNS) - 1)]
    m = row["metrics"]
    lengths = (m["max_gap"], m["hausdorff_mesh_to_union"], m["hausdorff_union_to_mesh"])
    volumes = (m["volume_iou"], m["outside_volume"], m["sum_outside_volume"], m["uncovered_volume"])
    return [
        str(row["count"]),
        *(f"{value:.3f}" for value in (m["silhouette_iou_mean"], m["silhouette_iou_min"], *volumes)),
        *(f"{value:.4f}" for value in (*lengths, *m["shadow_rmse_no_contact"])),
        f"{m['shadow_bias'][1]:+.4f}",
        f"{row['cpu_seconds']:.1f}",
        f"{row['seconds']:.1f}",
    ]


def table(header: tuple[str, ...], lines: list[list[str]]) -> list[str]:
    """Markdown."""
    return [f"| {' | '.join(line)} |" for line in ([*header], ["---"] * len(header), *lines)] + [""]


def summary(rows: dict[str, dict[str, Any]], count: int) -> list[list[str]]:
    """Per tool the mean over SUMMED_UP, where it did all of them with as many spheres as asked for."""
    lines = []
    for tool in TOOLS:
        found = [rows.get(name_of(mesh, count, tool), {}) for mesh in SUMMED_UP]
        if any(row.get("count") != count for row in found):
            continue
        m = [row["metrics"] for row in found]
        lines.append(
            [
                tool,
                f"{np.mean([one['silhouette_iou_mean'] for one in m]):.4f}",
                f"{np.mean([one['volume_iou'] for one in m]):.4f}",
                f"{np.mean([one['max_gap'] for one in m]):.4f}",
                f"{np.mean([one['shadow_rmse_no_contact'][1] for one in m]):.4f}",
                f"{np.mean([row['cpu_seconds'] for row in found]):.1f}",
            ]
        )
    return lines


def name_of(mesh: str, count: int, tool: str) -> str:
    return f"{mesh}, {count}, {tool}"


def report(rows: dict[str, dict[str, Any]]) -> str:
    """The document, of all rows there are."""
    lines = [
        "# Sphere fits",
        "",
        f"{datetime.date.today()}, commit {commit()}, {cpu_count()} CPU cores ({processor()}).",
        "Columns are the metrics of docs/sphere_sets.md, shadow errors those without contact; seconds cover",
        "sampling and the finest level, by the processor time of all cores and by the clock.",
        "",
    ]
    for count in COUNTS:
        if means := summary(rows, count):
            lines += [f"## {count} spheres, mean of {', '.join(SUMMED_UP)}", "", *table(SUMMARY, means)]
    for mesh in MESHES:
        found = [
            [str(count), tool, *cells(rows[name_of(mesh, count, tool)])]
            for count in COUNTS
            for tool in TOOLS
            if name_of(mesh, count, tool) in rows
        ]
        if found:
            lines += [f"## {mesh}", "", *table(("N", "tool", *COLUMNS), found)]
    return "\n".join(lines)


def options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("--meshes", nargs="+", choices=MESHES, default=list(MESHES))
    parser.add_argument("--counts", nargs="+", type=int, choices=COUNTS, default=list(COUNTS))
    parser.add_argument("--tools", nargs="+", choices=TOOLS, default=list(TOOLS))
    parser.add_argument("--data", type=Path, default=DATA, help="folder of the meshes")
    parser.add_argument("--timeout", type=float, default=900, help="seconds for one fit")
    parser.add_argument("--report", type=Path, default=HERE / "FITS.md")
    return parser.parse_args()


def main() -> None:
    wanted = options()
    tools = list(wanted.tools)
    if RIVAL in tools and find_spec(RIVAL) is None:
        print(f"{RIVAL} is not installed and left out: pip install -c constraints.txt '.[benchmark]'")
        tools.remove(RIVAL)
    code = cache.code_digest("spheresets", "spheresets.kernels")
    kept = json.loads(ROWS.read_text()) if ROWS.exists() else {}
    rows = {name: row for name, row in kept.items() if row["code"] in (code, RIVAL)}
    device, warm = open_device(), {RIVAL}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        for title in wanted.meshes:
            source = (
                MESHES[title] if MESHES[title].startswith("sample:") else str(wanted.data / MESHES[title])
            )
            if not source.startswith("sample:") and not Path(source).exists():
                print(f"{source} is not there and left out")
                continue
            mesh = load_mesh(source)
            solid = Solid(mesh)
            for count in wanted.counts:
                for tool in tools:
                    key = name_of(title, count, tool)
                    if key in rows:
                        continue
                    if tool not in warm:  # kernels compile outside of the times
                        fit(tool, source, mesh, 4, wanted.timeout, folder)
                        warm.add(tool)
                    row = judge(fit(tool, source, mesh, count, wanted.timeout, folder), solid, device)
                    rows[key] = {**row, "code": RIVAL if tool == RIVAL else code}
                    print(f"{key}: {' '.join(cells(row))}", flush=True)
                    write_json(ROWS, rows)
    wanted.report.write_text(report(rows))


if __name__ == "__main__":
    main()
