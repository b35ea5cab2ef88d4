"""Which effects may be added to a step: the best-scored are refitted with the map and compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.special import chdtrc

from identify.effects.base import Effect
from identify.fit.joint_fit import try_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.measurement.model import MeasurementModel
from identify.select.diagnosis import ALIKE, Diagnosis
from identify.select.score_test import Score, holm_significant
from identify.select.step import Step

MARGIN = 10.0  # in chi-square and price, by which one explanation beats another
SURE = 1e-3  # family-wise chance, where nothing but the score speaks for an effect
REFIT_EVALUATIONS = 15
_EASED_WEIGHT, _EASED_RADIUS = 0.35, 1.3
_FAR = 0.3  # of a scaled coordinate of the map: of a logarithm, or of a size of the body
_SHORTLIST = 3
_ENOUGH = 0.5  # in chi-square: a candidate whose steps bring less has shown what it can
# A candidate is beaten if it is so far behind, in chi-square, and has done less than half of the
# best one: a true one has come from behind by 130 once the finer model corrected its map.
BEATEN_BY, _BEATEN_SHARE = 200.0, 0.5
# Of what the best one did: what going on, a few dozen evaluations of it, has never made up for
_LAGS_SHARE = 0.2
_RISE = 1.002  # an addition does not raise the error itself ...
_EXPECTED = 0.5  # ... but where so much of what chi-square falls by is borne out, see `borne_out`
_PROMISED = 0.3  # of the score: a refit that brings less may have begun at the wrong place
_HOPELESS = 0.1  # of the best linear score: a candidate with less does not overtake it by a refit


@dataclass(frozen=True)
class Candidate:
    """An effect that was refitted; `criterion` is chi-square and the price of its parameters."""

    name: str
    chi2: float
    criterion: float
    fit: FitResult

    @property
    def contains(self) -> tuple[str, ...]:
        """Names of the effects that are special cases of it."""
        own = (part.effect for part in self.fit.model.effects if part.effect.name == self.name)
        return next((effect.contains for effect in own), ())


def best_candidates(
    step: Step,
    effects: dict[str, Effect],
    say: Callable[[str], None],
    exclude: Sequence[str],
) -> tuple[Candidate, ...]:
    """Return the best-scored effects that a refit bears out; empty if there are none.

    Far from the truth the linear scores mislead: those next in rank are tried where the best fail,
    and beside the first ones the effects that have a `refitted_from`. Where the residual is noise,
    one of them must have a score that noise does not give in a thousand scans (`SURE`), or one of
    the latter a fall of chi-square.
    """
    chance = SURE if step.comparison.is_noise else 1.0
    scores = [score for score in step.diagnosis.scores if score.untestable is None]
    sure = holm_significant(scores, chance)
    tested = {score.name for score in scores} - set(exclude)
    always = [name for name in effects if effects[name].refitted_from and name in tested]
    tried = list(exclude)
    while names := list(dict.fromkeys([*shortlist(step.diagnosis, tried), *always])):
        candidates = compare_candidates(step, effects, say, names)
        sure |= {
            r.name
            for r in candidates
            if r.name in always and refit_chance(step, r) < chance / len(scores)
        }
        better = candidates and candidates[0].criterion < step.fit.bic
        if better and any(candidate.name in sure for candidate in candidates):
            return candidates
        tried, always = [*tried, *names], []
    return ()


def refit_chance(step: Step, candidate: Candidate) -> float:
    """Chance that noise makes chi-square fall so far by the candidate's further parameters."""
    return float(
        chdtrc(len(candidate.fit.u) - len(step.fit.u), max(step.fit.chi2 - candidate.chi2, 0.0))
    )


def compare_candidates(
    step: Step,
    effects: dict[str, Effect],
    say: Callable[[str], None],
    names: Sequence[str],
) -> tuple[Candidate, ...]:
    """Refit these effects with the map; best first."""
    fits: dict[str, FitResult] = {}
    best = np.inf
    for name in names:
        say(f"trying {name}")
        fit = fit_with(step.fit, effects[name], step.diagnosis[name], best)
        if fit is not None and not is_implausible(fit, name):
            fits[name] = fit
            best = min(best, fit.chi2)
    candidates = []
    for name, fit in sorted(fits.items(), key=lambda item: item[1].chi2):
        say(f"trying {name} further")
        fit = carried_on(fit, step.fit, best)
        if is_implausible(fit, name):  # now
            continue
        best = min(best, fit.chi2)
        if in_earnest(step.fit, fit):
            candidates.append(Candidate(name, fit.chi2, fit.bic, fit))
    return tuple(sorted(candidates, key=lambda candidate: candidate.criterion))


def refit(model: MeasurementModel, stiffness: GaussianMap, **options: int) -> FitResult | None:
    """Refit a candidate, or None where the start is impossible; 15 evaluations where not said."""
    options.setdefault("max_evaluations", REFIT_EVALUATIONS)
    return try_fit(model, stiffness, enough=_ENOUGH, **options)


def beaten(candidate: float, before: float, best: float, share: float = _BEATEN_SHARE) -> bool:
    """Whether a candidate's chi-square is too far behind the best one's."""
    return candidate - best > max(BEATEN_BY, share * (before - best))


