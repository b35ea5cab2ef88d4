"""Candidates for the next effect: the best-scored ones, refitted with the map and compared."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import chdtrc

from identify.effects.base import Effect, advice
from identify.fit.joint_fit import try_fit
from identify.fit.result import FitResult
from identify.fit.settings import TRIAL
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.measurement.model import MeasurementModel
from identify.select.diagnosis import shortlist
from identify.select.score_test import Score, fitted_basis, holm_significant
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import Step


@dataclass(frozen=True)
class Candidate:
    """An effect that was refitted; `criterion` is its Bayesian information criterion (BIC)."""

    name: str
    chi2: float
    criterion: float
    fit: FitResult

    @property
    def contains(self) -> tuple[str, ...]:
        """Names of the effects that are special cases of it."""
        return next((effect.contains for effect in self._effect), ())

    @property
    def family(self) -> str:
        """Family of the effect, its own name without one."""
        return next((effect.family for effect in self._effect), self.name)

    @property
    def has_size(self) -> bool:
        """Whether an amplitude of the effect is two standard errors away from its null."""
        values, std = self.fit.values, self.fit.std
        return any(
            abs(values[key] - absent) > 2 * std[key]
            for effect in self._effect
            for key, absent in ((f"{effect.name}.{name}", v) for name, v in effect.null.items())
        )

    @property
    def _effect(self) -> list[Effect]:
        return [part.effect for part in self.fit.model.effects if part.effect.name == self.name]


def best_candidates(
    step: Step,
    effects: dict[str, Effect],
    say: Callable[[str], None],
    exclude: Sequence[str],
    settings: SelectionSettings = SELECTION,
) -> tuple[Candidate, ...]:
    """Return the best-scored effects that a refit supports; empty without any.

    Far from the truth the linear scores mislead: if the best fail, the next in rank are tried, and
    beside the first ones the effects with a `refitted_from`. One of them needs a p-value below
    `settings.sure`, by its score or, with a `refitted_from`, by its refit.
    """
    scores = [score for score in step.diagnosis.scores if score.untestable is None]
    sure = holm_significant(scores, settings.sure)
    tested = {score.name for score in scores} - set(exclude)
    always = [name for name in effects if advice(effects[name]).refitted_from and name in tested]
    tried = list(exclude)
    while names := list(dict.fromkeys([*shortlist(step.diagnosis, tried, settings), *always])):
        candidates = compare_candidates(step, effects, say, names, settings)
        sure |= {
            c.name
            for c in candidates
            if c.name in always and refit_p_value(step, c) < settings.sure / len(scores)
        }
        better = candidates and candidates[0].criterion < step.fit.bic
        if better and any(candidate.name in sure for candidate in candidates):
            return candidates
        tried, always = [*tried, *names], []
    return ()


def leaving_noise(
    candidates: tuple[Candidate, ...],
    is_noise: Callable[[FitResult], bool],
    settings: SelectionSettings = SELECTION,
) -> tuple[Candidate, ...]:
    """Put the first candidate that leaves noise before others that do as well and leave structure.

    A simpler form may win by the price of a parameter, and yet leave what the right one explains:
    one that contains it does as well where chance gives its gain in less than `settings.sure`.
    """
    first = candidates[0]
    near = [
        c
        for c in candidates
        if c.criterion < first.criterion + settings.margin
        or (first.name in c.contains and gains(first, c, settings.sure))
    ]
    if len(near) == 1 or is_noise(first.fit):
        return candidates
    for candidate in near[1:]:
        if is_noise(candidate.fit):
            return (candidate, *(c for c in candidates if c is not candidate))
    return candidates


def gains(first: Candidate, other: Candidate, chance: float) -> bool:
    """Return True if a dearer candidate gains more than its further parameters do by chance."""
    gain = first.chi2 - other.chi2
    return gain > 0 and chdtrc(len(other.fit.u) - len(first.fit.u), gain) < chance


def refit_p_value(step: Step, candidate: Candidate) -> float:
    """P-value of the decrease of chi-square by the candidate's further parameters."""
    decrease = max(step.fit.chi2 - candidate.chi2, 0.0)
    return float(chdtrc(len(candidate.fit.u) - len(step.fit.u), decrease))


