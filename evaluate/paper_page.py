"""`coslobe eval --paper`: every figure and table of the 2009 paper, rebuilt beside its published numbers."""

import csv
import io
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from coslobe.core.device import Device
from coslobe.core.errors import CoslobeError
from coslobe.core.files import write_json, write_text
from coslobe.core.progress import SILENT, Progress
from coslobe.evaluate.paper_figures import lobe_sums, lobe_tables, masks, scenes, thresholds
from coslobe.evaluate.paper_figures.bench import Bench
from coslobe.evaluate.paper_figures.figure import PaperFigure
from coslobe.evaluate.provenance import provenance
from coslobe.evaluate.report.paper import write_paper_report
from coslobe.evaluate.table1 import measure_table1

FIGURES: tuple[PaperFigure, ...] = tuple(
    sorted(
        (figure for group in (lobe_sums, lobe_tables, masks, scenes, thresholds) for figure in group.FIGURES),
        key=lambda figure: figure.number,
    )
)


def rebuild_paper(
    out_dir: Path,
    *,
    device: Device,
    command: str,
    progress: Progress = SILENT,
    chosen: Sequence[PaperFigure] = FIGURES,
) -> dict[str, Any]:
    """Rebuild the `chosen` figures and Table 1; write results.json, .csv, report.html and figures/*.png.

    Returns
    -------
    dict
        results, report and figures: figure, title, ours and paper (numbers by name), seconds.

    Raises
    ------
    CoslobeError
        A figure cannot be made; the message names it.
    """
    bench = Bench(device, progress)
    figures = []
    with progress.task("rebuilding the paper", len(chosen)) as advance:
        for figure in chosen:
            figures.append(_rebuilt(figure, bench, out_dir))
            advance(note=f"Fig. {figure.number}")
    start = time.perf_counter()
    table1 = measure_table1(device, progress)
    figures.append(_table_entry(table1, time.perf_counter() - start))
    document = {
        "format": "coslobe-paper/1",
        "command": command,
        **provenance(),
        "device": device.describe(),
        "figures": figures,
        "table1": table1,
    }
    results = out_dir / "results.json"
    write_json(results, document)
    write_text(out_dir / "results.csv", _csv(figures))
    report = write_paper_report(results)
    names = ("figure", "title", "ours", "paper", "seconds")
    shown = [{name: figure[name] for name in names} for figure in figures]
    return {"results": results, "report": report, "figures": shown}


def _rebuilt(figure: PaperFigure, bench: Bench, out_dir: Path) -> dict[str, Any]:
    start = time.perf_counter()
    try:
        rebuilt = figure.rebuild(bench, out_dir / "figures")
    except CoslobeError as error:
        raise CoslobeError(f"Fig. {figure.number}, {figure.title}: {error}", error.hint) from error
    quantities = rebuilt.quantities
    return {
        "figure": f"Fig. {figure.number}",
        "title": figure.title,
        "ours": {quantity.name: quantity.ours for quantity in quantities},
        "paper": {q.name: q.paper for q in quantities if q.paper is not None},
        "seconds": time.perf_counter() - start,
        "paper_text": figure.paper,
        "text": rebuilt.text,
        "forms": {quantity.name: [quantity.form, quantity.unit] for quantity in quantities},
        "pictures": [
            {"label": label, "file": str(path.relative_to(out_dir))} for label, path in rebuilt.pictures
        ],
    }


def _table_entry(table: dict[str, Any], seconds: float) -> dict[str, Any]:
    """Table 1 as the figures are: shares of the time by estimator, scene and stage."""
    ours: dict[str, float | None] = {}
    paper: dict[str, float] = {}
    for row in table["rows"]:
        name = f"stage ({row['stage']}) of Fig. {row['scene']}, estimator {row['estimator']}"
        ours[name], paper[name] = row["percent"] / 100, row["paper_percent"] / 100
    return {
        "figure": "Table 1",
        "title": "Time of the shading loop by stage",
        "ours": ours,
        "paper": paper,
        "seconds": seconds,
    }


def _csv(figures: Sequence[dict[str, Any]]) -> str:
    """Long form: figure, quantity, ours, paper."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("figure", "quantity", "ours", "paper"))
    for figure in figures:
        for name, value in figure["ours"].items():
            writer.writerow((figure["figure"], name, value, figure["paper"].get(name)))
    return text.getvalue()
