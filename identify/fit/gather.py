"""The record of a fit, gathered where its search ended."""

import numpy as np

from identify.body.discretization_error import MODEL_ERROR, shift_covariance
from identify.fit.free_map.field import Field
from identify.fit.result import FitResult, Solution
from identify.fit.search import FitIteration
from identify.fit.settings import FitSettings
from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel
from identify.optimize.gauss_newton import covariance


def fit_result(
    model: MeasurementModel,
    u: np.ndarray,
    at: Linearised,
    settings: FitSettings,
    *,
    success: bool,
    message: str,
    nfev: int,
    history: tuple[FitIteration, ...],
    field: Field | None = None,
) -> FitResult:
    """Gather the record of a fit that ended at scaled coordinates u (k,)."""
    started = model.started(u)
    noise_alone = total = covariance(at.jacobian)
    if model.map_uncertainty is None:  # else the map's own error holds that of the meshes
        total = noise_alone + _covariance_of_meshes(model, at, noise_alone)
    slope, body, mechanics = model.unknowns.slope(u), at.body, model.mechanics
    presses = np.ones(len(body.compliance))
    counted, uncertain = len(at.residual), model.map_uncertainty
    if uncertain is not None:
        counted = uncertain.counted(model.readings.press)
    dof = max(counted - len(u), 1)
    at_bound = started.unknowns.at_bound(u)
    return FitResult(
        map=model.map(u),
        covariance_names=model.names,
        covariance=total * np.outer(slope, slope),
        noise=model.noise,
        press_index=model.readings.press,
        force_n=model.readings.force_n,
        displacement_m=model.displacement_m,
        latent_force_n=at.latent_force_n,
        predicted_m=at.predicted_m,
        sigma_m=at.sigma_m,
        residual_m=model.displacement_m - at.predicted_m,
        compliance_m_per_n=body.compliance,
        compliance_jacobian=body.by_map[:, list(model.space.free)],
        discretization_error=None
        if mechanics.fine is None
        else presses / mechanics.correction.ratio - 1,
        history=history,
        chi2=at.chi2,
        chi2_per_dof=at.chi2 / dof,
        rms_m=at.rms_m,
        success=success,
        message=_message(message, at_bound, at.chi2 / dof, dof),
        nfev=nfev,
        model_error=None if mechanics.fine is None else presses * mechanics.correction.model_error,
        derivative_m=None if model.is_linear else at.jacobian * at.sigma_m[:, None] / slope,
        solution=Solution(started, u, at, noise_alone, total, settings),
        field=field,
        at_bound=at_bound,
    )


def _covariance_of_meshes(
    model: MeasurementModel, at: Linearised, noise_alone: np.ndarray
) -> np.ndarray:
    """Covariance (k, k) that the finer model's own error adds to that from the noise."""
    if MODEL_ERROR in model.effect_names:
        return np.zeros_like(noise_alone)  # it is among the unknowns
    press, c = model.readings.press, at.body.compliance
    off = c * model.mechanics.correction.model_error
    shift = at.whitened(at.by_compliance * off[press], press)
    pull = np.zeros((len(c), len(noise_alone)))
    np.add.at(pull, press, at.jacobian * shift[:, None])
    return shift_covariance(noise_alone, pull)


def _message(ended: str, at_bound: tuple[str, ...], chi2_per_dof: float, dof: int) -> str:
    """Return the end of the fit in words, with the trust in its intervals."""
    parts = [ended]
    if at_bound:
        parts.append(f"at its bound, so not found: {', '.join(at_bound)}")
    scatter = np.sqrt(2 / dof)
    if abs(chi2_per_dof - 1) > max(5 * scatter, 0.1):
        size, wide = ("larger", "narrow") if chi2_per_dof > 1 else ("smaller", "wide")
        parts.append(
            f"the residual is {size} than the noise: the noise or the model is wrong, and the "
            f"intervals, which trust both, are too {wide}"
        )
    return "; ".join(parts)
