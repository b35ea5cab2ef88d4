"""Outlying presses: test of an explanation without them.

A slip or a wrong place looks like an effect. Presses that stand apart from a map that meets the
others are therefore left out first, and the missing effects are sought for the others. Where these
leave noise there, one further effect at most is sought with all presses, which might account for
those apart. Otherwise the explanation of all presses is tested without the outlying ones: its model
is fitted anew, and each effect must earn its place again and do better than the other candidates.
If any does not, the selection runs once more without these presses, and an effect found only with
them is not offered by name.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from identify.fit.result import FitResult
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.residual.compare import compare_residual
from identify.residual.comparison import Comparison
from identify.residual.trimmed import further, missed, presses_apart
from identify.select.confirm import confirmed
from identify.select.diagnosis import diagnose
from identify.select.explanation import Explanation, PressesApart, Verdict
from identify.select.first_step import selected, with_exact_map
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
    others = _Others(start, seed, settings)
    rest = _apart(others, start.joint, (True,))
    explained = selected(start, seed, on_step, settings, rest and rest.answer)
    if not explained.final.comparison.is_noise:
        rest = rest or _apart(others, explained.final.fit, (True, False))
        if rest is not None:
            if on_step:
                on_step(rest.answer.final)
            answer = replace(rest.answer, verdict="unexplained", apart=rest.apart)
            return answer, None, rest.start
    without = without_suspects(start, seed, explained, settings, others)
    return weighed(explained, without), without, start


@dataclass(frozen=True)
class _Rest:
    """The scan without the presses that stand apart: its start, and its answer, which is noise."""

    start: StartFit
    apart: PressesApart
    answer: Explanation


@dataclass
class _Others:
    """Starts and answers of a scan without some presses (ids), each made once."""

    start: StartFit
    seed: int
    settings: SelectionSettings
    starts: dict[tuple[int, ...], StartFit | None] = field(default_factory=dict)
    answers: dict[tuple[tuple[int, ...], bool], Explanation] = field(default_factory=dict)

    def without(self, presses: tuple[int, ...]) -> StartFit | None:
        """Return the fit of the map without presses, None where the others are too few."""
        if presses not in self.starts:
            start = self.start
            fewer = start.experiment.without(presses, refill=False)
            fit = start_fit(_told(fewer, presses), start.catalogue) if fewer.is_determined else None
            self.starts[presses] = fit
        return self.starts[presses]

    def answer(
        self, presses: tuple[int, ...], rest: StartFit, one_effect: bool = False
    ) -> Explanation:
        """Return the selection of the `rest`, the scan without presses; see `selected`."""
        if (key := (presses, one_effect)) not in self.answers:
            self.answers[key] = selected(rest, self.seed, None, self.settings, None, one_effect)
        return self.answers[key]

    def is_noise(self, fit: FitResult, start: StartFit) -> bool:
        """Whether the residual of a fit is noise."""
        return compare_residual(whitened_fit(fit, start.scan), self.settings.residual).is_noise

    def beside(self, fit: FitResult) -> tuple[MeasurementModel, Linearised]:
        """Return all presses beside the map and effects of a fit to some of them."""
        model = replace(self.start.model, effects=fit.model.started(fit.u).effects)
        model = model.corrected(fit.u)  # the finer mesh corrects each map otherwise
        return model, model.linearise(fit.u)


def _apart(others: _Others, fit: FitResult, one_effect: Sequence[bool]) -> _Rest | None:
    """Return the scan without the presses that stand apart from a map and effects of the others.

    None where no press stands apart, or the others have structure that no effect takes. Several
    effects, one after the other, would otherwise be fitted to a few presses that slipped. One
    effect of the others is sought, or all: these take long where the map has another form.

    Parameters
    ----------
    fit : of all presses, beside whose effects they are sought first
    one_effect : one after the other
    """
    start = others.start
    if start.fit.field is not None or start.model.press_error:
        return None
    bad = compare_residual(whitened_fit(fit, start.scan), others.settings.residual).bad_presses
    if not bad:
        return None
    try:
        suspected = _suspected(others, fit, bad)
        for one in one_effect:
            for found in suspected:
                rest = _settled(others, found, one)
                if rest is not None:
                    return rest
    except (InputError, InadmissibleError):
        pass
    return None


def _suspected(others: _Others, fit: FitResult, bad: tuple[int, ...]) -> list[np.ndarray]:
    """Return presses (indices) that may stand apart: from the map alone, if that meets the others.

    Else those apart beside one effect of all, and the `bad` ones (ids), which no smooth pattern
    accounts for.
    """
    start, trimmed = others.start, others.settings.residual.trimmed
    found = presses_apart(fit.model, fit.at, trimmed)
    rest = others.without(_ids(start, found)) if len(found) else None
    if rest is not None and others.is_noise(rest.joint, rest):
        return [found]
    beside = presses_apart(fit.model, fit.at, trimmed, _one_effect(fit, others))
    worst = np.flatnonzero(np.isin(start.scan.press_ids, bad))
    few = len(worst) <= (1 - trimmed.kept) * len(start.scan.press_ids)
    return [beside, worst] if few and not np.array_equal(beside, worst) else [beside]


def _settled(others: _Others, found: np.ndarray, one_effect: bool) -> _Rest | None:
    """Return the scan without presses (indices) that are sought again until they stay, or None.

    One that the model of the others predicts is taken back, unless structure comes with it.

    Parameters
    ----------
    one_effect : beside the best effect of the others alone
    """
    start, trimmed = others.start, others.settings.residual.trimmed
    larger, tried = None, set()
    while len(found) and (presses := _ids(start, found)) not in tried:
        tried.add(presses)
        rest = others.without(presses)
        if rest is None:
            break
        answer = others.answer(presses, rest, one_effect=True)
        model, at = others.beside(answer.final.fit)
        if not answer.final.comparison.is_noise:
            again = presses_apart(model, at, trimmed)
            press = model.readings.press
            if hold_misfit(press, at.residual, found, again, others.settings.elsewhere):
                rest.model.mechanics.forget()
                found = again
                continue
            if not one_effect:
                answer = others.answer(presses, rest)
                model, at = others.beside(answer.final.fit)
        rest.model.mechanics.forget()
        if not answer.final.comparison.is_noise:
            break
        still = missed(model, at, found, trimmed)
        if not still.any():
            break
        softer, readings = further(model, at, found), start.model.readings.some(found)
        apart = PressesApart(presses, tuple(softer.tolist()), readings, answer.verdict)
        larger, found = _Rest(rest, apart, answer), found[still]
        if still.all():
            break
    return larger


def hold_misfit(
    press: np.ndarray, residual: np.ndarray, found: np.ndarray, again: np.ndarray, share: float
) -> bool:
    """Whether presses found again hold a share of what is unexplained beside those found before.

    Else a map of the wrong form makes another press stand apart at every turn.

    Parameters
    ----------
    press, residual : (m,) index of each reading's press, and its whitened residual
    found, again : presses (indices)
    """
    excess = np.bincount(press, residual**2 - 1)
    excess[found] = 0.0
    return bool(excess[again].sum() > share * max(excess.sum(), 0.0))


def _ids(start: StartFit, found: np.ndarray) -> tuple[int, ...]:
    """Return the ids of presses (indices)."""
    return tuple(start.scan.press_ids[found].tolist())


def _one_effect(fit: FitResult, others: _Others) -> list[np.ndarray]:
    """Return the columns of each effect with a significant score; of a law, not of any curve.

    A curve of any shape bends to the presses that slipped.
    """
    laws = [effect for effect in others.start.catalogue if not effect.any_shape]
    others.start.experiment.say("seeking presses that stand apart")
    scores = diagnose(fit, laws, seed=others.seed, settings=others.settings.diagnosis)
    return [scores[name].beyond for name in sorted(scores.significant)]


def _told(experiment: PlacedExperiment, presses: tuple[int, ...]) -> PlacedExperiment:
    """Return an experiment that tells its progress as one without these presses."""
    named, say = ", ".join(map(str, presses)), experiment.say
    return replace(experiment, say=lambda text: say(f"without presses {named}: {text}"))


def without_suspects(
    start: StartFit,
    seed: int,
    explained: Explanation,
    settings: SelectionSettings = SELECTION,
    others: _Others | None = None,
) -> WithoutSuspects | None:
    """Return the explanation without the outlying presses; None without any.

    `others` : selections without some presses that were made before
    """
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
        made = others.answers.get((presses, False)) if others is not None else None
        if made is not None and experiment.whole is None:
            return WithoutSuspects.of(presses, made)
        fewer = experiment.without(presses)
        if not fewer.is_determined:
            return None
        again = start_fit(fewer, start.catalogue)
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