def compare_candidates(
    step: Step,
    effects: dict[str, Effect],
    say: Callable[[str], None],
    names: Sequence[str],
    settings: SelectionSettings = SELECTION,
) -> tuple[Candidate, ...]:
    """Refit these effects with the map; best first."""
    fits: dict[str, FitResult] = {}
    best = np.inf
    for name in names:
        say(f"trying {name}")
        fit = fit_with(step.fit, effects[name], step.diagnosis[name], best, settings)
        if fit is not None and not is_implausible(fit, name):
            fits[name] = fit
            best = min(best, fit.chi2)
    candidates = []
    leading = min((fit.bic for fit in fits.values()), default=np.inf)
    for name, fit in sorted(fits.items(), key=lambda item: item[1].chi2):
        say(f"trying {name} further")
        target = target_of(fit.model, leading, best, settings)
        fit = refit_further(fit, step.fit, best, settings, target)
        if is_implausible(fit, name):  # now
            continue
        best, leading = min(best, fit.chi2), min(leading, fit.bic)
        if is_improvement(step.fit, fit, settings):
            candidates.append(Candidate(name, fit.chi2, fit.bic, fit))
    return ranked(candidates, settings)


def ranked(
    candidates: Sequence[Candidate], settings: SelectionSettings = SELECTION
) -> tuple[Candidate, ...]:
    """Return candidates by their criterion; of forms of a cause as good, a special case first.

    Creep of the whole body is one of creep on one side, whose place the scan then does not show. It
    must be of determined size: creep by a power of the time may be nearly elastic, and its size
    then anything.
    """
    order = sorted(candidates, key=lambda c: c.criterion)
    forms = [
        c for c in order
        if c.family == order[0].family and c.criterion < order[0].criterion + settings.margin
    ]  # fmt: skip
    special = [c for c in forms if c.name in order[0].contains]
    best = next((c for c in (*special, *forms) if c.has_size), None)
    if best is not None:
        order.remove(best)
        order.insert(0, best)
    return tuple(order)


def target_of(
    model: MeasurementModel, criterion: float, chi2: float, settings: SelectionSettings
) -> float:
    """Chi-square below which a model does as well as the best one, of given criterion and chi2."""
    price = len(model.names) * float(np.log(len(model.displacement_m)))
    return max(criterion + settings.margin - price, chi2 + settings.close)


def refit(
    model: MeasurementModel, stiffness: GaussianMap, settings: SelectionSettings, **options: Any
) -> FitResult | None:
    """Refit a candidate by few evaluations, or None where the start is impossible."""
    options.setdefault("max_evaluations", settings.refit_evaluations)
    return try_fit(model, stiffness, enough=settings.refit_gain, settings=TRIAL, **options)


def is_beaten(
    chi2: float, before: float, best: float, settings: SelectionSettings, share: float | None = None
) -> bool:
    """Whether a chi-square is too far behind the best one, both down from that before.

    `share` of the best improvement; default `settings.behind_share`.
    """
    share = settings.behind_share if share is None else share
    return chi2 - best > max(settings.behind_chi2, share * (before - best))


def refit_further(
    fit: FitResult,
    before: FitResult,
    best: float,
    settings: SelectionSettings,
    target: float | None = None,
) -> FitResult:
    """Continue a refit that had not ended, or went far from the last correction.

    Not to its end where it hardly comes nearer to the `target`, see `target_of`.
    """
    free = len(fit.model.space.free)
    far = np.abs(fit.u[:free] - before.u[:free]).max(initial=0.0) > settings.far_map
    counted = fit.model.mechanics.counts_support(fit.at.state)
    ended = fit.success and counted and not (far and not _out_of_reach(fit, best, settings))
    if ended or is_beaten(fit.chi2, before.chi2, best, settings, settings.lagging_share):
        return fit
    most = 2 * settings.refit_evaluations
    return refit(fit.model, fit.map, settings, max_evaluations=most, target=target) or fit


def _out_of_reach(fit: FitResult, best: float, settings: SelectionSettings) -> bool:
    """Whether no other correction can bring a fit that converged near the best chi-square.

    A correction that is off by x moves chi-square by 2 r'x + x'x, where the fitted parameters take
    up their part of x. The residual's own part of chi-square beyond the noise is what can lie
    along x; the noise adds three standard deviations.
    """
    off = fit.at.body.correction_off
    if off is None:
        return False
    model, at = fit.model, fit.at
    moved = model.moved_by_body(at, off * at.body.compliance, np.zeros_like(off))
    moved = at.whitened(moved, model.readings.press)
    fitted = fitted_basis(at)
    length = settings.correction_doubt * np.linalg.norm(moved - fitted @ (fitted.T @ moved))
    structure = np.sqrt(max(fit.chi2 - fit.dof, 0.0)) + 3.0
    return bool(fit.chi2 - best > settings.margin + length * (2 * structure + length))


