"""`coslobe eval --paper`: the figures of the 2009 paper in one page."""

from pathlib import Path

from coslobe.cli.common import print_json, progress, say


def rebuild(out: Path | None, wish: str | None, command: str, json: bool) -> None:
    """Rebuild all figures and say where their page is."""
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
        say(f"Fig. {figure['figure']:>2}: {figure['title']}, {duration(figure['seconds'])}")
    say(f"report: {document['report']}")
