"""`coslobe tables`: build the lobe tables and report their error."""

from pathlib import Path
from typing import Annotated, Any

import typer

from coslobe.cli.common import JsonOption, command, print_json, progress, say

app = typer.Typer(help="Build and check the lobe tables.", no_args_is_help=True)


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
    from coslobe.tables import store

    with progress() as listener:
        document = store.build_to(output, listener, force=force)
    _show(document, json)


@app.command()
@command
def check(json: JsonOption = False) -> None:
    """Verify the cached tables against exact cases and measure their error."""
    from coslobe.tables import store

    with progress() as listener:
        document = store.report(store.cached(listener))
    _show(document, json)


def _show(document: dict[str, Any], json: bool) -> None:
    if json:
        print_json(document)
        return
    if "file" in document:
        say(f"{document['file']}: {document['bytes'] / 1e6:.1f} MB, {document['seconds']:.1f} s")
    rows = {
        "product, L2 scale": document["product_error"]["l2"],
        "product, energy-conserving scale": document["product_error"]["energy"],
        "integral": document["integral_error"],
        "cap (L2 distance)": document["cap_error"],
        "lobe over cap (relative to its peak)": document["lobe_cap_error"],
    }
    say(f"{'absolute error of the integral':40}{'mean':>12}{'variance':>12}{'median':>12}{'max':>12}")
    for name, row in rows.items():
        say(f"{name:40}" + "".join(f"{row[key]:12.2e}" for key in ("mean", "variance", "median", "max")))
