"""`palpmap check-effect`."""

from pathlib import Path
from typing import Annotated

import typer

from palpmap.cli.options import Json, Quiet
from palpmap.console import Output


def check_effect(
    file: Annotated[
        Path,
        typer.Argument(metavar="FILE", help="Python file that defines one effect; it is executed."),
    ],
    quiet: Quiet = False,
    json: Json = False,
) -> bool:
    """Check an effect of one's own.

    It goes through the same checks as the built-in ones; in the last it is planted in a scan and
    must be found again. The file's code is executed.
    Exit code 1 if the effect is at fault, 2 if there is none.

    Example: palpmap check-effect examples/own_effect/warm_up.py
    """
    from dataclasses import asdict

    from identify.effects import conformance
    from identify.effects.user_effect import load_effect
    from identify.planting import planted_and_found
    from palpmap.effects_table import findings_table

    effect = load_effect(file)
    further = {"planted and found": planted_and_found}
    findings = conformance.check_effect(effect, further)
    faults = conformance.failures(findings)
    record = {
        "effect": effect.name,
        "passed": not faults,
        "findings": [asdict(finding) for finding in findings],
    }
    output = Output(quiet=quiet, json=json)
    output.result(record, findings_table(findings))
    if faults:
        output.say(f"{effect.name}: {len(faults)} of {len(findings)} checks find a fault.")
    else:
        output.say(f"{effect.name} keeps to all {len(findings)} checks.")
    return not faults
