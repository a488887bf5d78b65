"""`coslobe eval --table1`: time of the shading kernel by stage."""

from pathlib import Path

from coslobe.cli.common import print_json, progress, say
from coslobe.core.errors import UsageError


def measure_stages(
    scene: Path | None, out: Path | None, wish: str | None, *, command: str, json: bool
) -> None:
    """Measure the scenes of the paper's Table 1, and print it beside ours."""
    if scene is not None:
        raise UsageError(
            f"--table1 measures the scenes of the paper's table, not {scene}", "leave the scene out"
        )
    from coslobe.core.device import open_device
    from coslobe.evaluate.table1 import MAPPING, STAGES, write_table1
    from coslobe.evaluate.verdicts import duration

    with progress() as listener:
        document = write_table1(
            out or Path("out", "table1"), device=open_device(wish), command=command, progress=listener
        )
    if json:
        print_json(document)
        return
    for estimator, texts in MAPPING.items():
        say(f"estimator {estimator}:")
        for stage, text in texts.items():
            say(f"  ({stage}) {STAGES[stage]}: {text}")
    say("percent             " + "".join(f"{f'({stage})':>7}" for stage in STAGES) + "      sum    fused")
    for total in document["totals"]:
        own = [
            row
            for row in document["rows"]
            if (row["scene"], row["estimator"]) == (total["scene"], total["estimator"])
        ]
        numbers = "".join(f"{row['percent']:7.1f}" for row in own)
        times = "".join(f"{duration(total[name]):>9}" for name in ("sum_seconds", "fused_seconds"))
        say(f"{total['scene']:6} {total['estimator']:13}{numbers}{times}")
        if total["estimator"] == document["totals"][-1]["estimator"]:
            say(f"{total['scene']:6} published    " + "".join(f"{row['paper_percent']:7.1f}" for row in own))
    say(f"report: {document['report']}")
