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
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Open the recording of a run.

    Example: palpmap review runs/first --summary
    """
    if png and summary:
        raise typer.BadParameter("give --png or --summary, not both")
    from palpmap.commands.review import run_review

    return run_review(run=run, png=png, summary=summary, output=Output(quiet=quiet, json=json))
