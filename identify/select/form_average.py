"""Intervals averaged over the models that a scan does not separate.

A map, and every other effect, is estimated beside one form of a cause. Another form that fits as
well may want other values: creep that is over before the first reading is elastic for one law and
creep for the next, and a late force channel looks like the fastest part of creep. So the models
with a candidate in place of an accepted effect are weighed by their evidence, in Laplace's
approximation,

    ln Z = -chi2/2 - sum_i ((u_i - c_i)/s_i)^2/2 - sum_i ln s_i - ln det(H)/2,

H the inverse covariance of all unknowns and of the prior, N(c_i, s_i^2) of the effect's scaled
parameters: amplitudes about their null, shapes over their bounds. A parameter that the scan does
not show then costs nothing, unlike in the BIC, and does not hide behind a simpler law. The interval
is the central 95 % of the mixture.

Beside a structured residual no interval can be right. They are at least as wide as the structure
itself asks for: by the scatter of the presses' pulls on each unknown, in which the readings of a
press share an error of any form, or by the size of the residual over the noise, the larger.
Sources: J. A. Hoeting et al., Bayesian model averaging, Statist. Sci. 14 (1999) 382-417;
K.-Y. Liang, S. L. Zeger, Longitudinal data analysis using generalized linear models, Biometrika 73
(1986) 13-22 (the pulls of clusters).
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import brentq
from scipy.special import ndtr

from identify.fit.profile_intervals import NORMAL_95
from identify.fit.result import Estimate, FitResult
from identify.select.candidates import Candidate
from identify.select.explanation import Explanation

_AMPLITUDE = 5.0  # typical sizes: one standard deviation of an amplitude's prior
_LEAST = 0.01  # share of the evidence below which a model does not count


@dataclass(frozen=True)
class Form:
    """A model with a candidate in place of an accepted effect.

    Attributes
    ----------
    effect : the accepted one; empty for the last model itself
    name : the candidate
    weight : share of the evidence of all models
    scaled : mean and variance of each scaled unknown that the last model has, too, by name
    """

    effect: str
    name: str
    weight: float
    scaled: Mapping[str, tuple[float, float]]


def forms_of(explained: Explanation) -> tuple[Form, ...]:
    """Return the last model and those that the scan does not separate from it, by weight.

    They have another form of an accepted effect, or another effect of its ambiguous group.
    Empty beside a structured residual, whose cause is in none of them. A candidate was fitted less
    far than the last model: it is compared with the accepted effect as it was fitted then, and its
    values move with that one's to the last model.
    """
    final = explained.final.fit
    if explained.fitted_verdict == "unexplained" or not explained.accepted or explained.map_error:
        return ()
    own, now = set(final.effect_names), dict(zip(final.model.names, final.u.tolist(), strict=True))
    forms = [Form("", "", 1.0, _posterior(final))]
    for accepted in explained.accepted:
        beside = own - {accepted.name}
        family = next((c.family for c in accepted.candidates if c.name == accepted.name), "")
        near: list[Candidate] = [
            c for c in accepted.candidates
            if set(c.fit.effect_names) == beside | {c.name} and c.name not in beside
            and (c.name in accepted.group or c.family == family)
        ]  # fmt: skip
        winner = next((c for c in near if c.name == accepted.name), None)
        if winner is None:
            continue
        then = dict(zip(winner.fit.model.names, winner.fit.u.tolist(), strict=True))
        for c in near:
            if c is winner or c.fit.at_bound:
                continue
            weight = 1.0  # of laws of contact that are equal as far as these are right
            if not accepted.shown_by_presses:
                weight = float(np.exp(min(log_evidence(c.fit) - log_evidence(winner.fit), 50.0)))
            scaled = {
                name: (mean + now[name] - then[name], variance)
                for name, (mean, variance) in _posterior(c.fit).items()
                if name in now and name in then
            }
            forms.append(Form(accepted.name, c.name, weight, scaled))
    total = sum(form.weight for form in forms)
    shares = [replace(form, weight=form.weight / total) for form in forms]
    kept = [form for form in shares if form.weight >= _LEAST or not form.effect]
    return tuple(sorted(kept, key=lambda form: (form.effect != "", -form.weight)))


def log_evidence(fit: FitResult) -> float:
    """Return the logarithm of a fit's evidence, but for a constant of scan and map."""
    centre, width, first = _prior(fit)
    pull = (fit.u[first:] - centre) / width
    logdet = np.linalg.slogdet(_information(fit))[1]
    return float(-0.5 * (fit.chi2 + pull @ pull + logdet) - np.log(width).sum())


def _information(fit: FitResult) -> np.ndarray:
    """Inverse covariance (k, k) of a fit's scaled unknowns, from noise and prior."""
    _, width, first = _prior(fit)
    found = fit.at.jacobian.T @ fit.at.jacobian
    found[np.diag_indices(len(found))] += 1e-12 * found.diagonal().max()
    found[first:, first:] += np.diag(1 / width**2)
    return found


def _prior(fit: FitResult) -> tuple[np.ndarray, np.ndarray, int]:
    """Prior of the effects' scaled parameters: centre, width, place of the first one.

    As wide as the estimate is large: what an amplitude may be is no matter of the prior.
    """
    first = len(fit.model.space.free)
    centre, width = [], []
    for part in fit.model.effects:
        for p in part.parameters:
            low, high = p.to_scaled(p.lower), p.to_scaled(p.upper)
            if p.null is None:
                centre.append((low + high) / 2)
                width.append((high - low) / np.sqrt(12))
            else:
                centre.append(p.to_scaled(p.null))
                width.append(max(_AMPLITUDE, abs(fit.u[first + len(width)] - centre[-1])))
    return np.array(centre), np.array(width), first


