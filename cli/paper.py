"""`coslobe eval --paper`: the figures of the 2009 paper and its Table 1 in one page."""

from pathlib import Path

from coslobe.cli.common import print_json, progress, say
from coslobe.core.errors import UsageError


def rebuild(scene: Path | None, out: Path | None, wish: str | None, *, command: str, json: bool) -> None:
    """Rebuild all figures and say where their page is."""
    if scene is not None:
        raise UsageError(
            f"--paper rebuilds the figures from scenes that come along, not {scene}", "leave the scene out"
        )
    from coslobe.core.device import open_device
    from coslobe.evaluate.paper_page import rebuild_paper
    from coslobe.evaluate.verdicts import duration

    with progress() as listener:
        document = rebuild_paper(
            out or Path("out", "paper"), device=open_device(wish), command=command, progress=listener
        )
    if json:
        print_json(document)
        return
    for figure in document["figures"]:
        say(f"{figure['figure']}: {figure['title']}, {duration(figure['seconds'])}")
    say(f"report: {document['report']}")
