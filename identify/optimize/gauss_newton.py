"""Least squares by Gauss-Newton with Levenberg-Marquardt damping, within bounds.

Source: Nocedal and Wright, "Numerical Optimization", ch. 10; damping after Nielsen (1999), scaled
by the largest diagonal of J'J seen (More 1978); bounds by active set.
"""

from collections.abc import Callable

import numpy as np

from fem import SolverError
from identify.optimize.result import InadmissibleError, OptimizeResult, free_directions

_IDLE_STEPS = 2
_FELT = 1e-6  # less damping than this hardly changes a step
_HOPELESS = 1e16  # with more, a step is no step
_NO_STEP = "no step lowers chi-square"
_GIVEN_UP = "given up: the next step promises too little of what is missing"

Residuals = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]


def minimize_gauss_newton(
    residuals: Residuals,
    x0: np.ndarray,
    *,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
    max_step: float | np.ndarray = 1.0,
    ftol: float = 1e-6,
    rtol: float = 0.0,
    above: float = 0.0,
    reach: float = 0.0,
    enough: float = 0.0,
    resolved: float = 5e-3,
    max_evaluations: int = 100,
    callback: Callable[[np.ndarray, float], None] | None = None,
) -> OptimizeResult:
    """Minimise |r(x)|^2 / 2 for a function that returns r (m,) and its Jacobian (m, k).

    Parameters
    ----------
    residuals
        x (k,) -> (r (m,), dr/dx (m, k)). It may raise `InadmissibleError` or `SolverError` or
        return numbers that are not finite: the step is then shortened. Not so at `x0`.
    x0
        Start (k,); it is moved into the bounds.
    bounds
        Lower and upper (k,).
    max_step
        Largest change of a coordinate in one step, one number or (k,).
    ftol
        Converged when an undamped step would lower |r|^2 / 2 by no more. With whitened residuals,
        an ftol of 1e-6 leaves every parameter within about a thousandth of its standard deviation.
    rtol, above
        Converged, too, when an undamped step would lower |r|^2 / 2 by no more than the part rtol of
        what exceeds `above`, or when two steps in a row did: a valley that is rough or curved can
        promise more for ever.
    reach
        Given up, when an undamped step would lower |r|^2 / 2 by less than this part of what exceeds
        `above`: twice as good a step as promised would not do.
    enough
        Converged, too, when two steps in a row lowered |r|^2 / 2 by no more than this.
    resolved
        Decrease of |r|^2 / 2 that evaluations resolve: where no step lowers it, a promise of no
        more is one of their rounding. That of reduced bases moves no parameter by more than a tenth
        of a standard deviation.
    max_evaluations
        Limit of evaluations.
    callback
        Called with x and |r|^2 / 2 at the start and after each accepted step.
    """
    lower, upper = bounds or (np.full(len(x0), -np.inf), np.full(len(x0), np.inf))
    x = np.clip(np.array(x0, dtype=float), lower, upper)
    r, jac = _at_start(residuals, x)
    fun, nfev, nit = 0.5 * float(r @ r), 1, 0
    damping, idle = _Damping(), 0
    diagonal = np.zeros_like(x)
    if callback:
        callback(x, fun)

    def result(status: int, message: str) -> OptimizeResult:
        return OptimizeResult(x, fun, jac.T @ r, nit, nfev, status == 0, status, message)

    while True:
        gradient, normal = jac.T @ r, jac.T @ jac
        diagonal = np.maximum(diagonal, np.diag(normal))
        free = free_directions(x, gradient, lower, upper)
        step = _solve(normal, gradient, diagonal, 0.0, free)
        expected, excess = -0.5 * float(gradient @ step), max(fun - above, 0.0)
        slack = rtol * excess
        if ended := _end(expected, max(ftol, slack), idle, max(slack, enough)):
            return result(0, ended)
        if expected < reach * excess:
            return result(0, _GIVEN_UP)
        if nfev >= max_evaluations:
            return result(1, f"limit of {max_evaluations} evaluations reached")
        step = _shortened(_solve(normal, gradient, diagonal, damping.value, free), max_step)
        trial_x = np.clip(x + step, lower, upper)
        step = trial_x - x
        trial = _try(residuals, trial_x)
        nfev += 1
        predicted = -float(gradient @ step) - 0.5 * float(step @ normal @ step)
        trial_fun = np.inf if trial is None else 0.5 * float(trial[0] @ trial[0])
        if trial is not None and trial_fun < fun:
            damping.lower((fun - trial_fun) / predicted if predicted > 0 else 0.0)
            idle = idle + 1 if fun - trial_fun <= max(slack, enough) else 0
            x, fun, (r, jac), nit = trial_x, trial_fun, trial, nit + 1
            if callback:
                callback(x, fun)
        else:
            damping.raise_()
            if damping.value > _HOPELESS:
                lost = expected > resolved
                return result(2 * lost, _NO_STEP if lost else _would_lower(expected))