def averaged(explained: Explanation, forms: Sequence[Form]) -> dict[str, Estimate]:
    """Return the estimates of the last model, with intervals averaged over the forms.

    Those of an effect are averaged over the forms of the others. Beside a structured residual, all
    standard errors and intervals are wider (`structure_factor`).
    """
    last = explained.final.fit
    structured = not explained.told_apart and last.solution is not None and last.field is None
    found = last.intervals(curved=False) if structured else dict(last.parameters)
    if structured:  # a valley of the misfit says nothing there
        for p, factor in zip(last.model.unknowns.unknowns, structure_factor(last), strict=True):
            own = found[p.name]
            at, *ends = (p.to_scaled(v) for v in (own.value, own.lower95, own.upper95))
            low, high = (p.to_value(at + factor * (end - at)) for end in ends)
            found[p.name] = replace(own, std=factor * own.std, lower95=max(low, p.lower),
                                    upper95=min(high, p.upper))  # fmt: skip
        return found
    if not explained.final.comparison.is_noise:
        found |= _beside_other_laws(explained, found)
    if len(forms) < 2 or last.solution is None:
        return found
    of_meshes = np.diag(last.solution.covariance - last.solution.noise_covariance)
    for p, known in zip(last.model.unknowns.unknowns, of_meshes.tolist(), strict=True):
        beside = [form for form in forms if p.name in form.scaled]
        if len(beside) < 2:
            continue
        own = found[p.name]
        weights = np.array([form.weight for form in beside])
        mean, variance = np.array([form.scaled[p.name] for form in beside]).T
        below = np.sqrt(variance + max(known, 0.0))
        above = below.copy()
        # the last model's own interval follows the bend of the misfit's valley
        mean[0], low, high = (p.to_scaled(v) for v in (own.value, own.lower95, own.upper95))
        below[0], above[0] = (mean[0] - low) / NORMAL_95, (high - mean[0]) / NORMAL_95
        below, above = np.maximum(below, 1e-12), np.maximum(above, 1e-12)
        share = weights / weights.sum()
        ends = [p.to_value(_quantile(q, share, mean, below, above)) for q in (0.025, 0.975)]
        found[p.name] = replace(own, lower95=max(ends[0], p.lower), upper95=min(ends[1], p.upper))
    return found


def _beside_other_laws(
    explained: Explanation, found: Mapping[str, Estimate]
) -> dict[str, Estimate]:
    """Return the estimates whose intervals count other laws of contact.

    These are as credible where structure is left (`AcceptedEffect.range_of`).
    """
    bounds = {p.name: p for p in explained.final.fit.model.unknowns.unknowns}
    wider = {}
    for accepted in explained.accepted:
        for key, (down, up) in accepted.range_of.items():
            name = f"{accepted.name}.{key}"
            own, p = found[name], bounds[name]
            low, high = max(own.lower95 + down, p.lower), min(own.upper95 + up, p.upper)
            wider[name] = replace(own, lower95=low, upper95=high)
    return wider


def structure_factor(fit: FitResult) -> np.ndarray:
    """Factor (k,), at least one, on the standard errors of a fit with a structured residual."""
    assert fit.solution is not None
    press, k = fit.model.readings.press, len(fit.u)
    pull = np.zeros((fit.model.readings.presses, k))
    np.add.at(pull, press, fit.at.jacobian * fit.at.residual[:, None])
    noise = fit.solution.noise_covariance
    variance = np.sum((pull @ noise) ** 2, axis=0) * len(pull) / max(len(pull) - k, 1)
    variance = np.maximum(variance, fit.chi2_per_dof * np.diag(noise))
    known = np.diag(fit.solution.covariance)
    variance += known - np.diag(noise)  # that of the meshes
    return np.sqrt(np.maximum(variance / np.maximum(known, 1e-300), 1.0))


def posterior_covariance(fit: FitResult) -> np.ndarray:
    """Covariance (k, k) of a fit's scaled unknowns, from noise and the effects' prior."""
    return np.linalg.inv(_information(fit))


def _posterior(fit: FitResult) -> dict[str, tuple[float, float]]:
    """Mean and variance of a fit's scaled unknowns by name, from noise and prior."""
    centre, width, first = _prior(fit)
    covariance = posterior_covariance(fit)
    pull = np.zeros(len(fit.u))
    pull[first:] = (fit.u[first:] - centre) / width**2
    mean, variance = fit.u - covariance @ pull, np.diag(covariance)
    pairs = zip(mean.tolist(), variance.tolist(), strict=True)
    return dict(zip(fit.model.names, pairs, strict=True))


def _quantile(
    share: float, weights: np.ndarray, mean: np.ndarray, below: np.ndarray, above: np.ndarray
) -> float:
    """Quantile of a mixture of normal distributions, each with a deviation to either side."""

    def excess(x: float) -> float:
        away = x - mean
        return float(weights @ ndtr(away / np.where(away < 0, below, above))) - share

    reach = 10 * (below + above)
    low, high = float((mean - reach).min()), float((mean + reach).max())
    return float(np.asarray(brentq(excess, low, high)))
