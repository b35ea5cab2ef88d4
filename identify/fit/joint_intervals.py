"""95 % intervals of a joint fit of map and effects, along the bend of the misfit's valley.

As those of a map alone (`identify.fit.profile_intervals`): each inclusion's depth is held beside
its estimate and everything else, the effects too, is fitted again.
"""

from __future__ import annotations

from weakref import WeakKeyDictionary

import numpy as np

from identify.fit.joint_fit import JointFit, corrected_at
from identify.fit.profile_intervals import Valley, bent_intervals, straight
from identify.measurement.model import MeasurementModel
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.result import InadmissibleError, OptimizeResult

_GROSS = 5.0  # chi-square per degree of freedom from which on the noise says nothing of the valley
_EVALUATIONS = 10  # of each refit
_FTOL = 1e-2  # half of chi-square
_found: WeakKeyDictionary[JointFit, dict[str, tuple[float, float]]] = WeakKeyDictionary()


def joint_intervals(fit: JointFit, bent: bool = True) -> dict[str, tuple[float, float]]:
    """Return the ends of the interval of each unknown by name, in its unit.

    Parameters
    ----------
    bent : follow the bend of the valley, at some ten evaluations of the body an inclusion; else
        the covariance's own intervals. A gross misfit has no valley worth following, nor has a
        map whose own error outweighs the noise.
    """
    if not bent or fit.chi2_per_dof >= _GROSS**2 or fit.model.press_error:
        return _in_units(fit, straight(fit.u, fit.total_covariance))
    if fit not in _found:  # record, report and recording all ask for them
        known = (fit.u, fit.chi2 / 2, fit.total_covariance, fit.covariance, fit.model.bounds)
        ends = bent_intervals(Valley(*known, _refitter(fit)), fit.model.names)
        _found[fit] = _in_units(fit, ends)
    return _found[fit]


def _in_units(fit: JointFit, ends: np.ndarray) -> dict[str, tuple[float, float]]:
    low, high = fit.model.bounds
    ends = np.clip(ends, low[:, None], high[:, None])
    return {name: _ends(fit, position, ends) for position, name in enumerate(fit.model.names)}


def _refitter(fit: JointFit):
    model = fit.model

    def refit(position: int, start: np.ndarray) -> tuple[float, np.ndarray]:
        others = np.delete(np.arange(len(start)), position)
        low, high = model.bounds

        def whole(x: np.ndarray) -> np.ndarray:
            u = start.copy()
            u[others] = x
            return u

        def minimum(model: MeasurementModel, x: np.ndarray) -> OptimizeResult:
            def residuals(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
                at = model.linearise(whole(x))
                return at.residual, -at.jacobian[:, others]

            return minimize_gauss_newton(
                residuals,
                x,
                bounds=(low[others], high[others]),
                max_step=model.longest_step(start)[others],
                ftol=_FTOL,
                max_evaluations=_EVALUATIONS,
            )

        try:
            found = minimum(model, start[others])
            # So far from the estimate the finer model corrects the map otherwise
            found = minimum(corrected_at(model, whole(found.x)), found.x)
            there = whole(found.x)
            return 0.5 * corrected_at(model, there).linearise(there).chi2, there
        except InadmissibleError:
            return np.inf, start  # no way on this side

    return refit


def _ends(fit: JointFit, position: int, ends: np.ndarray) -> tuple[float, float]:
    name = fit.model.names[position]
    found = []
    for end in ends[position]:
        u = fit.u.copy()
        u[position] = end
        found.append(_value(fit, u, name))
    return min(found), max(found)


def _value(fit: JointFit, u: np.ndarray, name: str) -> float:
    effect, _, own = name.rpartition(".")
    values = fit.model.values(u)
    if effect in values:
        return values[effect][own]
    stiffness = fit.model.map(u)
    return float(stiffness.values[stiffness.names.index(name)])
