"""Speed on every OpenCL device of this machine, beside ray tracers and the 2009 paper: benchmarks/RESULTS.md.

`python benchmarks/run.py` fails where a ratio is worse than the recorded one (ratios.json) by more than 15 %;
`--record` replaces what is recorded. `--without-rivals` leaves out Embree's and Mitsuba's fronts: two minutes
instead of eight.
"""

import argparse
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import guard
import whole
from interleaved import PAPER_FPS, ROUNDS, Measured, measure, ratio

from coslobe.core.device import Device, DeviceInfo, devices, select
from coslobe.evaluate.pareto import measure_fronts
from coslobe.evaluate.provenance import provenance

HERE = Path(__file__).parent
OUT = HERE.parent / "out" / "bench"
GOALS = {"fig17a": 120, "fig17b": 120, "fig17c": 120, "fig14": 100, "fig16": 60}
GOAL_FIG18 = 0.06  # seconds
RIVAL_GOALS = {("embree", "lambert"): 60, ("mitsuba", "lambert"): 50}
RIVAL_GOAL = 30  # with other materials
SPHERES = 256


@dataclass(frozen=True)
class Row:
    """One line of the table: what, how much, what was to be reached, whether it was, and the guarded cost."""

    title: str
    found: str
    goal: str
    met: bool
    cost: float | None = None


def kernel_rows(device: Device) -> list[Row]:
    """Figures of the paper, and how cost grows."""
    measured, rays = measure(device)
    rows = [_figure_row(name, measured[name], rays) for name in PAPER_FPS]

    def growth(title: str, above: str, below: str, most: float) -> Row:
        found = ratio(measured[above], measured[below])
        return Row(title, f"{found:.3g}x", f"<= {most:g}x", found <= most, found)

    return [
        *rows,
        growth("4096 spheres over 64, same object", "spheres 4096", "spheres 64", 3),
        growth("one more light that reaches no point", "light that reaches nothing", "base", 1.03),
        growth("one more object that shadows no point", "object that shadows nothing", "base", 1.03),
        growth("32 lights over 1, all visible", "lights 32", "lights 1", 16),
    ]


def _figure_row(name: str, found: Measured, rays: float) -> Row:
    """Kernel time of a figure beside the paper's; guarded is what a point costs in Embree's shadow rays."""
    fps = 1 / found.median
    cost = found.median / found.points * rays
    times = fps / PAPER_FPS[name]
    text = f"{found.median * 1e3:.2f} ms, {found.points / found.median / 1e6:.1f} Mpoints/s, "
    text += f"{times:.0f}x the paper's {PAPER_FPS[name]:g} fps; a point costs {cost:.2g} shadow rays"
    title = f"Fig. {name.removeprefix('fig')}, {found.points:,} points"
    if name == "fig18":
        return Row(title, text, f"<= {GOAL_FIG18:g} s", found.median <= GOAL_FIG18, cost)
    return Row(title, text, f">= {GOALS[name]}x", times >= GOALS[name], cost)


def whole_rows(device: DeviceInfo) -> list[Row]:
    """Commands in processes of their own."""
    frame = whole.outside_share(device.index)
    cold, warm = whole.build_seconds(device.index)
    memory = whole.memory_of_4k(device.index) / 1e9
    share = f"{100 * frame['outside']:.0f} % of {frame['seconds'] * 1e3:.0f} ms"
    share += f", of which primary rays {100 * frame['gbuffer']:.0f} %"
    return [
        Row(
            "outside the kernels, 512x512 sequence",
            share,
            "<= 50 %",
            frame["outside"] <= 0.5,  # not guarded: faster kernels raise this share
        ),
        Row("program build, cold", f"{cold:.2f} s", "<= 3 s", cold <= 3),
        Row("program build, warm", f"{warm:.2f} s", "<= 0.1 s", warm <= 0.1),
        Row("memory of a 4K frame, 1024 spheres", f"{memory:.2f} GB", "<= 1.5 GB", memory <= 1.5, memory),
    ]


def rival_rows(document: Mapping[str, Any], device: str) -> list[Row]:
    """Speed-ups at equal error with 256 spheres."""
    rows = []
    for found in document["speedups"]:
        if found["spheres"] == SPHERES and found["device"] == device:
            goal = RIVAL_GOALS.get((found["against"], found["material"]), RIVAL_GOAL)
            text = f"{found['speedup']:.0f}x at {100 * found['at_error']:.2g} % error"
            text += f" (depth {found['setting']['depth']}{', extrapolated' * found['extrapolated']})"
            title = f"speed-up over {found['against'].capitalize()}, {SPHERES} spheres, {found['material']}"
            rows.append(Row(title, text, f">= {goal}x", found["speedup"] >= goal, 1 / found["speedup"]))
    return rows


def table(info: DeviceInfo, rows: list[Row]) -> str:
    """Markdown for one device."""
    lines = [
        f"## {info.name}, {info.version.split(',')[0].strip()}, vectors of {info.vector_width}",
        "",
        "| figure | measured | goal | met |",
        "|---|---|---|---|",
        *(f"| {row.title} | {row.found} | {row.goal} | {'yes' if row.met else 'no'} |" for row in rows),
        "",
    ]
    return "\n".join(lines)


def page(made: Mapping[str, Any], tables: list[str]) -> str:
    """RESULTS.md."""
    return "\n".join(
        [
            "# Speed",
            "",
            f"{made['made'][:10]}, commit {made['commit']}, {made['cpus']} CPU cores ({made['processor']}), "
            f"load {made['load_average']:.1f} when it began.",
            f"Kernel times are medians of {ROUNDS} rounds in which set-ups take turns, by profiling events.",
            "[README.md](README.md) says how each line is measured.",
            "",
            *tables,
        ]
    )


def main() -> None:
    """Measure, write the page, and compare with what is recorded."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--record", action="store_true", help="replace the recorded ratios")
    parser.add_argument(
        "--without-rivals", action="store_true", help="leave out Embree's and Mitsuba's fronts"
    )
    options = parser.parse_args()
    made = provenance()
    default = select().index
    usable = [Device(info) for info in devices() if info.ok]
    rivals = None
    if not options.without_rivals:
        command = "python benchmarks/run.py"
        rivals = measure_fronts(None, OUT / "pareto", counts=(SPHERES,), devices=usable, command=command)
    tables, costs = [], {}
    for device in usable:
        rows = kernel_rows(device)
        if device.info.index == default:  # what the host does is much the same with others
            rows += whole_rows(device.info)
        rows += rival_rows(rivals, device.info.name) if rivals else []
        tables.append(table(device.info, rows))
        print(tables[-1], flush=True)
        name = f"{device.info.name}, {device.info.version.split(',')[0].strip()}"
        costs[name] = {row.title: row.cost for row in rows if row.cost is not None}
    (HERE / "RESULTS.md").write_text(page(made, tables))
    recorded = HERE / "ratios.json"
    worse = guard.regressions(costs, guard.read(recorded))
    if options.record:
        guard.record(recorded, costs)
    elif worse:
        sys.exit("slower than recorded:\n" + "\n".join(map(str, worse)))


if __name__ == "__main__":
    main()
