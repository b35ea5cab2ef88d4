"""Cross-validation of a fit: prediction of whole presses, and of the highest forces.

The fit without some rows follows from the one with all by one Gauss-Newton step, exact where the
model is linear in its unknowns around the estimate:

    e = r_o + G_o (G'G - G_o'G_o)^-1 G_o' r_o

with residual r_o and derivatives G_o of the rows left out. Beyond the linear range, as without the
only press on a small spot, the other rows are fitted anew.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from fem import SolverError
from identify.fit.free_map.field import Field
from identify.fit.result import FitResult
from identify.fit.settings import CROSS_VALIDATION, CrossValidationSettings
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.result import InadmissibleError


@dataclass(frozen=True)
class CrossValidation:
    """Root mean square error of prediction, m and in units of the noise.

    `rms_m`, `ratio`: whole presses, each predicted from the others; `high_rms_m`: the highest
    forces from the lower ones (None where all forces are high).
    """

    rms_m: float
    ratio: float
    high_rms_m: float | None


def cross_validate(
    fit: FitResult, settings: CrossValidationSettings = CROSS_VALIDATION
) -> CrossValidation:
    """Predict presses and high forces that are left out of a fit."""
    if fit.field is not None:
        return _of_free_map(fit, fit.field)
    press = fit.model.readings.press
    fold = folds(fit.model.readings.presses, settings.folds)[press]
    error = np.empty(len(press))
    for number in np.unique(fold):
        out = fold == number
        error[out] = predicted_error(fit, out, settings)
    rms, ratio = _rms(fit, error, np.ones(len(press), bool))
    force = fit.at.latent_force_n
    high = force > settings.high_force * force.max()
    if high.all() or not high.any():
        return CrossValidation(rms, ratio, None)
    error[high] = predicted_error(fit, high, settings)
    return CrossValidation(rms, ratio, _rms(fit, error, high)[0])


def _of_free_map(fit: FitResult, field: Field) -> CrossValidation:
    """Predict each press by the map of the other four fifths, see `Field`; no high forces alone."""
    whole = left_out_residual_m(fit, field) / fit.at.sigma_m
    return CrossValidation(*_rms(fit, whole, np.ones(len(whole), bool)), None)


def left_out_residual_m(fit: FitResult, field: Field) -> np.ndarray:
    """Return the residual (m,) m of each press by a free map that has not seen its fifth."""
    moved = (field.press_error - field.left_out)[fit.press_index]  # of ln C, from the whole map's
    return fit.residual_m - field.by_press_m * moved


def folds(presses: int, count: int = CROSS_VALIDATION.folds) -> np.ndarray:
    """Return the fold (j,) of each press, at random but always the same.

    Every ninth press of a grid would be one of its columns.
    """
    return np.random.default_rng(0).permutation(presses) % min(count, presses)


def predicted_error(
    fit: FitResult, out: np.ndarray, settings: CrossValidationSettings = CROSS_VALIDATION
) -> np.ndarray:
    """Whitened error of the prediction of the rows `out` (m,) bool from the others."""
    # A parameter at a bound does not follow: the other rows hold it there, too
    free = np.array([name not in fit.at_bound for name in fit.covariance_names], bool)
    g, r = fit.at.jacobian[:, free], fit.at.residual
    scale = np.linalg.norm(g, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    g = g / scale
    rest = g[~out].T @ g[~out]
    step = np.linalg.lstsq(rest, g[out].T @ r[out], rcond=1e-12)[0]
    longest = _longest_step(fit, settings.longest_step)
    share = float(np.min(longest[free] * scale / np.maximum(np.abs(step), 1e-300), initial=1.0))
    if share < 1:
        with suppress(InadmissibleError, SolverError):
            return _refitted_error(fit, out, longest, settings)
    return r[out] + share * (g[out] @ step)


def _refitted_error(
    fit: FitResult, out: np.ndarray, longest: np.ndarray, settings: CrossValidationSettings
) -> np.ndarray:
    """Whitened error of the rows `out` (m,) bool by a fit of the others, in steps (k,) at most."""

    def others(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        at = fit.model.linearise(u, settings.slack)
        return at.residual[~out], -at.jacobian[~out]

    found = minimize_gauss_newton(
        others,
        fit.u,
        bounds=fit.model.bounds,
        max_step=longest,
        ftol=settings.ftol,
        max_evaluations=settings.evaluations,
    )
    at = fit.model.linearise(found.x, settings.slack)
    return (at.residual * at.sigma_m / fit.at.sigma_m)[out]


def _longest_step(fit: FitResult, of_map: float) -> np.ndarray:
    """Scaled steps (k,) within which a prediction is about linear."""
    longest, slope = fit.model.unknowns.longest_step(fit.u), fit.model.unknowns.slope(fit.u)
    for i, name in enumerate(fit.model.space.names):
        inclusion, _, parameter = name.partition(".")
        longest[i] = of_map
        if parameter in ("x_m", "y_m", "z_m"):
            longest[i] *= fit.values[f"{inclusion}.radius_m"] / abs(slope[i])
    return longest


def _rms(fit: FitResult, error: np.ndarray, rows: np.ndarray) -> tuple[float, float]:
    ratio = error[rows]
    metres = ratio * fit.at.sigma_m[rows]
    return float(np.sqrt(np.mean(metres**2))), float(np.sqrt(np.mean(ratio**2)))
