"""`palpmap press`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def press(
    trial: Annotated[Path, typer.Argument(metavar="TRIAL", help="Folder of `palpmap blind`.")],
    program: Annotated[
        Path,
        typer.Argument(metavar="PROGRAM", help="Presses, such as next_scan_1.csv of `explain`."),
    ],
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Press the body of a blind trial further.

    The answer stays sealed. Scan and study with all presses so far are written beside the first
    ones.

    Example: palpmap press trial trial/explained/next_scan_1.csv
    """
    from palpmap.blind.further_presses import run_press

    return run_press(trial=trial, program=program, output=Output(quiet, json))
