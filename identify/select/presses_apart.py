"""Presses that stand apart from a model that meets all others, and the answer of the others.

Of a map of inclusions they are sought by least trimmed squares (`identify.residual.trimmed`), and
again beside what the others show. A free map follows a single press: there they are those of which
an error of the press is likelier than any ball (`identify.fit.free_map.spots`).
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from identify.fit.free_map.field import Field
from identify.fit.result import FitResult
from identify.map.parameters import ParameterSpace
from identify.measurement.experiment import PlacedExperiment
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError
from identify.residual.compare import compare_residual
from identify.residual.trimmed import further, missed, presses_apart
from identify.select.diagnosis import diagnose
from identify.select.explanation import Explanation, PressesApart
from identify.select.first_step import selected
from identify.select.settings import SelectionSettings
from identify.select.start_fit import StartFit, start_fit
from identify.select.step import whitened_fit
from models import InputError


@dataclass(frozen=True)
class Rest:
    """The scan without the presses that stand apart: its start, and its answer, which is noise."""

    start: StartFit
    apart: PressesApart
    answer: Explanation


@dataclass
class Others:
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
            fit, tried = None, start.leading_sets(presses)
            if fewer.is_determined:
                fit = start_fit(told(fewer, presses), start.catalogue, tried=tried)
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
        if fit.field is not None:  # the presses as they are, not as sure as a free map is there
            space = ParameterSpace(fit.map, (), ())
            model = replace(model, space=space, map_uncertainty=None)
        model = model.corrected(fit.u)  # the finer mesh corrects each map otherwise
        return model, model.linearise(fit.u)


def apart(others: Others, fit: FitResult, one_effect: Sequence[bool]) -> Rest | None:
    """Return the scan without the presses that stand apart from a map and effects of the others.

    None where no press stands apart, or the others have structure that no effect takes. Several
    effects, one after the other, would otherwise be fitted to a few presses that slipped. One
    effect of the others is sought, or all: these take long where the map has another form. None
    either where the effects of all presses were sought, and most of the structure lies elsewhere.

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
        found = presses_apart(fit.model, fit.at, others.settings.residual.trimmed)
        worst = np.flatnonzero(np.isin(start.scan.press_ids, bad))
        press, none = fit.model.readings.press, np.zeros(0, int)
        few, share = np.union1d(found, worst), others.settings.elsewhere
        # Structure of the others that all effects leave is there without these presses, too
        if fit is not start.joint and not hold_misfit(press, fit.at.residual, none, few, share):
            return None
        suspected = _suspected(others, fit, found, worst)
        for one in one_effect:
            for found in suspected:
                rest = _settled(others, found, one)
                if rest is not None:
                    return rest
    except (InputError, InadmissibleError):
        pass
    return None


def beside_free_map(others: Others, field: Field) -> Rest | None:
    """Return the scan without the presses that slipped, as a free map shows.

    None where there are none, or where the others have structure that no effect takes.

    Parameters
    ----------
    field : the free map of all presses
    """
    start, found = others.start, np.flatnonzero(field.slipped)
    if not len(found):
        return None
    presses = _ids(start, found)
    try:
        rest = others.without(presses)
        answer = rest and others.answer(presses, rest)
        if rest is None or answer is None or not answer.final.comparison.is_noise:
            return None
        model, at = others.beside(answer.final.fit)
    except (InputError, InadmissibleError):
        return None
    softer, readings = further(model, at, found), start.model.readings.some(found)
    return Rest(rest, PressesApart(presses, tuple(softer.tolist()), readings, answer.verdict),
                answer)  # fmt: skip


def _suspected(
    others: Others, fit: FitResult, found: np.ndarray, worst: np.ndarray
) -> list[np.ndarray]:
    """Return presses (indices) that may stand apart: those `found`, if the map meets the others.

    Else those apart beside one effect of all, and the `worst` ones, which no smooth pattern
    accounts for.
    """
    start, trimmed = others.start, others.settings.residual.trimmed
    rest = others.without(_ids(start, found)) if len(found) else None
    if rest is not None and others.is_noise(rest.joint, rest):
        return [found]
    beside = presses_apart(fit.model, fit.at, trimmed, _one_effect(fit, others))
    few = len(worst) <= (1 - trimmed.kept) * len(start.scan.press_ids)
    return [beside, worst] if few and not np.array_equal(beside, worst) else [beside]


def _settled(others: Others, found: np.ndarray, one_effect: bool) -> Rest | None:
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
        larger, found = Rest(rest, apart, answer), found[still]
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


def _one_effect(fit: FitResult, others: Others) -> list[np.ndarray]:
    """Return the columns of each effect with a significant score; of a law, not of any curve.

    A curve of any shape bends to the presses that slipped.
    """
    laws = [effect for effect in others.start.catalogue if not effect.any_shape]
    others.start.experiment.say("seeking presses that stand apart")
    scores = diagnose(fit, laws, seed=others.seed, settings=others.settings.diagnosis)
    return [scores[name].beyond for name in sorted(scores.significant)]


def told(experiment: PlacedExperiment, presses: tuple[int, ...]) -> PlacedExperiment:
    """Return an experiment that tells its progress as one without these presses."""
    named, say = ", ".join(map(str, presses)), experiment.say
    return replace(experiment, say=lambda text: say(f"without presses {named}: {text}"))