def carried_on(fit: FitResult, before: FitResult, best: float) -> FitResult:
    """Refit what had not ended, or took the map far: there the finer model corrects otherwise."""
    free = len(fit.model.space.free)
    far = np.abs(fit.u[:free] - before.u[:free]).max(initial=0.0) > _FAR
    lags = beaten(fit.chi2, before.chi2, best, _LAGS_SHARE)
    if (fit.success and not far) or lags:
        return fit
    return refit(fit.model, fit.map, max_evaluations=2 * REFIT_EVALUATIONS) or fit


def is_implausible(fit: FitResult, name: str) -> bool:
    """Whether an effect of a fit has ended at values that are not to be believed."""
    (part,) = (part for part in fit.model.effects if part.effect.name == name)
    return part.effect.doubt(fit.at.values[name], fit.model.readings) is not None


def in_earnest(before: FitResult, after: FitResult) -> bool:
    """Whether the error itself falls, or most of the fall of chi-square is borne out.

    Chi-square also falls where the model's slope, and with it the noise allowed, grows.
    """
    return after.rms_m <= _RISE * before.rms_m or borne_out(before, after) >= _EXPECTED


def borne_out(before: FitResult, after: FitResult) -> float:
    """Share of the fall of chi-square that stays if only the expected travel changes.

    At the same forces, with the noise allowed before. A steeper law passes more of the force's
    noise on to the residual at the forces as they were read, which then grows though the law is
    right: that residual's rms alone is no judge.
    """
    force = before.at.latent_force_n
    old, new = (
        fit.model.chain.predict(
            fit.at.body.compliance, fit.at.body.local_modulus, force, fit.at.values
        )
        for fit in (before, after)
    )
    moved = before.at.whitened(new - old, before.model.readings.press)
    fall = before.chi2 - float(np.sum((before.at.residual - moved) ** 2))
    return fall / max(before.chi2 - after.chi2, 1e-300)


def shortlist(diagnosis: Diagnosis, exclude: Sequence[str] = ()) -> list[str]:
    """Return the best three significant effects and every significant one that looks like them."""
    candidates = [
        s for s in diagnosis.scores if s.name in diagnosis.significant and s.name not in exclude
    ]
    candidates.sort(key=lambda s: -s.statistic)
    least = _HOPELESS * candidates[0].statistic if candidates else 0.0
    names = [s.name for s in candidates if s.statistic >= least]
    best = names[:_SHORTLIST]
    order = [score.name for score in diagnosis.scores]
    near = [
        name
        for name in names[_SHORTLIST:]
        if any(diagnosis.cosines[order.index(name), order.index(b)] > ALIKE for b in best)
    ]
    return best + near


def fit_with(
    fit: FitResult, effect: Effect, score: Score, candidate: float = np.inf
) -> FitResult | None:
    """Refit with one more effect from its first estimate, or parts of it; the best fit.

    The estimate is linear. Where it is impossible, or far beyond where the effect's law levels off,
    a fit that begins there does not bring what the score promises, and a part of it is tried.
    """
    if effect.refitted_from:
        return _from_afar(fit, effect, candidate)
    best = None
    for share in (1.0, 0.3, 0.03):
        values = dict(score.values)
        for amplitude in effect.amplitudes:
            assert amplitude.null is not None
            moved = share * (values[amplitude.name] - amplitude.null)
            values[amplitude.name] = amplitude.null + moved
        model = fit.model.with_effect(effect, values, fit.at.state)
        found = refit(model, fit.map, rounds=0)
        if found is not None and (best is None or found.chi2 < best.chi2):
            best = found
        if best is not None and fit.chi2 - best.chi2 > _PROMISED * score.statistic:
            break
    return best


def _from_afar(fit: FitResult, effect: Effect, candidate: float) -> FitResult | None:
    """Refit with one more effect from its `refitted_from`, beside an eased map or else the map.

    The finer model corrects the eased map otherwise: without that it does not even fit as well.
    """
    model = fit.model.with_effect(effect, effect.refitted_from, fit.at.state)
    eased = refit(model, _eased(fit), rounds=0)
    if eased is not None and beaten(eased.chi2, fit.chi2, candidate):
        return eased
    eased = None if eased is None else refit(eased.model, eased.map)
    if eased is not None and eased.chi2 <= fit.chi2:
        return eased
    return refit(model, fit.map, rounds=0) or eased


def _eased(fit: FitResult) -> GaussianMap:
    """Return the map with its inclusions deeper, wider and softer, which the surface feels alike.

    What a wrong shape drives to the surface, where its bound holds it, comes from there.
    """
    readings, inclusions = fit.model.readings, []
    for inclusion in fit.map.inclusions:
        centre = np.array([inclusion.x_m, inclusion.y_m, inclusion.z_m])
        nearest = np.argmin(np.sum((readings.point_m - centre) ** 2, axis=1))
        x, y, z = (centre + inclusion.radius_m * readings.direction[nearest]).tolist()
        weight, radius = _EASED_WEIGHT * inclusion.weight_pa, _EASED_RADIUS * inclusion.radius_m
        inclusions.append(Inclusion(weight, x, y, z, radius))
    eased = GaussianMap(fit.map.background_pa, tuple(inclusions))
    free = dict(zip(eased.names, eased.values.tolist(), strict=True))
    return fit.map.changed({name: free[name] for name in fit.model.space.names})
