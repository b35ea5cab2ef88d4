"""`palpmap history`."""

from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet, StudyFile
from palpmap.console import Output


def history(
    study: StudyFile,
    undo: Annotated[bool, typer.Option("--undo", help="Take the last version back.")] = False,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Show how the error fell from version to version of a study.

    Example: palpmap history study.toml
    """
    from palpmap.commands.add import run_history

    return run_history(study=study, undo=undo, output=Output(quiet, json))
