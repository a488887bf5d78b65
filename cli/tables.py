"""`coslobe tables`: build the lobe tables, report their error, draw what they hold."""

import time
from pathlib import Path
from typing import Annotated, Any

import typer

from coslobe.cli.common import JsonOption, command, print_json, progress, say

app = typer.Typer(help="Build, check and draw the lobe tables.", no_args_is_help=True)

SCALES = (("energy", "energy-conserving scale"), ("l2", "L2 scale"))
STATISTICS = ("mean", "variance", "median", "max")


@app.command()
@command
def build(
    output: Annotated[
        Path | None, typer.Option("-o", "--output", help="Also write them to this file.")
    ] = None,
    force: Annotated[bool, typer.Option("--force", help="Build again even where they are cached.")] = False,
    json: JsonOption = False,
) -> None:
    """Build the tables of lobe products, lobe integrals and caps, and keep them in the cache."""
    from coslobe.tables import errors, store

    start = time.perf_counter()
    with progress() as listener:
        tables = store.cached(listener, force=force)
    if output is not None:
        store.save(output, tables)
    seconds = time.perf_counter() - start
    file = output or store.cached_path()
    document = {"file": file, "seconds": seconds, "bytes": file.stat().st_size, **errors.report(tables)}
    if json:
        print_json(document)
        return
    say(f"{file}: {document['bytes'] / 1e6:.1f} MB, {seconds:.1f} s")
    _show(document)


@app.command()
@command
def check(json: JsonOption = False) -> None:
    """Verify the cached tables against exact cases and measure their error in three samplings."""
    from coslobe.tables import errors, store

    with progress() as listener:
        document = errors.full_report(store.cached(listener), listener)
    if json:
        print_json(document)
        return
    _show(document)
    for name, entry in document["samplings"].items():
        _heading(f"product, {name.replace('_', ' ')}", "max at e1, e2, alpha")
        say(f"  {entry['sampling']}")
        for key, label in (*SCALES, ("exact_l2", "exact L2 fit")):
            _row(f"  {label}", entry[key])
    for name, entry in document["relative"].items():
        _heading(f"relative to G, exponents {name}", "max at e1, e2, alpha")
        say(f"  {entry['share']:.0%} of the products are above 1e-20 of their peak and counted")
        for key, label in SCALES:
            _row(f"  {label}", entry[key])
    paper = document["paper"]
    say(
        f"The paper: mean {paper['mean']:.4e}, variance {paper['variance']:.4e}, median {paper['median']:g} "
        f"({paper['note']})."
    )


@app.command()
@command
def plot(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder for the pictures.", file_okay=False)
    ] = Path("out/tables"),
    json: JsonOption = False,
) -> None:
    """Draw the counterparts of the paper's Figures 2, 3, 4, 6, 7 and 12 from the tables."""
    from coslobe.tables import figures, store

    with progress() as listener:
        files = figures.draw(store.cached(listener), output, listener)
    if json:
        print_json({"figures": files})
        return
    for file in files:
        say(str(file))


def _show(document: dict[str, Any]) -> None:
    _heading("absolute error of the integral")
    _row("product, L2 scale", document["product_error"]["l2"])
    _row("product, energy-conserving scale", document["product_error"]["energy"])
    _row("integral", document["integral_error"])
    _row("cap (L2 distance)", document["cap_error"])
    _row("lobe over cap (relative to its peak)", document["lobe_cap_error"])
    _row("shadow lobes (visible share)", document["weights_error"])


def _heading(title: str, last: str = "") -> None:
    say(f"{title:40}" + "".join(f"{key:>12}" for key in STATISTICS) + f"   {last}".rstrip())


def _row(name: str, row: dict[str, Any]) -> None:
    place = row.get("max_at")
    where = f"   {place['e1']:.4g}, {place['e2']:.4g}, {place['alpha']:.4g}" if place else ""
    say(f"{name:40}" + "".join(f"{row[key]:12.2e}" for key in STATISTICS) + where)
