"""`palpmap review`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def review(
    run: Annotated[Path, typer.Argument(metavar="RUN", help="Run folder or .rrd recording.")],
    png: Annotated[
        bool, typer.Option("--png", help="Render the layout to a picture, without a display.")
    ] = False,
    summary: Annotated[
        bool, typer.Option("--summary", help="Print what the recording holds, without a viewer.")
    ] = False,
    time: Annotated[
        float | None,
        typer.Option("--time", metavar="S", min=0, help="With --png: show this time of the scan."),
    ] = None,
    press: Annotated[
        int | None,
        typer.Option("--press", metavar="N", min=0, help="With --png: show this press."),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Open the recording of a run.

    Example: palpmap review runs/first --summary
    """
    if png and summary:
        raise typer.BadParameter("give --png or --summary, not both")
    if (time is not None or press is not None) and (not png or None not in (time, press)):
        raise typer.BadParameter("--time and --press go with --png, one of them")
    from palpmap.commands.review import run_review
    from palpmap.recording.viewer import Instant

    at = None if time is None and press is None else Instant(time, press)
    output = Output(quiet=quiet, json=json)
    return run_review(run=run, png=png, summary=summary, output=output, at=at)
