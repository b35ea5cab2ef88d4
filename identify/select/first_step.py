"""First step of the selection, from the contact law of the presses."""

from collections.abc import Callable

from identify.fit.contact_law import ContactLaw
from identify.fit.free_compliance import FreeComplianceFit
from identify.fit.joint_fit import fit_jointly, try_fit
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.settings import SELECTION, SelectionSettings
from identify.select.step import Step


def follow(
    law: ContactLaw,
    step: Step,
    start: GaussianMap,
    say: Callable[[str], None],
    settings: SelectionSettings = SELECTION,
) -> tuple[FitResult, list[AcceptedEffect]] | None:
    """Fit the map beside the effects of a law; None if that explains the scan no better.

    Candidates of each effect and their criterion are those of the law, free of the map.

    Parameters
    ----------
    step : without the effects
    start : map to start from, beside that of the step
    """
    if not law.names:
        return None
    say(f"fitting the map with {', '.join(law.names)}")
    # A map that was fitted without the effects, or to straightened readings: either may be a trap
    most = settings.first_evaluations
    fits = [_joint_fit(law.found, step, stiffness, most) for stiffness in (start, step.fit.map)]
    fit = min((fit for fit in fits if fit is not None), key=lambda fit: fit.bic, default=None)
    if fit is None or fit.bic >= step.fit.bic:
        return None
    fit = fit_jointly(fit.model, fit.map)
    accepted = []
    for name in law.names:
        candidates = [Candidate(name, law.found.chi2, law.criterion(law.found), fit)]
        for other, alone in law.candidates(name):
            say(f"trying {other}")
            beside = _joint_fit(alone, step, fit.map, settings.refit_evaluations)
            if beside is not None:
                # As good as the effect found, as far as the laws can be trusted
                candidates.append(Candidate(other, alone.chi2, candidates[0].criterion, beside))
        accepted.append(
            AcceptedEffect(name, tuple(candidates), shown_by_presses=True, settings=settings)
        )
    return fit, accepted


def _joint_fit(
    law: FreeComplianceFit, step: Step, start: GaussianMap, evaluations: int
) -> FitResult | None:
    """Fit the map and the effects of a law, from the law's values."""
    model = step.fit.model
    for part in law.parts:
        if part.effect.name not in model.effect_names:
            values = law.values[part.effect.name]
            model = model.with_effect(part.effect, values, step.fit.at.state)
    return try_fit(model, start, rounds=0, max_evaluations=evaluations)
