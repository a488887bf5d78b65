"""Table 1 of the 2009 paper beside ours: a section of a page, an HTML fragment, the page of `--table1`."""

import json
from collections.abc import Mapping
from html import escape
from pathlib import Path
from typing import Any

from coslobe.core.files import write_text
from coslobe.evaluate.report.page import Cell, Page, Table, html
from coslobe.evaluate.verdicts import duration

Document = Mapping[str, Any]

STAGES = {
    "a": "reflectance",
    "b": "lighting",
    "c": "mask",
    "d": "mask lobes",
    "e": "integration",
}


def table1_table(document: Document) -> Table:
    """Percent by stage of each scene: both estimators', the published under them; the kernel's times."""
    rows: list[list[Cell | str]] = []
    strong = set()
    for scene in dict.fromkeys(total["scene"] for total in document["totals"]):
        for total in document["totals"]:
            if total["scene"] != scene:
                continue
            found = {
                row["stage"]: row
                for row in document["rows"]
                if row["scene"] == scene and row["estimator"] == total["estimator"]
            }
            if total["estimator"] == "paper":
                strong.add(len(rows))
            times = (total["sum_seconds"], total["fused_seconds"])
            rows.append(
                [
                    f"Fig. {scene}",
                    f"ours, {total['estimator']}",
                    *(_percent(found[stage]["percent"]) for stage in STAGES),
                    *(Cell(duration(seconds), seconds) for seconds in times),
                ]
            )
        published = {row["stage"]: row["paper_percent"] for row in document["rows"] if row["scene"] == scene}
        rows.append(
            [
                f"Fig. {scene}",
                "published",
                *(_percent(published[stage]) for stage in STAGES),
                *(Cell("–", None, faint=True) for _ in range(2)),
            ]
        )
    return Table(
        title="Where the kernel's time goes",
        text="Percent of the processor time of the stages (a) to (e) of the report, in order. The estimator "
        "“paper” has all of them; “accurate” has no lobes for lights and masks: its rows hold what takes "
        "their place.",
        groups=[("", 2), ("percent of the time", len(STAGES)), ("processor time", 2)],
        columns=["scene", "by", *STAGES.values(), "sum", "fused"],
        rows=rows,
        notes=[
            (f"{STAGES[stage]}, “{estimator}”", text)
            for estimator, texts in document["mapping"].items()
            for stage, text in texts.items()
        ]
        + [
            (
                "sum",
                "of all threads, with what it takes to start the kernel, read points and write pictures",
            ),
            ("fused", "the same functions in the one kernel that is used, of all threads"),
        ],
        strong=frozenset(strong),
    )


def table1_html(document: Document) -> str:
    """The table and its notes as a fragment of HTML."""
    table = table1_table(document)
    groups = "".join(
        f'<th colspan="{span}" scope="colgroup">{escape(name)}</th>' for name, span in table.groups
    )
    columns = "".join(f'<th scope="col">{escape(name)}</th>' for name in table.columns)
    body = ""
    for k, cells in enumerate(table.cells):
        first, *others = (escape(cell.text) for cell in cells)
        mark = ' class="strong"' if k in table.strong else ""
        body += (
            f'<tr{mark}><th scope="row">{first}</th>{"".join(f"<td>{text}</td>" for text in others)}</tr>\n'
        )
    notes = "".join(f"<dt>{escape(name)}</dt><dd>{escape(text)}</dd>" for name, text in table.notes)
    return (
        f'<p>{escape(table.text)}</p>\n<div class="wide"><table>\n<thead><tr class="groups">{groups}</tr>'
        f'<tr class="columns">{columns}</tr></thead>\n<tbody>\n{body}</tbody></table></div>\n'
        f'<dl class="notes">{notes}</dl>\n'
    )


def write_table1_report(results: Path) -> Path:
    """Write report.html beside a results.json of `--table1`."""
    document = json.loads(results.read_text())
    device = document["device"]
    page = Page(
        title="Table 1: time by stage",
        kind="the shading kernel in stages",
        lead="What parts of the shading kernel take, beside what the report of 2009 published.",
        sections=[table1_table(document)],
        command=document["command"],
        facts=[
            ("device", f"{device['name']} ({device['version']})"),
            ("processor", f"{document['processor']}, {document['cpus']} cores used"),
            ("load when it began", f"{document['load_average']:.2f}"),
            ("versions", ", ".join(f"{name} {version}" for name, version in document["versions"].items())),
            ("coslobe", f"{document['version']}, commit {document['commit'] or 'unknown'}"),
            ("made", document["made"]),
        ],
    )
    path = results.parent / "report.html"
    write_text(path, html(page))
    return path


def _percent(value: float) -> Cell:
    return Cell(f"{value:.1f}", value)
