"""How well a fit predicts what it has not seen: whole presses, and the highest forces.

The fit without some rows follows from the one with all by one Gauss-Newton step, exact where the
model is linear in its unknowns around the estimate:

    e = r_o + G_o (G'G - G_o'G_o)^-1 G_o' r_o

with residual r_o and derivatives G_o of the rows left out. Where nothing is linear any more, as
where the only press on a small spot is left out, the step ends and the model itself predicts.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from fem.errors import SolverError
from identify.fit.result import FitResult
from identify.optimize.result import InadmissibleError

_FOLDS = 9
_LONGEST = 0.3  # of a logarithm of the map, or of an inclusion's radius
_HIGHEST = 2 / 3  # of the largest force: what lies above is the highest level


@dataclass(frozen=True)
class CrossValidation:
    """Root mean square of what was predicted wrongly, m and in units of the noise.

    `rms_m`, `ratio`: whole presses, each predicted from the others; `high_rms_m`, `high_ratio`:
    the highest forces from the lower ones (None where all forces are high).
    """

    rms_m: float
    ratio: float
    high_rms_m: float | None
    high_ratio: float | None


def cross_validate(fit: FitResult) -> CrossValidation:
    """Predict presses and high forces that are left out of a fit."""
    press = fit.model.readings.press
    fold = folds(fit.model.readings.presses)[press]
    error = np.empty(len(press))
    for number in np.unique(fold):
        out = fold == number
        error[out] = predicted_error(fit, out)
    rms, ratio = _rms(fit, error, np.ones(len(press), bool))
    force = fit.at.latent_force_n
    high = force > _HIGHEST * force.max()
    if high.all() or not high.any():
        return CrossValidation(rms, ratio, None, None)
    error[high] = predicted_error(fit, high)
    return CrossValidation(rms, ratio, *_rms(fit, error, high))


def folds(presses: int) -> np.ndarray:
    """Return the fold (j,) that each press is left out with, at random but always the same.

    Every ninth press of a grid would be one of its columns.
    """
    return np.random.default_rng(0).permutation(presses) % min(_FOLDS, presses)


def predicted_error(fit: FitResult, out: np.ndarray) -> np.ndarray:
    """Whitened error with which the rows `out` (m,) bool are predicted from the others."""
    g, r = fit.at.jacobian, fit.at.residual
    scale = np.linalg.norm(g, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    g = g / scale
    rest = g[~out].T @ g[~out]
    step = np.linalg.lstsq(rest, g[out].T @ r[out], rcond=1e-12)[0]
    longest = _longest_step(fit)
    share = float(np.min(longest * scale / np.maximum(np.abs(step), 1e-300), initial=1.0))
    if share < 1:
        with suppress(InadmissibleError, SolverError):
            there = np.clip(fit.u - share * step / scale, *fit.model.bounds)
            at = fit.model.linearise(there)
            return (at.residual * at.sigma_m / fit.at.sigma_m)[out]
    return r[out] + share * (g[out] @ step)


def _longest_step(fit: FitResult) -> np.ndarray:
    """Scaled steps (k,) within which a prediction is about linear."""
    longest, slope = fit.model.unknowns.longest_step(fit.u), fit.model.unknowns.slope(fit.u)
    for i, name in enumerate(fit.model.space.names):
        inclusion, _, own = name.partition(".")
        longest[i] = _LONGEST
        if own in ("x_m", "y_m", "z_m"):
            longest[i] *= fit.values[f"{inclusion}.radius_m"] / abs(slope[i])
    return longest


def _rms(fit: FitResult, error: np.ndarray, rows: np.ndarray) -> tuple[float, float]:
    own = error[rows]
    metres = own * fit.at.sigma_m[rows]
    return float(np.sqrt(np.mean(metres**2))), float(np.sqrt(np.mean(own**2)))
