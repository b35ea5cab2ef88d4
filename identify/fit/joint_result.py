"""A joint fit as the record of a fit, with the effects among its parameters."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identify.fit.joint_fit import JointFit
from identify.fit.joint_intervals import joint_intervals
from identify.fit.result import Estimate, Fit


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
        covariance=fit.total_covariance * np.outer(slope, slope),
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


def estimates(fit: JointFit, bent: bool = True) -> dict[str, Estimate]:
    """Return all parameters with 95 % intervals; see `joint_intervals`."""
    model = fit.model
    units = {
        f"{part.effect.name}.{p.name}": p.unit for part in model.effects for p in part.parameters
    }
    intervals = joint_intervals(fit, bent)
    found = {}
    for name, value in fit.values.items():
        unit = units.get(name) or ("Pa" if name.endswith("_pa") else "m")
        free = name in intervals
        low, high = intervals.get(name, (value, value))
        found[name] = Estimate(value, fit.std[name] if free else 0.0, unit, low, high, free)
    return found
