"""The page of `coslobe eval --paper`, from its results file."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from coslobe.core.files import write_text
from coslobe.evaluate.report import embed
from coslobe.evaluate.report.page import Cell, Figure, Page, Section, Table, html
from coslobe.evaluate.report.table1 import table1_table
from coslobe.evaluate.verdicts import duration


def write_paper_report(results: Path) -> Path:
    """Write report.html beside a results.json of `coslobe eval --paper`."""
    document = json.loads(results.read_text())
    *figures, table = document["figures"]
    seconds = sum(figure["seconds"] for figure in document["figures"])
    page = Page(
        title="Cosine lobes, the figures of 2009 rebuilt",
        kind="the paper, rebuilt",
        lead="Meunier, Meneveaux, Aveneau and Ghazanfarpour, Cosine Lobes for Interactive Direct "
        f"Lighting in Dynamic Scenes (2009, hal-00401728): {len(figures)} figures and Table 1 beside the "
        f"published numbers, made in {duration(seconds)} on {document['device']['name'].strip()}. "
        "Pictures of the paper are not shown; cameras, lights and materials that its text does not "
        "give are ours.",
        sections=[
            _overview(figures),
            *(_figure(results.parent, figure) for figure in figures),
            replace(table1_table(document["table1"]), title=f"{table['figure']}: {table['title']}"),
        ],
        command=document["command"],
        facts=_facts(document),
    )
    path = results.parent / "report.html"
    write_text(path, html(page))
    return path


def _overview(figures: list[Mapping[str, Any]]) -> Section:
    """All numbers that the paper states in its figures, with ours."""
    rows = [
        [f"{figure['figure']}: {name}", *_cells(figure, name)]
        for figure in figures
        for name in figure["paper"]
    ]
    return Table(
        "The published numbers and ours",
        ["quantity", "paper", "here"],
        rows,
        "Rates and times are of different machines and different work: the paper's hold its whole frame "
        "on a laptop of 2007, ours the shading alone.",
    )


def _figure(folder: Path, figure: Mapping[str, Any]) -> Figure:
    return Figure(
        title=f"{figure['figure']}: {figure['title']}",
        pictures=[embed.png(folder / picture["file"], picture["label"]) for picture in figure["pictures"]],
        paper=figure["paper_text"],
        ours=figure["text"],
        rows=[(name, *_cells(figure, name)) for name in figure["ours"]],
        seconds=duration(figure["seconds"]),
    )


def _cells(figure: Mapping[str, Any], name: str) -> tuple[Cell, Cell]:
    """The paper's number and ours."""
    form, unit = figure["forms"][name]
    paper, ours = figure["paper"].get(name), figure["ours"][name]
    return Cell(_shown(paper, form, unit), paper), Cell(_shown(ours, form, unit), ours)


def _shown(value: float | None, form: str, unit: str) -> str:
    if value is None:
        return "–"
    return f"{100 * value:.3g} %" if form == "percent" else f"{value:{form}} {unit}".rstrip()


def _facts(document: Mapping[str, Any]) -> list[tuple[str, str]]:
    device = document["device"]
    return [
        ("device", f"{device['name']} ({device['platform']}, {device['version']})"),
        ("processor", f"{document['processor']}, {document['cpus']} cores"),
        ("versions", ", ".join(f"{name} {version}" for name, version in document["versions"].items())),
        ("made", document["made"]),
    ]
