"""`palpmap diagnose`."""

from palpmap.cli.options import EffectFiles, Json, Out, Quiet, Seed, StudyFile
from palpmap.console import Output


def diagnose(
    study: StudyFile,
    effect: EffectFiles = None,
    out: Out = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Score every effect that the model may lack (no refit).

    Exit code 0: nothing is missing; 1: something is.

    Example: palpmap diagnose study.toml
    """
    from palpmap.commands.diagnose import run_diagnose

    return run_diagnose(
        study=study, out=out, seed=seed, effects=effect or [], output=Output(quiet, json)
    )
