"""`coslobe eval --compare A.json B.json`: what changed between two runs."""

from pathlib import Path

import typer

from coslobe.cli.common import print_json, say

MOST_LINES = 30


def compare(first: Path, second: Path, *, error: float, time: float | None, json: bool) -> None:
    """Print what changed; end with status 1 where it is beyond the thresholds."""
    from coslobe.evaluate.compare import Thresholds, compare_results

    document = compare_results(first, second, Thresholds(error, time))
    if json:
        print_json(document)
    else:
        changed = [change for change in document["changes"] if change["verdict"] not in ("same", "noise")]
        shown = sorted(changed, key=lambda change: change["verdict"] != "beyond")[:MOST_LINES]
        for change in shown:
            by = "from 0" if change["worse"] is None else f"{100 * change['worse']:+.1f} %"
            numbers = f"{change['before']:.4g} -> {change['after']:.4g}"
            say(f"{change['verdict']:>6}  {by:>9}  {change['place']}: {change['metric']}: {numbers}")
        if len(changed) > len(shown):
            say(f"... and {len(changed) - len(shown)} more")
        for name in document["missing"]:
            say(f"missing in {second}: {name}")
        same = len(document["changes"]) - len(changed)
        say(f"{same} numbers are the same or within the reference's noise, {len(changed)} changed")
        say("holds" if document["holds"] else "does not hold")
    if not document["holds"]:
        raise typer.Exit(1)
