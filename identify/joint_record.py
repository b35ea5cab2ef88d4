"""A joint fit as the record of a fit, with the effects among its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identify.fit_record import Estimate, Fit
from identify.joint_fit import JointFit

_NORMAL95 = 1.96


def fit_of(start: Fit, fit: JointFit) -> Fit:
    """Return a joint fit as the record of a fit: its parameters, residuals and compliances.

    Parameters
    ----------
    start : fit of the map alone, of which noise, readings and mesh errors are kept
    """
    slope = fit.model.slope(fit.u)
    body, mechanics = fit.at.body, fit.model.mechanics
    corrected = mechanics.fine is not None
    presses = np.ones(len(body.compliance))
    return replace(
        start,
        map=fit.map,
        parameters=estimates(fit),
        covariance_names=fit.model.names,
        covariance=fit.covariance * np.outer(slope, slope),
        latent_force_n=fit.at.latent_force_n,
        predicted_m=fit.at.predicted_m,
        sigma_m=fit.at.sigma_m,
        residual_m=fit.residual_m,
        compliance_m_per_n=body.compliance,
        compliance_jacobian=body.by_map[:, list(fit.model.space.free)],
        derivative_m=fit.at.jacobian * fit.at.sigma_m[:, None] / slope,
        discretization_error=presses / mechanics.ratio - 1 if corrected else None,
        model_error=presses * mechanics.model_error if corrected else None,
        history=(),
        chi2=fit.chi2,
        chi2_per_dof=fit.chi2_per_dof,
        rms_m=fit.rms_m,
        success=fit.success,
        nfev=fit.nfev,
    )


def estimates(fit: JointFit) -> dict[str, Estimate]:
    """Return all parameters with 95 % intervals, symmetric in the scale they are sought in."""
    model = fit.model
    deviation = np.sqrt(np.diag(fit.covariance))
    units = {
        f"{part.effect.name}.{p.name}": p.unit for part in model.effects for p in part.parameters
    }
    found = {}
    for name, value in fit.values.items():
        unit = units.get(name) or ("Pa" if name.endswith("_pa") else "m")
        if name not in model.names:
            found[name] = Estimate(value, 0.0, unit, value, value, False)
            continue
        at = model.names.index(name)
        ends = []
        for side in (-1, 1):
            u = fit.u.copy()
            u[at] += side * _NORMAL95 * deviation[at]
            ends.append(_value(fit, u, name))
        found[name] = Estimate(value, fit.std[name], unit, min(ends), max(ends), True)
    return found


def _value(fit: JointFit, u: np.ndarray, name: str) -> float:
    effect, _, own = name.rpartition(".")
    values = fit.model.values(u)
    if effect in values:
        return values[effect][own]
    stiffness = fit.model.map(u)
    return float(stiffness.values[stiffness.names.index(name)])
