"""Forward selection of effects: find a missing effect, add it, refit, until the residual is noise.

The linear score only ranks; the refit decides. At each step the best-scored effects, and all with a
pattern alike, are fitted jointly with the map. The winner must beat every other by a margin of
chi-square (after the price of its parameters), else they are an ambiguous group and one of them
stands for the group. An effect is added only at p < 0.001 (`SelectionSettings.sure`), and beside a
structured residual only if it removes at least 10 % of the excess chi-square, from the third one
on a quarter: beside something large and unknown, everything is significant. An effect that the map
imitates almost completely is never named alone: a small model error can mimic it. After each step
the earlier effects must still earn their place, and are compared with their candidates again; of
three and more only where they leave noise, since beside structure none is named.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import reduce

import numpy as np

from identify.effects.base import Effect
from identify.effects.unknown_course import COURSES
from identify.fit.joint_fit import fit_jointly, found_again
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.measurement.model import MeasurementModel
from identify.residual.compare import compare_residual
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate, best_candidates, compare_candidates, leaving_noise
from identify.select.diagnosis import diagnose, shortlist
from identify.select.explanation import (
    Explanation,
    ended_by_presses,
    further_missing,
    is_more_missing,
    mended,
    verdict_of,
    within_laws,
)
from identify.select.model_error import accept_best, beside_edge, of_field, residues
from identify.select.reconsider import (
    as_special_cases,
    at_their_ends,
    followed_by_their_own,
    reconsider,
    with_exchanged,
    without_unneeded,
)
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import (
    Step,
    foretells_worse,
    hides_lead,
    is_worthwhile,
    replaces_map,
    step_of,
    whitened_fit,
)
from models import Scan

FirstStep = Callable[[Step, Callable[[str], None]], tuple[FitResult, list[AcceptedEffect]] | None]


def forward_selection(
    model: MeasurementModel,
    stiffness: GaussianMap,
    scan: Scan,
    catalogue: Sequence[Effect],
    *,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    on_step: Callable[[Step], None] | None = None,
    policy: Policy | None = None,
    settings: SelectionSettings = SELECTION,
    first: FitResult | None = None,
) -> Explanation:
    """Add effects to a map until the residual is noise.

    Parameters
    ----------
    model : with the effects that the study already has
    stiffness : map to start from
    scan : placed, with the readings of the model
    catalogue : effects that may be added
    seed : of the simulated nulls
    progress : called with the present task, in words
    on_step : called with each new step
    policy : decisions of the selection; None for those of `Policy`
    first : fit of the model, where there is one
    """
    policy = policy or Policy()
    say = progress or (lambda text: None)

    def judged(fit: FitResult, scored: Sequence[Effect] = catalogue) -> Step:
        step = step_of(fit, scan, scored, seed, say, settings)
        if on_step:
            on_step(step)
        return step

    say("fitting the map")
    fit = first or fit_jointly(model, stiffness)
    fit = found_again(fit) if model.effects else fit  # without any, that map was

    def is_noise(fit: FitResult) -> bool:
        return compare_residual(whitened_fit(fit, scan), settings.residual).is_noise

    selection = _Selection(judged, is_noise, policy, say, settings)
    path = _Path(*_begun(fit, catalogue, selection))
    _grow(path, catalogue, selection)
    if settings.most_effects and fit.field is None and not _ended_apart(path, policy):
        path = _with_unknown_cause(path, catalogue, selection)
    ladder, accepted = path.ladder, path.accepted
    further = "" if path.settled else further_missing(ladder, accepted, settings)
    names = dict.fromkeys(path.dropped)
    gone = tuple(name for name in names if name not in ladder[-1].fit.effect_names)
    within = within_laws(ladder[0].fit, ladder[-1].fit, accepted, settings)
    may_imitate = [*mended(ladder, accepted, settings), *residues(ladder, accepted, settings)]
    may_imitate += beside_edge(ladder[-1].fit, accepted)
    return Explanation(
        verdict_of(ladder[-1], accepted, further, within, may_imitate),
        tuple(ladder),
        tuple(accepted),
        gone,
        further=further,
        settings=settings,
    )


@dataclass
class _Path:
    """Steps, accepted effects and dropped ones so far.

    `failed` are effects that did not bring at the end of their fit what its beginning promised;
    `settled` is a path without candidates for noise.
    """

    ladder: list[Step]
    accepted: list[AcceptedEffect]
    dropped: list[str] = field(default_factory=list)
    failed: list[str] = field(default_factory=list)
    settled: bool = False


@dataclass(frozen=True)
class _Selection:
    """Means of growing a path: its steps are `judged` by scores of the effects given."""

    judged: Callable[[FitResult, Sequence[Effect]], Step]
    is_noise: Callable[[FitResult], bool]
    policy: Policy
    say: Callable[[str], None]
    settings: SelectionSettings


def _ended_apart(path: _Path, policy: Policy) -> bool:
    """Whether only presses that stand apart could call for more than is found."""
    return policy.few_apart and not path.ladder[-1].comparison.is_noise


def _grow(path: _Path, catalogue: Sequence[Effect], selection: _Selection) -> None:
    """Add effects of a catalogue to a path, step by step."""
    policy, say, settings = selection.policy, selection.say, selection.settings
    ladder, effects = path.ladder, {effect.name: effect for effect in catalogue}
    most, begun = settings.most_effects + len(path.accepted), len(ladder)
    while len(path.accepted) < most and (
        not path.accepted or policy.goes_on(ladder, path.accepted, settings)
    ):
        first, now = ladder[0].fit, ladder[-1]
        noise = now.comparison.is_noise
        if len(ladder) > begun and _ended_apart(path, policy):
            return
        if ended_by_presses(first, now.fit, path.accepted, settings, noise):
            return
        tried = [*path.dropped, *path.failed, *of_field(now, settings)]
        candidates = policy.propose(now, effects, say, tried, settings)
        if not candidates:
            path.settled = now.comparison.is_noise
            return
        least = settings.third_worthwhile if len(path.accepted) > 1 else settings.worthwhile
        if not (noise or policy.worthwhile(now.fit, candidates[0].fit, least)):
            return
        candidates = leaving_noise(candidates, selection.is_noise, settings)
        before = list(ladder), list(path.accepted), list(path.dropped)
        path.accepted.append(accept_best(ladder, path.accepted, candidates, settings))
        refitted = _refitted(first, now, candidates[0], path.accepted, effects, selection)
        if refitted is None:
            path.accepted, path.dropped = before[1:]
            return
        fit, path.accepted, lost, exchanged = refitted
        if fit.bic >= now.fit.bic:  # it was refitted beside the correction of another map
            path.accepted, path.dropped = before[1:]
            path.failed.append(candidates[0].name)
            continue
        path.dropped.extend([*lost, *exchanged])
        for number, step in enumerate(ladder):
            if exchanged.keys() & set(step.fit.effect_names):  # the steps lead to the last model
                ladder[number] = selection.judged(
                    with_exchanged(step.fit, exchanged, fit), catalogue
                )
        ladder.append(selection.judged(fit, catalogue))
        if hides_lead(now, ladder[-1], settings) or foretells_worse(now, ladder[-1], settings):
            ladder[:], path.accepted, path.dropped = before
            return


def _with_unknown_cause(path: _Path, catalogue: Sequence[Effect], selection: _Selection) -> _Path:
    """Return the path beside the course of an unknown cause, or the path itself.

    Effects of the catalogue can imitate a cause that is in none of them, one after the other, and
    even leave noise. Where from some step on one course takes more of the misfit than all effects
    found since, its parameters paid for, the effects are sought anew beside that course, among
    further ones. The better model by the information criterion stays. Where the path ends in noise,
    a course must do better than two effects: of the form of a single one it may be a closer fit.
    """
    say, settings = selection.say, selection.settings
    last, before = path.ladder[-1], [a for a in path.accepted if a.shown_by_presses]
    if last.comparison.law:  # the lead to the cause, which several courses would hide
        return path
    steps = path.ladder[:-2] if last.comparison.is_noise else path.ladder
    say("comparing with courses of unknown causes")
    for step in steps:
        courses = diagnose(step.fit, COURSES, seed=step.diagnosis.seed, settings=settings.diagnosis)
        price = np.log(len(step.fit.at.residual))
        gain = max((s.statistic - price * len(s.sizes) for s in courses.scores), default=0.0)
        if gain <= max(step.fit.bic - last.fit.bic, settings.margin):
            continue
        effects: dict[str, Effect] = {c.name: c for c in COURSES}
        step, names = replace(step, diagnosis=courses), shortlist(courses, settings=settings)
        candidates = compare_candidates(step, effects, say, names, settings)
        if not candidates:
            continue
        begun, winner = path.ladder[: 1 + bool(before)], candidates[0].fit
        name, base = candidates[0].name, begun[-1].fit
        say(f"refitting with {name}")
        lost = [n for n in base.effect_names if n in path.dropped]  # of the first step
        model = reduce(MeasurementModel.without, lost, base.model)
        model = model.with_effect(effects[name], winner.at.values[name], winner.at.state)
        fit = found_again(fit_jointly(model, winner.map))
        course = AcceptedEffect(name, candidates, chi2_before=base.chi2, settings=settings)
        everything = (*catalogue, *COURSES)
        other = _Path([*begun, selection.judged(fit, everything)], [*before, course])
        _grow(other, everything, selection)
        other.dropped += lost
        return other if other.ladder[-1].fit.bic < last.fit.bic else path
    return path


def _begun(
    fit: FitResult, catalogue: Sequence[Effect], selection: _Selection
) -> tuple[list[Step], list[AcceptedEffect]]:
    """Return the steps of the map alone and of its first step, with the effects of the latter."""
    policy, judged = selection.policy, selection.judged
    # Beside a free map without a law that the presses call for, scores of the body say nothing
    by_presses = policy.first is not None and fit.field is not None
    scored = [e for e in catalogue if e.link != "body"] if by_presses else catalogue
    alone = judged(fit, scored)
    if policy.first and (started := policy.first(alone, selection.say)):
        first = fit
        fit, accepted = started
        noise = selection.is_noise(fit)
        reason = ended_by_presses(first, fit, accepted, selection.settings, noise)
        after = judged(fit, scored if reason else catalogue)
        if reason:  # nothing is sought further, and each would take models of the body
            beyond = [e for e in catalogue if e not in scored and e.name not in fit.effect_names]
            after = replace(after, diagnosis=after.diagnosis.beside_untested(beyond, reason))
        return [alone, after], accepted
    return [judged(fit, catalogue) if by_presses else alone], []


def _refitted(
    alone: FitResult,
    now: Step,
    winner: Candidate,
    accepted: Sequence[AcceptedEffect],
    effects: dict[str, Effect],
    selection: _Selection,
) -> tuple[FitResult, list[AcceptedEffect], list[str], dict[str, str]] | None:
    """Refit with the last effect; the fit, its effects, those lost and those exchanged.

    None where it took the place of the map.
    """
    policy, say, settings = selection.policy, selection.say, selection.settings
    before = accepted[:-1]
    say(f"refitting with {winner.name}")
    fit = found_again(fit_jointly(winner.fit.model, winner.fit.map))
    fit, last = at_their_ends(fit, accepted[-1], say, settings)
    accepted = [*accepted[:-1], last]
    fit, lost = policy.prune(fit, [a.name for a in accepted[:-1]], say, settings)
    kept = [a for a in accepted if a.name not in lost]
    named = selection.is_noise(fit) or within_laws(alone, fit, kept, settings)
    if len(kept) > 2 and not named:
        return None if replaces_map(now.fit, fit) else (fit, kept, lost, {})
    # Beside an effect since lost, the last one may have beaten candidates that do as well now
    fit, kept, exchanged = policy.compare(fit, kept, say, bool(lost), settings)
    if not lost and not exchanged:
        fit, kept, exchanged = followed_by_their_own(now, fit, kept, before, effects, say, settings)
    some = kept if lost or exchanged else kept[:-1]  # the last has just been compared
    fit, some, simpler = as_special_cases(now, fit, some, effects, say, settings)
    kept = [*some, *kept[len(some) :]]
    if simpler:
        exchanged = {old: simpler.get(new, new) for old, new in exchanged.items()} | simpler
    if exchanged:
        fit, more = policy.prune(fit, [a.name for a in kept], say, settings)
        kept = [a for a in kept if a.name not in more]
        lost += [*more, *(old for old, new in exchanged.items() if new in more)]
        exchanged = {old: new for old, new in exchanged.items() if new not in more}
    if replaces_map(now.fit, fit):
        return None
    return fit, kept, lost, exchanged


@dataclass(frozen=True)
class Policy:
    """Decisions of the forward selection; most take the settings.

    Attributes
    ----------
    first : first step from the map alone, or None (`identify.select.first_step`)
    propose : candidates of a step, best first; empty to end the selection
    worthwhile : sufficient gain of a candidate's fit beside a structured residual, of a least share
    prune : removal of earlier effects no longer needed
    compare : comparison of earlier effects with their candidates, beside the others
    goes_on : need of a further effect
    few_apart : without a few presses the first step leaves noise: one effect that accounts for all
        of them is sought, and no further one
    """

    first: FirstStep | None = None
    propose: Callable[
        [Step, dict[str, Effect], Callable[[str], None], Sequence[str], SelectionSettings],
        tuple[Candidate, ...],
    ] = best_candidates
    worthwhile: Callable[[FitResult, FitResult, float], bool] = is_worthwhile
    prune: Callable[
        [FitResult, Sequence[str], Callable[[str], None], SelectionSettings],
        tuple[FitResult, list[str]],
    ] = without_unneeded
    compare: Callable[
        [FitResult, Sequence[AcceptedEffect], Callable[[str], None], bool, SelectionSettings],
        tuple[FitResult, list[AcceptedEffect], dict[str, str]],
    ] = reconsider
    goes_on: Callable[[Sequence[Step], Sequence[AcceptedEffect], SelectionSettings], bool] = (
        is_more_missing
    )
    few_apart: bool = False
