"""`palpmap reveal`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def reveal(
    trial: Annotated[Path, typer.Argument(metavar="TRIAL", help="Folder of `palpmap blind`.")],
    answer: Annotated[
        str | None,
        typer.Option(
            "--answer",
            metavar="NAME,...",
            help="Your own answer: effects, or none, or unexplained.",
            show_default="the newest result.json below the folder",
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Show what was hidden in a blind trial beside what was found.

    Exit code 1 if the answer does not pass.

    Example: palpmap reveal trial
    """
    from palpmap.blind.reveal import run_reveal

    return run_reveal(trial=trial, answer=answer, output=Output(quiet, json))
