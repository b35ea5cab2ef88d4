"""The fit of the single presses without a map: its record and its sentences."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identify.effects import force, percent
from identify.fit import CONTACT_LAW, FreeComplianceFit
from identify.select import AcceptedEffect
from models import Scan
from palpmap.result.records import (
    CountRecord,
    ExplainRecord,
    PressesAloneRecord,
    PressesFitRecord,
)
from palpmap.study.open_study import Problem

_NO_TRAVEL = 0.02  # of the press's largest


def presses_record(
    problem: Problem, accepted: Sequence[AcceptedEffect]
) -> PressesAloneRecord | None:
    """Return the fit of the single presses, None where it was not asked for.

    With the law that the map was fitted beside, of the accepted effects, where there is one.
    """
    law = problem.law
    if law is None:
        return None
    beside = next((effect.law for effect in accepted if effect.law is not None), None)
    if beside is None and problem.fit.field is not None:
        beside = law.partial
    law = replace(law, found=beside or law.found)
    largest = problem.model.readings.largest_force_n
    return PressesAloneRecord(
        effects=law.names,
        values={name: law.found.values[name] for name in law.names},
        as_good={name: tuple(other for other, _ in law.candidates(name)) for name in law.names},
        largest_force_n=largest,
        before=_record(law.plain, largest),
        after=_record(law.found, largest),
        share_taken=law.share,
        map_error=problem.model.press_error,
        again=law.found.again,
        refuted=law.refuted,
    )


def _record(fit: FreeComplianceFit, largest_n: float) -> PressesFitRecord:
    return PressesFitRecord.copy_of(fit, share_of_largest_force=fit.rms_n / largest_n)


def counted(problem: Problem) -> dict[str, int]:
    """Return the numbers of presses used and left out, see `CountRecord`."""
    return {
        "presses_used": problem.model.readings.presses,
        "presses_left_out": problem.experiment.left_out,
    }


def left_out_sentences(record: CountRecord) -> list[str]:
    """Return the number of presses used, in a sentence, if not all were.

    >>> left_out_sentences(CountRecord(presses_used=200, presses_left_out=100))
    ['200 of 300 presses, evenly spread, were used: time and memory grow with their number.']
    """
    used, left = record.presses_used, record.presses_left_out
    why = "time and memory grow with their number"
    says = f"{used} of {used + left} presses, evenly spread, were used: {why}."
    return [says] if left else []


def first_readings_sentence(scan: Scan) -> str:
    """Say which force the first readings have, where they are at no travel; else nothing.

    A force at which travel begins to be counted is to agree with it, whatever the model.
    """
    used = scan.used()
    first = np.unique(used.press_index, return_index=True)[1]
    most = np.zeros(len(first))
    np.maximum.at(most, used.press_index, used.displacement_m)
    at_no = np.abs(used.displacement_m[first]) < _NO_TRAVEL * most
    if np.mean(at_no) < 0.5:
        return ""
    forces = used.force_n[first][at_no]
    middle = float(np.median(forces))
    spread = 1.48 * float(np.median(np.abs(forces - middle)))
    error = 1.25 * spread / np.sqrt(len(forces))  # of a median
    return (
        f"The first readings, at no travel, have {force(middle)} (median of {len(forces)} presses, "
        f"+- {force(error)})."
    )


def presses_sentences(record: ExplainRecord) -> list[str]:
    """Return the fit of the single presses in sentences; none where it was not asked for."""
    says, found = left_out_sentences(record), record.presses_alone
    if found is None:
        return says
    before, after = found.before, found.after
    alone = "Single presses, each with its own compliance and no map: "
    if found.effects:
        says.append(
            f"{alone}with {' and '.join(found.effects)} the error of the middle press falls "
            f"from {force(before.typical_n)} to {force(after.typical_n)}, that of all from "
            f"{force(before.rms_n)} to {force(after.rms_n)} "
            f"({percent(before.share_of_largest_force)} and "
            f"{percent(after.share_of_largest_force)} of the largest force). The residual is "
            f"noise in {percent(after.noise_share)} of the presses, "
            f"{percent(before.noise_share)} before."
        )
        if after.noise_share < CONTACT_LAW.noise_share:
            says.append("No law of contact that all presses share leaves noise in more of them.")
        says += [
            f"{' or '.join(others)} in place of {name} does as well there."
            for name, others in found.as_good.items()
            if others
        ]
        if found.refuted:
            sets = [" with ".join(names) for names in found.refuted]
            says.append(
                f"{' and '.join(sets)} {'meets' if len(sets) == 1 else 'meet'} the curves as well, "
                "but not the places that were pressed again: a place has one compliance."
            )
    else:
        says.append(
            f"{alone}most of them call for no effect of contact, response or instrument. "
            f"Their error is {force(after.rms_n)}, "
            f"{percent(after.share_of_largest_force)} of the largest force; it is noise in "
            f"{percent(after.noise_share)} of the presses."
        )
    if found.map_error:
        says.append(
            f"The map misses the compliance of an ordinary press by {percent(found.map_error)}: "
            "more than noise, so that its numbers are rough and no effect of the body is offered. "
            "Either its form (a background with Gaussian inclusions) or the stated shape or "
            "thickness of the body is wrong."
        )
    return says
