"""A second look at earlier additions, beside what was found since.

Which effect did best was decided while another one was still missing, and may have been decided by
it: presses made row by row that sink ever deeper look like a tilt along the columns, so that a
first touch declared late is taken for a tilted surface. Once the other effect is in the model, the
earlier one is compared with its former candidates once more. A clearly better candidate takes its
place, as does a special case that does as well; near ones form its group.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.measurement.model import MeasurementModel
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import (
    MARGIN,
    Candidate,
    beaten,
    carried_on,
    in_earnest,
    is_implausible,
    refit,
)


def reconsider(
    fit: FitResult,
    additions: Sequence[AcceptedEffect],
    say: Callable[[str], None],
    last_too: bool = False,
) -> tuple[FitResult, list[AcceptedEffect], dict[str, str]]:
    """Compare each addition but the last with its candidates, beside all others.

    The last was compared beside the present ones, and is compared again only if one is replaced, or
    if it is said. What the presses by themselves bear out stands as it is.

    Returns
    -------
    The fit, the additions, and by the names of those that were replaced what stands there now.
    """
    additions, exchanged = list(additions), {}
    for index, addition in enumerate(additions):
        is_last = index == len(additions) - 1
        if addition.shown_by_presses or (is_last and not exchanged and not last_too):
            continue
        candidates = _beside_the_rest(fit, addition, say)
        winner = candidates[0]
        tried = addition.tried or addition.candidates
        additions[index] = replace(addition, candidates=candidates, tried=tried)
        if _takes_over(winner, addition.name, candidates):
            additions[index] = replace(additions[index], name=winner.name)
            exchanged[addition.name] = winner.name
            say(f"refitting with {winner.name} in place of {addition.name}")
            fit = fit_jointly(winner.fit.model, winner.fit.map)
    return fit, additions, exchanged


def with_exchanged(fit: FitResult, exchanged: Mapping[str, str], now: FitResult) -> FitResult:
    """Refit an earlier model with what has replaced its effects since."""
    parts = {part.effect.name: part for part in now.model.started(now.u).effects}
    effects = {  # by name: what replaces one may have been there beside it
        own.effect.name: own
        for own in (
            parts[exchanged[own.effect.name]] if own.effect.name in exchanged else own
            for own in fit.model.effects
        )
    }
    return fit_jointly(replace(fit.model, effects=tuple(effects.values())), fit.map)


def _beside_the_rest(
    fit: FitResult, addition: AcceptedEffect, say: Callable[[str], None]
) -> tuple[Candidate, ...]:
    """Return an addition and its candidates, each refitted beside all other effects, best first."""
    found = [Candidate(addition.name, fit.chi2, fit.bic, fit)]
    best = next(candidate for candidate in addition.candidates if candidate.name == addition.name)
    for candidate in addition.candidates:
        if candidate.name in fit.effect_names or beaten(candidate.chi2, addition.before, best.chi2):
            continue
        say(f"trying {candidate.name} in place of {addition.name}")
        own = refit(_exchanged(fit, addition.name, candidate), candidate.fit.map, rounds=0)
        if own is None:
            continue
        own = carried_on(own, candidate.fit, fit.chi2)
        if not is_implausible(own, candidate.name) and (
            own.chi2 > fit.chi2 or in_earnest(fit, own)
        ):
            found.append(Candidate(candidate.name, own.chi2, own.bic, own))
    return tuple(sorted(found, key=lambda candidate: candidate.criterion))


def _takes_over(winner: Candidate, name: str, candidates: Sequence[Candidate]) -> bool:
    """Whether a candidate is clearly better, or a special case that does as well."""
    present = next(candidate for candidate in candidates if candidate.name == name)
    clearly = winner.criterion < present.criterion - MARGIN
    return clearly or (winner.name != name and winner.name in present.contains)


def _exchanged(fit: FitResult, name: str, candidate: Candidate) -> MeasurementModel:
    """Return the model of a fit with a candidate, as it was fitted then, in place of an effect."""
    (part,) = (part for part in candidate.fit.model.effects if part.effect.name == candidate.name)
    now = fit.model.started(fit.u)
    parts = tuple(part if own.effect.name == name else own for own in now.effects)
    return replace(now, effects=parts)
