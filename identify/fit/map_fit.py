"""Fit a stiffness map to a scan: displacement given force, with noise in both columns.

The model of a row is d = C_j(theta) F with the compliance C_j of the row's press, whatever its
phase; `misfit` says how both noises enter. Where no start is given, several are tried and the
least chi-square wins.

With a finer model, its compliance replaces the coarse one by defect correction: the coarse model
times the ratio of both at the last estimate is fitted again until the estimate no longer moves.
The residual is then the fine model's, the Jacobian the coarse one's, at one fine solve a round.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from fem import PalpationModel
from identify.body.discretization_error import FineModel, shift_covariance
from identify.body.forward import Forward, compliance
from identify.fit.map_problem import Correction, Minimum, ScanProblem
from identify.fit.profile_intervals import intervals
from identify.fit.result import Estimate, Fit, FitIteration
from identify.map.gaussian_map import GaussianMap
from identify.map.initial_guess import REFERENCE_PA, apparent_modulus, start_maps
from identify.map.parameters import ParameterSpace, parameter_space
from identify.measurement.errors_in_variables import press_table, whitening
from identify.measurement.noise import Noise, scan_noise
from identify.optimize.gauss_newton import covariance, minimize_gauss_newton
from identify.optimize.optimizers import Optimizer
from models.errors import InputError
from models.scan import Scan

__all__ = ["Estimate", "Fit", "FitIteration", "fit_scan"]

# No interval reaches further than this in scaled coordinates: exp stays finite.
_WIDEST = 50.0


def fit_scan(
    scan: Scan,
    model: PalpationModel,
    *,
    inclusions: int = 1,
    noise: Noise | None = None,
    fine_model: FineModel | None = None,
    search_model: PalpationModel | None = None,
    start: GaussianMap | None = None,
    free: Sequence[str] | None = None,
    optimizer: Optimizer = minimize_gauss_newton,
    callback: Callable[[FitIteration], None] | None = None,
    curved_intervals: bool = True,
) -> Fit:
    """Find the map that explains a scan.

    Parameters
    ----------
    scan
        The measured table; rows of approach and retract are left out.
    model
        Finite element model whose contacts are the scan's presses, in the order of
        `scan.press_ids`.
    inclusions
        Number of Gaussian inclusions; ignored where `start` is given.
    noise
        Standard deviations of both columns; None estimates them from the scan's ramps.
    fine_model
        The same presses on a finer mesh, or extrapolated from two, for the defect correction.
        Without it the intervals hold the noise only, not the mesh's error.
    search_model
        The same presses on a quicker and rougher model (without the near field of the presses,
        say), with which starts are tried; corrected to `model` for the homogeneous body.
    start
        The one map to start from, in place of those that the scan suggests.
    free
        Names of the parameters to be found, None for all; the others stay at `start`.
    optimizer
        One of `identify.optimize.optimizers.OPTIMIZERS`.
    callback
        Called with each accepted iteration of the start that is kept.
    curved_intervals
        Intervals follow the bend of the misfit's valley, at the cost of a few refits.

    Raises
    ------
    InputError
        Where scan, model and options do not fit together.
    """
    rows = scan.used()
    presses = len(rows.press_ids)
    for name, given in (
        ("model", model),
        ("fine_model", fine_model),
        ("search_model", search_model),
    ):
        if given is not None and len(given.contacts) != presses:
            raise InputError(
                f"the {name} has {len(given.contacts)} contacts, the scan {presses} presses: "
                "build the model from the scan's contact points"
            )
    if free is not None and start is None:
        raise InputError("fixed parameters need values: give the map to start from")
    noise = noise or scan_noise(rows)
    table = press_table(rows.press_index, rows.displacement_m, rows.force_n, presses)
    problem = ScanProblem(table, noise, optimizer, callback)
    box = np.array([model.mesh.nodes.min(axis=0), model.mesh.nodes.max(axis=0)])
    if start is not None:
        forward = Forward(model, parameter_space(start, box, free))
        minimum = problem.minimize(forward, forward.space.to_scaled(start), progress=callback)
    else:
        reference = GaussianMap(REFERENCE_PA)
        homogeneous, ratio = compliance(model, reference), 1.0
        if search_model is not None:
            ratio = homogeneous / compliance(search_model, reference)
        apparent = apparent_modulus(
            table.slope, rows.contact_points, rows.contact_directions, homogeneous
        )
        maps = start_maps(apparent, box, inclusions)
        minimum = problem.from_best(search_model or model, maps, box, ratio)
        if search_model is not None:
            minimum = problem.continued(minimum, Forward(model, minimum.forward.space))
    correction = None if fine_model is None else problem.towards(fine_model, minimum)
    if correction is not None:
        minimum = correction.minimum
    return _record(rows, problem, minimum, correction, curved_intervals)


def _record(
    rows: Scan,
    problem: ScanProblem,
    minimum: Minimum,
    correction: Correction | None,
    curved: bool,
) -> Fit:
    """Evaluate the minimum row by row and gather the record."""
    u, space = minimum.result.x, minimum.forward.space
    found, gradient = minimum.forward.evaluate(u)
    jac = problem.whitened(found, gradient)
    noise_alone = covariance(jac)
    scaled_covariance = noise_alone
    if correction is not None:
        _, by_compliance = problem.table.residuals(found, problem.noise)
        shift = by_compliance * (found * correction.own_error)[:, None]
        pull = np.einsum("jrk,jr->jk", jac.reshape(*shift.shape, -1), shift)
        scaled_covariance = scaled_covariance + shift_covariance(scaled_covariance, pull)
    ends, spent = intervals(problem, minimum, scaled_covariance, noise_alone, curved)
    slope = space.slope(u)
    c = found[rows.press_index]
    residual, sigma, latent = whitening(rows.displacement_m, rows.force_n, c, problem.noise)
    chi2 = float(np.sum((residual / sigma) ** 2))
    dof = problem.table.dof(len(u))
    settled = correction is None or correction.settled
    return Fit(
        map=minimum.map,
        parameters=_estimates(space, u, scaled_covariance, ends),
        covariance_names=space.free_names,
        covariance=scaled_covariance * np.outer(slope, slope),
        noise=problem.noise,
        press_index=rows.press_index,
        force_n=rows.force_n,
        displacement_m=rows.displacement_m,
        latent_force_n=latent,
        predicted_m=c * rows.force_n,
        sigma_m=sigma,
        residual_m=residual,
        compliance_m_per_n=found,
        compliance_jacobian=gradient / slope,
        discretization_error=None if correction is None else correction.coarse_error,
        history=minimum.history,
        chi2=chi2,
        chi2_per_dof=chi2 / dof,
        rms_m=float(np.sqrt(np.mean(residual**2))),
        success=minimum.result.success and settled,
        message=_message(minimum, chi2 / dof, dof, settled),
        nfev=minimum.nfev + 1 + spent,
        model_error=None if correction is None else correction.own_error,
    )


def _estimates(
    space: ParameterSpace, u: np.ndarray, scaled_covariance: np.ndarray, ends: np.ndarray
) -> dict[str, Estimate]:
    """Value, deviation and interval of every parameter of the map, free or fixed."""
    values = space.to_map(u).values
    deviation = np.sqrt(np.diag(scaled_covariance))
    slope = space.slope(u)
    estimates = {}
    for i, parameter in enumerate(space.parameters):
        value = float(values[i])
        if i not in space.free:
            estimates[parameter.name] = Estimate(value, 0.0, parameter.unit, value, value, False)
            continue
        position = space.free.index(i)
        low, high = np.clip(ends[position] - u[position], -_WIDEST, _WIDEST) + u[position]
        between = [parameter.to_value(float(end)) for end in (low, high)]
        std = float(deviation[position] * slope[position])
        estimates[parameter.name] = Estimate(value, std, parameter.unit, *between, free=True)
    return estimates


def _message(minimum: Minimum, chi2_per_dof: float, dof: int, settled: bool) -> str:
    """Say how the fit ended and what its reader must know of the intervals."""
    parts = [minimum.result.message]
    if not settled:
        parts.append("the correction towards the finer model did not settle")
    held = minimum.forward.space.at_bound(minimum.result.x)
    if held:
        parts.append(f"at its bound, so not found: {', '.join(held)}")
    scatter = np.sqrt(2 / dof)
    if abs(chi2_per_dof - 1) > max(5 * scatter, 0.1):
        wide = "too narrow" if chi2_per_dof > 1 else "too wide"
        parts.append(
            f"chi-square per degree of freedom is {chi2_per_dof:.3g}, not 1 +- {scatter:.2g}: the "
            f"noise or the model is wrong, and the intervals, which trust both, are {wide}"
        )
    return "; ".join(parts)
