"""Outlying presses: test of an explanation without them.

A slip or a wrong place looks like an effect. Where nothing is missing without a few outlying
presses, one effect at most is sought for them, which might account for all. Otherwise the
explanation is tested without them: its model is fitted anew, and each effect must earn its place
again and do better than the other candidates. If any does not, the selection runs once more without
these presses, and an effect found only with them is not offered by name.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from identify.fit.contact_law import ContactLaw
from identify.fit.result import FitResult
from identify.measurement.experiment import PlacedExperiment, Progress
from identify.optimize.result import InadmissibleError
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.residual.settings import ResidualSettings
from identify.residual.trimmed import presses_apart
from identify.select.confirm import confirmed
from identify.select.explanation import Explanation, PressesApart, Verdict
from identify.select.first_step import follow
from identify.select.forward_selection import Policy, forward_selection
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.start_fit import StartFit, measurement_model, start_fit
from identify.select.step import Step, whitened_fit
from models import InputError


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
        return cls(
            presses,
            again.verdict,
            again.added,
            again.ambiguous,
            found,
            final.fit,
            final.comparison,
        )


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
    of the explanation: without the presses that stand apart, where these hold all that is missing
    """
    rest = _apart(start, seed, settings)
    explained = _selected(start, seed, on_step, settings, few_apart=rest is not None)
    if rest is not None and not explained.final.comparison.is_noise:
        others, apart, answer = rest
        if on_step:
            on_step(answer.final)
        return replace(answer, verdict="unexplained", apart=apart), None, others
    without = without_suspects(start, seed, explained, settings)
    return weighed(explained, without), without, start


def _apart(
    start: StartFit, seed: int, settings: SelectionSettings
) -> tuple[StartFit, PressesApart, Explanation] | None:
    """Return the start without the presses that stand apart, and its answer: nothing is missing.

    None where no press stands apart, or something is missing without them, too. Several effects,
    one after the other, would otherwise be fitted to a few presses that slipped.
    """
    if start.fit.field is not None or start.model.press_error:
        return None
    try:
        found = _others(start, settings.residual)
        if found is None:
            return None
        others, apart = found
        rest = compare_residual(whitened_fit(others.joint, others.scan), settings.residual)
        if not rest.is_noise or (others.law is not None and calls_for_effects(others.law, others)):
            return None
        answer = _selected(others, seed, None, settings)
    except (InputError, InadmissibleError):
        return None
    return (others, apart, answer) if answer.verdict == "nothing_missing" else None


def _others(start: StartFit, settings: ResidualSettings) -> tuple[StartFit, PressesApart] | None:
    """Return the fit of the map without the presses that stand apart from it; None without any.

    They are sought again beside the map of the others, until they stay.
    """
    fit, others, at = start.joint, None, start.joint.at
    if not compare_residual(whitened_fit(fit, start.scan), settings).bad_presses:
        return None
    found = np.zeros(0, dtype=int)
    for _ in range(settings.trimmed.rounds):
        before, (found, softer) = found, presses_apart(fit.model, at, settings.trimmed)
        if len(found) == 0:
            return None
        presses = tuple(start.scan.press_ids[found].tolist())
        if others is None or not np.array_equal(found, before):
            fewer = start.experiment.without(presses, refill=False)
            if not fewer.is_determined:
                return None
            others = start_fit(_told(fewer, presses), start.catalogue)
            u = others.joint.u
            at = fit.model.corrected(u).linearise(u)  # the finer mesh corrects that map otherwise
    assert others is not None
    readings = start.model.readings.some(found)
    return others, PressesApart(presses, tuple(softer.tolist()), readings)


def _told(experiment: PlacedExperiment, presses: tuple[int, ...]) -> PlacedExperiment:
    """Return an experiment that tells its progress as one without these presses."""
    named, say = ", ".join(map(str, presses)), experiment.say
    return replace(experiment, say=lambda text: say(f"without presses {named}: {text}"))


def _selected(
    start: StartFit,
    seed: int,
    on_step: Callable[[Step], None] | None,
    settings: SelectionSettings,
    few_apart: bool = False,
) -> Explanation:
    law = start.law

    def first(step: Step, say: Progress):
        assert law is not None
        return follow(law, step, start.start, say, settings)

    return forward_selection(
        start.model,
        start.start,
        start.scan,
        start.catalogue,
        seed=seed,
        progress=start.experiment.say,
        on_step=on_step,
        policy=Policy(
            first=first if law is not None and calls_for_effects(law, start) else None,
            few_apart=few_apart,
        ),
        settings=replace(settings, most_effects=0) if start.model.press_error else settings,
        first=start.joint,
    )


def calls_for_effects(law: ContactLaw, start: StartFit) -> bool:
    """Whether the presses call for effects: beside a free map also for those of a partial law."""
    return bool(law.names) or (law.partial is not None and start.fit.field is not None)


def without_suspects(
    start: StartFit,
    seed: int,
    explained: Explanation,
    settings: SelectionSettings = SELECTION,
) -> WithoutSuspects | None:
    """Return the explanation without the outlying presses; None without any."""
    presses = explained.ladder[0].comparison.bad_presses
    free = start.model.map_uncertainty is not None  # its search weights such presses down itself
    if not presses or explained.map_error or free:  # beside a wrong map there are many
        return None
    experiment = _told(start.experiment, presses)
    try:
        if explained.accepted:
            same = _same_answer(replace(start, experiment=experiment), explained, presses, settings)
            if same is not None:
                return same
        fewer = experiment.without(presses)
        if not fewer.is_determined:
            return None
        again = start_fit(fewer, start.catalogue)
        return WithoutSuspects.of(presses, _selected(again, seed, None, settings))
    except (InputError, InadmissibleError):
        return None


def _same_answer(
    start: StartFit,
    explained: Explanation,
    presses: tuple[int, ...],
    settings: SelectionSettings,
) -> WithoutSuspects | None:
    """Return the same explanation without these presses; None if it does not hold there."""
    others = ~np.isin(start.scan.press, presses)
    same = others[start.scan.in_contact]
    excess = explained.final.fit.at.residual**2 - 1
    structured = not explained.final.comparison.is_noise
    if structured and excess[same].sum() < settings.elsewhere * excess.sum():
        return None
    fewer = start.experiment.without(presses, refill=False)
    model = measurement_model(fewer.scan, fewer.body, start.fit)
    again = confirmed(explained, model, fewer.scan, same, fewer.say, settings)
    if again is None:
        return None
    fit, comparison = again
    return replace(WithoutSuspects.of(presses, explained), fit=fit, comparison=comparison)


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
