"""Conformance kit: the contract of every effect, built-in or a user's own.

`check_effect` tries an effect on a made-up scan (`trial`). Checks with a body of finite elements
are handed in as `further` (`identify.select.plant_and_recover`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

from identify.effects.base import Effect
from identify.effects.conformance import checks
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.columns import columns
from identify.effects.conformance.example_scan import ExampleScan, trial
from models import kinds_checked

Check = Callable[[Effect, ExampleScan], str]  # returns the finding, raises Fault

DESCRIPTION: Mapping[str, Check] = {
    "described": checks.described,
    "parameters with units and bounds": checks.parameters,
    "one hook, parameters by name": checks.hook,
}
BEHAVIOUR: Mapping[str, Check] = {
    "worked examples come out": checks.examples,
    "says what a scan lacks": checks.testable,
    "identity at the null": checks.identity,
    "deterministic": checks.repeatable,
    "inputs untouched": checks.untouched,
    "finite and shaped": checks.finite,
    "every parameter moves a reading": checks.moving,
    "no jumps": checks.steady,
    "candidates within bounds": checks.grid,
    "neighbouring candidates alike": checks.dense,
    "patterns of many shapes at once": columns,
    "evidence in words and numbers": checks.evident,
}


@dataclass(frozen=True)
class CheckResult:
    """Finding of one check.

    Attributes
    ----------
    check : subject, some words
    passed : True for an effect that conforms
    says : finding, one line
    """

    check: str
    passed: bool
    says: str


@kinds_checked
def check_effect(effect: Effect, further: Mapping[str, Check] | None = None) -> list[CheckResult]:
    """Try an effect; one finding a check, passed or not.

    Parameters
    ----------
    effect : to be tried
    further : more checks by name; each takes effect and trial, returns its finding or raises
        `Fault`

    Returns
    -------
    The findings in the order of the checks. With a fault in the description, nothing else is tried.

    Examples
    --------
    >>> import palpmap as pm
    >>> all(result.passed for result in pm.check_effect(pm.CATALOGUE["contact_offset"]))
    True
    """
    case = trial()
    findings = _run(DESCRIPTION, effect, case)
    if failures(findings):
        return findings
    return findings + _run({**BEHAVIOUR, **(further or {})}, effect, case)


def failures(findings: Sequence[CheckResult]) -> list[CheckResult]:
    """Return the findings that did not pass."""
    return [finding for finding in findings if not finding.passed]


def _run(some: Mapping[str, Check], effect: Effect, case: ExampleScan) -> list[CheckResult]:
    found = []
    for name, check in some.items():
        try:
            found.append(CheckResult(name, True, check(effect, case)))
        except Fault as fault:
            found.append(CheckResult(name, False, str(fault)))
        except Exception as error:  # the effect's own code may raise anything
            found.append(CheckResult(name, False, f"raises {type(error).__name__}: {error}"))
    return found
