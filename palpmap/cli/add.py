"""Versions of a study: `palpmap add`, `history`."""

from typing import Annotated

import typer

from palpmap.cli.options import EffectFiles, Json, Quiet, Seed, StudyFile
from palpmap.console import Output


def add(
    study: StudyFile,
    name: Annotated[str, typer.Argument(metavar="EFFECT", help="See `palpmap effects`.")],
    effect: EffectFiles = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Add an effect, refit, write the study's next version.

    Exit code 1: the effect does not earn its place.

    Example: palpmap add study.toml viscoelasticity
    """
    from palpmap.commands.add import run_add

    return run_add(
        study=study, name=name, seed=seed, effects=effect or [], output=Output(quiet, json)
    )


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
