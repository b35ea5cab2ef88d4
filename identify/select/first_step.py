"""From the law that the presses show by themselves to the second step of the ladder."""

from __future__ import annotations

from collections.abc import Callable

from identify.fit.contact_law import ContactLaw
from identify.fit.free_compliance import FreeComplianceFit
from identify.fit.joint_fit import fit_jointly, try_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.step import Step

_EVALUATIONS, _RIVAL_EVALUATIONS = 40, 15


def follow(
    law: ContactLaw, step: Step, start: GaussianMap, say: Callable[[str], None]
) -> tuple[FitResult, list[AcceptedEffect]] | None:
    """Fit the map beside the effects of a law; None where that explains the scan no better.

    The candidates of each effect are those of the law, with the criterion of the law.

    Parameters
    ----------
    step : the one without the effects
    start : map to start from, beside the step's own
    """
    if not law.names:
        return None
    say(f"fitting the map with {', '.join(law.names)}")
    # A map that was fitted without the effects, or to straightened readings: either may be a trap
    fits = [joint_fit(law.found, step, stiffness) for stiffness in (start, step.fit.map)]
    fit = min((fit for fit in fits if fit is not None), key=lambda fit: fit.bic, default=None)
    if fit is None or fit.bic >= step.fit.bic:
        return None
    fit = fit_jointly(fit.model, fit.map)
    additions = []
    for name in law.names:
        candidates = [Candidate(name, law.found.chi2, law.criterion(law.found), fit)]
        for other, own in law.candidates(name):
            say(f"trying {other}")
            beside = joint_fit(own, step, fit.map, _RIVAL_EVALUATIONS)
            if beside is not None:
                # As good as the effect found, as far as the laws can be trusted
                candidates.append(Candidate(other, own.chi2, candidates[0].criterion, beside))
        additions.append(AcceptedEffect(name, tuple(candidates), shown_by_presses=True))
    return fit, additions


def joint_fit(
    found: FreeComplianceFit, step: Step, start: GaussianMap, evaluations: int = _EVALUATIONS
) -> FitResult | None:
    """Fit the map and the effects of a law, from the law's values."""
    model = step.fit.model
    for part in found.parts:
        if part.effect.name not in model.effect_names:
            values = found.values[part.effect.name]
            model = model.with_effect(part.effect, values, step.fit.at.state)
    return try_fit(model, start, rounds=0, max_evaluations=evaluations)