def is_implausible(fit: FitResult, name: str) -> bool:
    """Doubt of an effect about its own values in a fit."""
    (part,) = (part for part in fit.model.effects if part.effect.name == name)
    return advice(part.effect).doubt(fit.at.values[name], fit.model.readings) is not None


def is_improvement(before: FitResult, after: FitResult, settings: SelectionSettings) -> bool:
    """Whether the rms residual falls, or the predicted travel alone explains enough.

    Chi-square also falls where the model's slope, and with it the noise allowed, grows.
    """
    if after.rms_m <= settings.error_rise * before.rms_m:
        return True
    return predicted_share(before, after) >= settings.predicted_share


def predicted_share(before: FitResult, after: FitResult) -> float:
    """Share of the decrease of chi-square that is due to the predicted travel alone.

    At the same forces, with the noise allowed before. A steeper law passes more of the force's
    noise on to the residual at the measured forces, which then grows though the law is right: the
    rms of that residual alone is no criterion.
    """
    force = before.at.latent_force_n
    old, new = (
        fit.model.chain.predict(fit.at.point._replace(force_n=force)) for fit in (before, after)
    )
    moved = before.at.whitened(new - old, before.model.readings.press)
    decrease = before.chi2 - float(np.sum((before.at.residual - moved) ** 2))
    return decrease / max(before.chi2 - after.chi2, 1e-300)


def fit_with(
    fit: FitResult,
    effect: Effect,
    score: Score,
    best_chi2: float = np.inf,
    settings: SelectionSettings = SELECTION,
) -> FitResult | None:
    """Refit with one more effect from its linear estimate, or parts of it; the best fit.

    If the estimate is impossible, or far beyond the levelling of the effect's law, the fit does not
    bring the promised decrease of chi-square, and a part of the estimate is tried.

    Parameters
    ----------
    best_chi2 : of other candidates so far
    """
    if advice(effect).refitted_from:
        return _from_afar(fit, effect, best_chi2, settings)
    best = None
    for share in settings.start_shares:
        values = dict(score.values)
        for amplitude in effect.amplitudes:
            assert amplitude.null is not None
            moved = share * (values[amplitude.name] - amplitude.null)
            values[amplitude.name] = amplitude.null + moved
        model = fit.model.with_effect(effect, values, fit.at.state)
        after = refit(model, fit.map, settings, rounds=0)
        if after is not None and (best is None or after.chi2 < best.chi2):
            best = after
        if best is not None and fit.chi2 - best.chi2 > settings.promised * score.statistic:
            break
    return best


def _from_afar(
    fit: FitResult, effect: Effect, best_chi2: float, settings: SelectionSettings
) -> FitResult | None:
    """Refit with one more effect from its `refitted_from`, beside an eased map or else the map.

    The finer model corrects the eased map otherwise: without that it does not even fit as well.
    """
    model = fit.model.with_effect(effect, advice(effect).refitted_from, fit.at.state)
    eased = refit(model, _eased(fit, settings), settings, rounds=0)
    if eased is not None and is_beaten(eased.chi2, fit.chi2, best_chi2, settings):
        return eased
    eased = None if eased is None else refit(eased.model, eased.map, settings)
    if eased is not None and eased.chi2 <= fit.chi2:
        return eased
    return refit(model, fit.map, settings, rounds=0) or eased


def _eased(fit: FitResult, settings: SelectionSettings) -> GaussianMap:
    """Return the map with its inclusions deeper, wider and softer, alike at the surface.

    An inclusion of a wrong shape ends at the surface, held by its bound; from here it finds back.
    """
    if fit.model.map_uncertainty is not None:
        return fit.map  # of every shape, and beside every other of its prior
    readings, inclusions = fit.model.readings, []
    for inclusion in fit.map.inclusions:
        centre = np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m])
        nearest = np.argmin(np.sum((readings.point_m - centre) ** 2, axis=1))
        x, y, z = (centre + inclusion.radius_m * readings.direction[nearest]).tolist()
        weight = settings.eased_weight * inclusion.weight_pa
        radius = settings.eased_radius * inclusion.radius_m
        inclusions.append(Inclusion(weight, x, y, z, radius))
    eased = GaussianMap(fit.map.background_pa, tuple(inclusions))
    free = dict(zip(eased.names, eased.values.tolist(), strict=True))
    return fit.map.changed({name: free[name] for name in fit.model.space.names})
