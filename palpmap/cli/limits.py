"""`palpmap limits`."""

from typing import Annotated

import typer

from palpmap.cli.options import EffectFiles, Json, Out, Quiet, StudyFile
from palpmap.console import Output


def limits(
    study: StudyFile,
    plan: Annotated[
        bool, typer.Option("--plan/--no-plan", help="Also compute what changed scans would see.")
    ] = True,
    effect: EffectFiles = None,
    out: Out = None,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Say how small an effect a scan can see.

    Also what ignoring it would do to the map, and what other scan would see more.

    Example: palpmap limits study.toml
    """
    from palpmap.commands.limits import run_limits

    return run_limits(
        study=study, out=out, effects=effect or [], plan=plan, output=Output(quiet, json)
    )