class _Damping:
    """Damping of the steps: less the better the last one was predicted, more after each failure."""

    def __init__(self) -> None:
        self.value = 1e-3
        self._growth = 2.0

    def lower(self, gain: float) -> None:
        """After a step that lowered the value by `gain` times what was predicted."""
        self.value = max(self.value * max(0.1, 1 - (2 * min(gain, 1.0) - 1) ** 3), 1e-12)
        self._growth = 2.0

    def raise_(self) -> None:
        """After a step that failed."""
        self.value = max(self.value, _FELT) * self._growth
        self._growth *= 2


def _shortened(step: np.ndarray, longest: float | np.ndarray) -> np.ndarray:
    """Return a step (k,) in its direction, of which no coordinate is longer than allowed."""
    return step * min(1.0, float(np.min(longest / np.maximum(np.abs(step), 1e-300))))


def _at_start(residuals: Residuals, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Residuals and Jacobian at the start, which must be admissible."""
    r, jac = residuals(x)
    if not (np.all(np.isfinite(r)) and np.all(np.isfinite(jac))):
        raise InadmissibleError(f"the start {x} gives residuals that are not finite")
    return r, jac


def _would_lower(less_than: float) -> str:
    """Return the end of a search whose next step would lower |r|^2 / 2 by less."""
    left = float(f"{2 * less_than:.0e}")
    return f"converged: a further step would lower chi-square by less than {left:g}"


def _end(expected: float, within: float, idle: int, lowered: float) -> str:
    """Return the reason for convergence, or nothing.

    Parameters
    ----------
    expected, within : decrease of |r|^2 / 2 by an undamped step, and one that no longer counts
    idle, lowered : steps in a row that lowered it by no more than `lowered`
    """
    if expected <= within:
        return _would_lower(within)
    if idle < _IDLE_STEPS:
        return ""
    return f"converged: the last {idle} steps lowered half of chi-square by {lowered:.1e} at most"


def covariance(jac: np.ndarray) -> np.ndarray:
    """Covariance (k, k) of the estimate from whitened residuals' Jacobian (m, k): (J'J)^-1.

    Directions that the data do not determine (singular to 1e-12) get infinite variance.
    """
    scale = np.linalg.norm(jac, axis=0)
    if np.any(scale == 0):
        scale = np.where(scale > 0, scale, 1.0)
    _, singular, right = np.linalg.svd(jac / scale, full_matrices=False)
    with np.errstate(divide="ignore", invalid="ignore"):
        weight = np.where(singular > 1e-12 * singular.max(initial=0.0), singular**-2.0, np.inf)
        inverse = (right.T * np.minimum(weight, 1e24)) @ right
    return inverse / np.outer(scale, scale)


def _solve(
    normal: np.ndarray, gradient: np.ndarray, diagonal: np.ndarray, damping: float, free: np.ndarray
) -> np.ndarray:
    """Damped Gauss-Newton step in the free coordinates."""
    step = np.zeros_like(gradient)
    if not free.any():
        return step
    scale = np.sqrt(np.where(diagonal[free] > 0, diagonal[free], 1.0))
    scaled = normal[np.ix_(free, free)] / np.outer(scale, scale)
    scaled[np.diag_indices_from(scaled)] += damping
    step[free] = -np.linalg.lstsq(scaled, gradient[free] / scale, rcond=1e-14)[0] / scale
    return step


def _try(residuals: Residuals, x: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """Residuals and Jacobian, or None at an inadmissible point."""
    try:
        r, jac = residuals(x)
    except (InadmissibleError, SolverError):
        return None
    return (r, jac) if np.all(np.isfinite(r)) and np.all(np.isfinite(jac)) else None
