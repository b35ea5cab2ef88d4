"""Outlying presses: test of an explanation without them.

A slip or a wrong place looks like an effect. Presses that stand apart from a map that meets the
others are therefore left out first, and the missing effects are sought for the others. Where these
leave noise there, one further effect at most is sought with all presses, which might account for
those apart. Otherwise the explanation of all presses is tested without the outlying ones: its model
is fitted anew, and each effect must earn its place again and do better than the other candidates.
If any does not, the selection runs once more without these presses, and an effect found only with
them is not offered by name.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.select.accepted_effect import AcceptedEffect, at_bound
from identify.select.explanation import Explanation, Verdict
from identify.select.first_step import selected, with_exact_map
from identify.select.presses_apart import Others, apart, beside_free_map, hold_misfit, told
from identify.select.reconsider import reconsider, without_unneeded
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.start_fit import StartFit, measurement_model, start_fit
from identify.select.step import Step, whitened_fit
from models import InputError, Scan


@dataclass(frozen=True)
class WithoutSuspects:
    """Explanation without the outlying presses (ids).

    `found`: accepted effects without equivalent alternatives; other fields as in `Explanation`.
    """

    presses: tuple[int, ...]
    verdict: Verdict
    added: tuple[str, ...]
    ambiguous: tuple[tuple[str, ...], ...]
    found: frozenset[str]
    fit: FitResult
    comparison: Comparison

    @classmethod
    def of(cls, presses: tuple[int, ...], again: Explanation) -> "WithoutSuspects":
        """Return the result of a selection without the presses."""
        final = again.final
        found = frozenset(a.name for a in again.accepted if a.decided)
        said = again.verdict, again.added, again.ambiguous
        return cls(presses, *said, found, final.fit, final.comparison)


def explain(
    start: StartFit,
    seed: int = 0,
    on_step: Callable[[Step], None] | None = None,
    settings: SelectionSettings = SELECTION,
) -> tuple[Explanation, WithoutSuspects | None, StartFit]:
    """Find the missing effects, with all presses and without the outlying ones.

    Returns
    -------
    the explanation, its verdict changed if it rests on these presses, the other one, and the start
    of the explanation: without the presses that stand apart, where these hold all that is missing,
    and without an error of the map, where one effect takes its place
    """
    if start.model.press_error and (found := with_exact_map(start, seed, settings)):
        explained, start = found
        if on_step:
            for step in explained.ladder:
                on_step(step)
        without = without_suspects(start, seed, explained, settings)
        return weighed(explained, without), without, start
    others = Others(start, seed, settings)
    rest = apart(others, start.joint, (True,))
    explained = selected(start, seed, on_step, settings, rest and rest.answer)
    final = explained.final
    noise = final.comparison.is_noise
    if final.fit.field is not None:  # it follows such presses, so that noise is left
        rest = beside_free_map(others, final.fit.field) if noise else None
    else:
        rest = None if noise else rest or apart(others, final.fit, (True, False))
    if rest is not None:
        if on_step:
            on_step(rest.answer.final)
        answer = replace(rest.answer, verdict="unexplained", apart=rest.apart)
        return answer, None, rest.start
    without = without_suspects(start, seed, explained, settings, others)
    return weighed(explained, without), without, start


def without_suspects(
    start: StartFit,
    seed: int,
    explained: Explanation,
    settings: SelectionSettings = SELECTION,
    others: Others | None = None,
) -> WithoutSuspects | None:
    """Return the explanation without the outlying presses; None without any.

    `others` : selections without some presses that were made before
    """
    presses = explained.ladder[0].comparison.bad_presses
    free = start.model.map_uncertainty is not None  # its search weights such presses down itself
    if not presses or explained.map_error or free:  # beside a wrong map there are many
        return None
    experiment = told(start.experiment, presses)
    try:
        if explained.accepted:
            same = _same_answer(replace(start, experiment=experiment), explained, presses, settings)
            if same is not None:
                return same
            if not explained.added and _lies_elsewhere(start, explained, presses, settings):
                return None  # none is named, and the structure does not rest on these presses
        made = others.answers.get((presses, False)) if others is not None else None
        if made is not None and experiment.whole is None:
            return WithoutSuspects.of(presses, made)
        fewer = experiment.without(presses)
        if not fewer.is_determined:
            return None
        again = start_fit(fewer, start.catalogue, tried=start.leading_sets(presses))
        return WithoutSuspects.of(presses, selected(again, seed, None, settings))
    except (InputError, InadmissibleError):
        return None


def _same_answer(
    start: StartFit,
    explained: Explanation,
    presses: tuple[int, ...],
    settings: SelectionSettings,
) -> WithoutSuspects | None:
    """Return the same explanation without these presses; None if it does not hold there."""
    structured = not explained.final.comparison.is_noise
    if structured and not _lies_elsewhere(start, explained, presses, settings):
        return None
    others = ~np.isin(start.scan.press, presses)
    same = others[start.scan.in_contact]
    fewer = start.experiment.without(presses, refill=False)
    model, _ = measurement_model(fewer.scan, fewer.body, start.fit)
    again = confirmed(explained, model, fewer.scan, same, fewer.say, settings)
    if again is None:
        return None
    fit, comparison = again
    return replace(WithoutSuspects.of(presses, explained), fit=fit, comparison=comparison)


def _lies_elsewhere(
    start: StartFit, explained: Explanation, presses: tuple[int, ...], settings: SelectionSettings
) -> bool:
    """Return True where an explanation leaves structure, most of it outside these presses."""
    fit, indices = explained.final.fit, np.flatnonzero(np.isin(start.scan.press_ids, presses))
    press, none = fit.model.readings.press, np.zeros(0, int)
    theirs = hold_misfit(press, fit.at.residual, none, indices, settings.elsewhere)
    return not (explained.final.comparison.is_noise or theirs)


def suspects_left(explained: Explanation, without: WithoutSuspects | None) -> tuple[int, ...]:
    """Return the outlying presses (ids) that the explanation does not account for.

    Many presses beside an edge are outliers for a map alone if the body is shifted. They are none
    for the model with this effect, which is also found without them.
    """
    still = explained.final.comparison.bad_presses
    if explained.apart is not None:
        return explained.apart.presses
    if without is None:
        return tuple(p for p in explained.ladder[0].comparison.bad_presses if p in still)
    same = (without.verdict, without.added) == (explained.verdict, explained.added)
    if not same or explained.resting_on_outliers:
        return without.presses
    return tuple(press for press in without.presses if press in still)


def weighed(explained: Explanation, without: WithoutSuspects | None) -> Explanation:
    """Return the explanation with its effects that rest on outlying presses marked as such."""
    if without is None:
        return explained
    resting = tuple(name for name in explained.added if name not in without.found)
    if not resting:
        return explained
    verdict = "ambiguous" if explained.verdict == "explained" else explained.verdict
    return replace(explained, verdict=verdict, resting_on_outliers=resting)


def confirmed(
    explained: Explanation,
    model: MeasurementModel,
    scan: Scan,
    same: np.ndarray,
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, Comparison] | None:
    """Test an explanation on some of its readings; None unless all of it holds.

    The residual must be noise again, or structured again, and every effect must earn its place
    beside the others. If it is noise, each that has a name must have the same group of equivalents
    as before; candidates that were far behind on these readings are not tried again.

    Parameters
    ----------
    explained : with one accepted effect or more
    model : without effects, of the other readings
    scan : placed, with these readings
    same : (m,) bool, the explanation's readings among them

    Returns
    -------
    the last model fitted to these readings, and the analysis of its residual
    """
    final, accepted = explained.final, explained.accepted
    say("fitting the answer")
    effects = final.fit.model.started(final.fit.u).effects
    fit = fit_jointly(replace(model, effects=effects), final.fit.map)
    comparison = compare_residual(whitened_fit(fit, scan), settings.residual)
    named = [effect for effect in accepted if not effect.is_unknown]  # courses have no groups
    alike = comparison.is_noise == final.comparison.is_noise
    if not alike or any(at_bound(fit, effect.name) for effect in named):
        return None
    _, lost = without_unneeded(fit, [effect.name for effect in accepted], say, settings)
    if lost:
        return None
    if not comparison.is_noise:
        return fit, comparison
    near = [_without_beaten(effect, same, settings) for effect in named]
    _, again, _ = reconsider(fit, near, say, last_too=True, settings=settings)
    same_groups = [(a.name, set(a.group)) for a in again] == [(a.name, set(a.group)) for a in named]
    return (fit, comparison) if same_groups else None


def _without_beaten(
    accepted: AcceptedEffect, same: np.ndarray, settings: SelectionSettings
) -> AcceptedEffect:
    """Leave out the candidates that are far behind on the same readings, (m,) bool.

    Those of an effect that was found without presses that stand apart were fitted to fewer
    readings, and are compared on all of their own.
    """

    def chi2(fit: FitResult) -> float:
        residual = fit.at.residual
        return float(np.sum(residual[same] ** 2 if len(residual) == len(same) else residual**2))

    best = min(chi2(c.fit) for c in accepted.candidates if c.name == accepted.name)
    most = best + settings.behind_chi2
    return replace(
        accepted, candidates=tuple(c for c in accepted.candidates if chi2(c.fit) <= most)
    )
