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

    from identify.catalogue import contains_its_special_cases, load_effect
    from identify.effects.conformance import check_effect as check
    from identify.effects.conformance import failures
    from identify.select import NOT_PLANTED, plant_and_recover
    from palpmap.commands.effects import findings_table

    effect = load_effect(file)
    further = {
        "contains its special cases": contains_its_special_cases,
        "planted and found": plant_and_recover,
    }
    findings = check(effect, further)
    faults = failures(findings)
    not_made = [finding for finding in findings if finding.says.startswith(NOT_PLANTED)]
    record = {
        "effect": effect.name,
        "passed": not faults,
        "not_made": [finding.check for finding in not_made],
        "findings": [{**asdict(f), "made": f not in not_made} for f in findings],
    }
    output = Output(quiet=quiet, json=json)
    output.result(record, findings_table(findings, not_made))
    if faults:
        output.say(f"{effect.name}: {len(faults)} of {len(findings)} checks find a fault.")
    elif not_made:
        made = len(findings) - len(not_made)
        names = ", ".join(finding.check for finding in not_made)
        output.say(f"{effect.name} keeps to the {made} checks that were made; not made: {names}.")
    else:
        output.say(f"{effect.name} keeps to all {len(findings)} checks.")
    return not faults
