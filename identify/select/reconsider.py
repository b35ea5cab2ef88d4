"""Backward check: earlier accepted effects, compared again beside those found since.

The best effect of a step was decided while another one was still missing, and may have been decided
by it: presses made row by row that sink ever deeper look like a tilt along the columns, so that a
first touch declared late is taken for a tilted surface. Once the other effect is in the model, the
earlier one is compared with its former candidates once more. A clearly better candidate takes its
place, as does a special case that does as well; near ones form its group. One that no longer earns
its place is left out.

An effect that was found beside one of two equals may suit that one alone: behind a slow drift of
the force, the rest looks like a jump of the displacement if the drift was taken for one of the
displacement. Equals that fall behind then are followed by an effect of their own.

A free form that stood in for two causes keeps its place once the other cause is found, though a
special case does as well by then: fifteen terms of a surface in place of one declared offset.
Special cases are therefore tried in place of the form that contains them.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

from identify.effects import Effect
from identify.fit.joint_fit import fit_jointly, try_fit
from identify.fit.result import FitResult
from identify.measurement.model import MeasurementModel
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import (
    Candidate,
    compare_candidates,
    is_beaten,
    is_implausible,
    is_improvement,
    ranked,
    refit,
    refit_further,
    shortlist,
    target_of,
)
from identify.select.diagnosis import diagnose
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import Step


def reconsider(
    fit: FitResult,
    accepted: Sequence[AcceptedEffect],
    say: Callable[[str], None],
    last_too: bool = False,
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, list[AcceptedEffect], dict[str, str]]:
    """Compare each accepted effect but the last with its candidates, beside all others.

    The last was compared beside the present ones, and is compared again only if one is replaced, or
    if `last_too`. Effects supported by the contact-law fit are not reconsidered.

    Returns
    -------
    The fit, the accepted effects, and the replacements by the names of the replaced.
    """
    accepted, exchanged = list(accepted), {}
    for index, effect in enumerate(accepted):
        is_last = index == len(accepted) - 1
        if effect.shown_by_presses or (is_last and not exchanged and not last_too):
            continue
        candidates = _beside_the_others(fit, effect, say, settings)
        winner = candidates[0]
        first = effect.first_candidates or effect.candidates
        accepted[index] = replace(effect, candidates=candidates, first_candidates=first)
        if _takes_over(winner, effect.name, candidates, settings):
            accepted[index] = replace(accepted[index], name=winner.name)
            exchanged[effect.name] = winner.name
            say(f"refitting with {winner.name} in place of {effect.name}")
            fit = fit_jointly(winner.fit.model, winner.fit.map)
    return fit, accepted, exchanged


def at_their_ends(
    fit: FitResult,
    accepted: AcceptedEffect,
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, AcceptedEffect]:
    """Compare the last effect with its equivalents again where its own fit went on for long.

    Candidates are refitted by few evaluations. Where chi-square falls by more than the margin from
    there to the end of the winner's fit, it may fall for the others, too: the group is decided by
    fits that ended, all of them.

    Returns
    -------
    The better fit, and the effect with all candidates that were compared.
    """
    before = next(c for c in accepted.candidates if c.name == accepted.name)
    near = [c for c in accepted.candidates if c.name in accepted.equivalents and c is not before]
    if not near or before.chi2 - fit.chi2 <= settings.margin:
        return fit, accepted
    ends = {accepted.name: fit}
    for candidate in near:
        say(f"trying {candidate.name} to its end")
        other = try_fit(candidate.fit.model, candidate.fit.map)
        if other is not None:
            ends[candidate.name] = other
    compared = [
        Candidate(c.name, ends[c.name].chi2, ends[c.name].bic, ends[c.name])
        if c.name in ends else c
        for c in accepted.candidates
    ]  # fmt: skip
    candidates = ranked(compared, settings)
    first = accepted.first_candidates or accepted.candidates
    accepted = replace(accepted, candidates=candidates, first_candidates=first)
    if _takes_over(candidates[0], accepted.name, candidates, settings):
        accepted, fit = replace(accepted, name=candidates[0].name), candidates[0].fit
    return fit, accepted


def followed_by_their_own(
    now: Step,
    fit: FitResult,
    accepted: Sequence[AcceptedEffect],
    before: Sequence[AcceptedEffect],
    effects: dict[str, Effect],
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, list[AcceptedEffect], dict[str, str]]:
    """Compare equals of earlier effects, each followed by its own effect in place of the last one.

    Parameters
    ----------
    now : step before the last effect
    fit : with all effects
    accepted, before : the effects, and as they were at that step
    effects : of the catalogue

    Returns
    -------
    The better fit, the effects, and the replacements by the names of the replaced.
    """
    accepted = list(accepted)
    earlier = {a.name: a for a in before}
    for index, effect in enumerate(accepted[:-1]):
        for candidate in _fallen_behind(effect, earlier.get(effect.name), settings):
            say(f"following {candidate.name} in place of {effect.name}")
            found = _followed(now, effect.name, candidate, effects, say, settings)
            if found is None or found[1].bic >= fit.bic + settings.margin:
                continue
            name, other = found
            clearly = other.bic < fit.bic - settings.margin
            for place, new in ((index, candidate.name), (-1, name)):
                one = accepted[place]
                compared = [*one.candidates, Candidate(new, other.chi2, other.bic, other)]
                accepted[place] = replace(
                    one,
                    name=new if clearly else one.name,
                    candidates=_each_once(compared, settings),
                    first_candidates=one.first_candidates or one.candidates,
                )
            if clearly:
                return other, accepted, {effect.name: candidate.name}
    return fit, accepted, {}


def _fallen_behind(
    effect: AcceptedEffect, before: AcceptedEffect | None, settings: SelectionSettings
) -> list[Candidate]:
    """Equals of another family that an effect had before the last one was found, the best first."""
    if before is None or effect.shown_by_presses or effect.is_unknown:
        return []
    own = next(c.family for c in before.candidates if c.name == before.name)
    lost = [
        c for c in before.candidates
        if c.name in before.equivalents and c.name not in effect.equivalents and c.family != own
    ]  # fmt: skip
    return sorted(lost, key=lambda c: c.criterion)[: settings.followed]


def _followed(
    now: Step,
    name: str,
    candidate: Candidate,
    effects: dict[str, Effect],
    say: Callable[[str], None],
    settings: SelectionSettings,
) -> tuple[str, FitResult] | None:
    """Name of the effect that a candidate calls for in place of another, and the fit of both."""
    fit = try_fit(_exchanged(now.fit, name, candidate), candidate.fit.map)
    if fit is None or fit.bic >= now.fit.bic + settings.margin:
        return None
    seed, of_scores = now.diagnosis.seed, settings.diagnosis
    scores = diagnose(fit, list(effects.values()), seed=seed, settings=of_scores)
    step = replace(now, fit=fit, diagnosis=scores)
    names = shortlist(scores, [name, *fit.effect_names], settings)
    found = compare_candidates(step, effects, say, names, settings)
    if not found:
        return None
    other = try_fit(found[0].fit.model, found[0].fit.map)
    return None if other is None else (found[0].name, other)


def as_special_cases(
    now: Step,
    fit: FitResult,
    accepted: Sequence[AcceptedEffect],
    effects: dict[str, Effect],
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, list[AcceptedEffect], dict[str, str]]:
    """Compare effects with the special cases that they contain, beside all other effects.

    Parameters
    ----------
    now : step before the last effect
    fit : with all effects
    accepted : the effects; those whose candidates include the special cases stay
    effects : of the catalogue

    Returns
    -------
    The fit, the effects, and the replacements by the names of the replaced.
    """
    accepted, exchanged = list(accepted), {}
    for index, effect in enumerate(accepted):
        candidate = next(c for c in effect.candidates if c.name == effect.name)
        known = {*(c.name for c in effect.candidates), *fit.effect_names}
        names = [name for name in candidate.contains if name in effects and name not in known]
        if effect.shown_by_presses or not names:
            continue
        without = _without(fit, effect.name, settings)
        if without is None:
            continue
        cases, seed = [effects[name] for name in names], now.diagnosis.seed
        scores = diagnose(without, cases, seed=seed, settings=settings.diagnosis)
        step = replace(now, fit=without, diagnosis=scores)
        found = compare_candidates(step, effects, say, names, settings)
        candidates = ranked([Candidate(effect.name, fit.chi2, fit.bic, fit), *found], settings)
        if candidates[0].name == effect.name or candidates[0].criterion >= fit.bic:
            continue
        name, fit = candidates[0].name, fit_jointly(candidates[0].fit.model, candidates[0].fit.map)
        exchanged[effect.name] = name
        first = effect.first_candidates or effect.candidates
        accepted[index] = replace(effect, name=name, candidates=candidates, first_candidates=first)
    return fit, accepted, exchanged


def _each_once(
    candidates: Sequence[Candidate], settings: SelectionSettings
) -> tuple[Candidate, ...]:
    """Return candidates with the better fit of each name, best first."""
    best: dict[str, Candidate] = {}
    for candidate in sorted(candidates, key=lambda c: c.criterion):
        best.setdefault(candidate.name, candidate)
    return ranked(list(best.values()), settings)


def with_exchanged(fit: FitResult, exchanged: Mapping[str, str], now: FitResult) -> FitResult:
    """Refit an earlier model with the replacements of its effects."""
    parts = {part.effect.name: part for part in now.model.started(now.u).effects}
    effects = {  # by name: a replacement may have been there beside the replaced
        part.effect.name: part
        for part in (
            parts[exchanged[part.effect.name]] if part.effect.name in exchanged else part
            for part in fit.model.effects
        )
    }
    return fit_jointly(replace(fit.model, effects=tuple(effects.values())), fit.map)


def _beside_the_others(
    fit: FitResult,
    accepted: AcceptedEffect,
    say: Callable[[str], None],
    settings: SelectionSettings,
) -> tuple[Candidate, ...]:
    """Return an effect and its candidates, each refitted beside all other effects, best first."""
    compared = [Candidate(accepted.name, fit.chi2, fit.bic, fit)]
    best = next(c for c in accepted.candidates if c.name == accepted.name)
    for candidate in accepted.candidates:
        name = candidate.name
        beaten = is_beaten(candidate.chi2, accepted.chi2_before, best.chi2, settings)
        if name in fit.effect_names or beaten:
            continue
        say(f"trying {name} in place of {accepted.name}")
        model = _exchanged(fit, accepted.name, candidate)
        target = target_of(model, fit.bic, fit.chi2, settings)
        other = refit(model, candidate.fit.map, settings, rounds=0, target=target)
        if other is None:
            continue
        other = refit_further(other, candidate.fit, fit.chi2, settings, target)
        if is_implausible(other, name):
            continue
        if other.chi2 > fit.chi2 or is_improvement(fit, other, settings):
            compared.append(Candidate(name, other.chi2, other.bic, other))
    return ranked(compared, settings)


def _takes_over(
    winner: Candidate, name: str, candidates: Sequence[Candidate], settings: SelectionSettings
) -> bool:
    """Whether a candidate is clearly better, or a special case that does as well."""
    present = next(c for c in candidates if c.name == name)
    clearly = winner.criterion < present.criterion - settings.margin
    return clearly or (winner.name != name and winner.name in present.contains)


def _exchanged(fit: FitResult, name: str, candidate: Candidate) -> MeasurementModel:
    """Return the model of a fit with a candidate, at its own estimate, in place of an effect."""
    effects = candidate.fit.model.effects
    (part,) = (part for part in effects if part.effect.name == candidate.name)
    now = fit.model.started(fit.u)
    parts = tuple(part if present.effect.name == name else present for present in now.effects)
    return replace(now, effects=parts)


def without_unneeded(
    fit: FitResult,
    names: Sequence[str],
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, list[str]]:
    """Leave out the effects of a fit that do not earn their place; the fit, and their names."""
    lost: list[str] = []
    for name in names:
        say(f"testing the need of {name}")
        without = _without(fit, name, settings)
        if without is not None and without.bic < fit.bic:
            fit = without
            lost.append(name)
    return (fit_jointly(fit.model, fit.map) if lost else fit), lost


def _without(fit: FitResult, name: str, settings: SelectionSettings) -> FitResult | None:
    """Refit without an effect, by few evaluations."""
    most = settings.refit_evaluations
    return try_fit(fit.model.without(name), fit.map, rounds=0, max_evaluations=most)
