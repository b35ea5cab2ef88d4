"""`palpmap explain`."""

from palpmap.cli.options import EffectFiles, Json, Out, Quiet, Seed, StudyFile
from palpmap.console import Output


def explain(
    study: StudyFile,
    effect: EffectFiles = None,
    out: Out = None,
    seed: Seed = 0,
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Find the missing effects until only noise is left.

    Runs unattended. Exit code 0: explained, or nothing is missing; 1: ambiguous or unexplained.

    Example: palpmap explain study.toml --out runs/why
    """
    from palpmap.commands.explain import run_explain

    return run_explain(
        study=study, out=out, seed=seed, effects=effect or [], output=Output(quiet, json)
    )
