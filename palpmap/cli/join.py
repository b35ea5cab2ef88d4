"""`palpmap join`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def join(
    scans: Annotated[
        list[Path],
        typer.Argument(metavar="SCAN...", help="Scans of one body, in the order they were made."),
    ],
    out: Annotated[Path, typer.Option("--out", metavar="FILE", help="The new scan's file.")],
    pause: Annotated[
        float | None,
        typer.Option(
            "--pause",
            metavar="S",
            min=0,
            help="Seconds between two scans, where their clocks were set back.",
            show_default="as their clocks say",
        ),
    ] = None,
    study: Annotated[
        Path | None,
        typer.Option(
            "--study",
            metavar="STUDY",
            help="A study of one of them: the same of the new scan is written beside it.",
            show_default=False,
        ),
    ] = None,
    quiet: Quiet = False,
    json: Json = False,
) -> None:
    """Make one scan of several on the same body.

    Presses are numbered on. Sensors that were set to zero in between, or a body that was moved,
    make two bodies of it: then explain the scans one by one.

    Example: palpmap join scan.csv further.csv --out both.csv --pause 60 --study study.toml
    """
    from palpmap.commands.join import run_join

    run_join(scans=scans, out=out, pause_s=pause, study=study, output=Output(quiet, json))
