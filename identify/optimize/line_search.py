"""A line search for the weak Wolfe conditions that survives inadmissible trials.

Bracketing after Lewis and Overton, "Nonsmooth optimization via quasi-Newton methods", Math.
Program. 141 (2013), algorithm 2.6, with interpolation in place of bisection.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

ARMIJO = 1e-4
CURVATURE = 0.9
_TRIALS = 30


@dataclass(frozen=True)
class Trial:
    """A point along the line: its step, value, gradient (k,) and slope along the direction."""

    step: float
    point: np.ndarray
    fun: float
    gradient: np.ndarray
    slope: float


def wolfe_step(
    evaluate: Callable[[float], Trial | None], start: Trial, first: float, longest: float
) -> Trial | None:
    """Find a step with sufficient decrease and, unless it is the longest, less slope.

    `evaluate` returns None at an inadmissible step, which shortens it. Returns None when no step
    decreases the function.
    """
    low, high, best = start, np.inf, None
    step = min(first, longest)
    for _ in range(_TRIALS):
        trial = evaluate(step)
        if trial is None:
            high, step = step, low.step + 0.25 * (step - low.step)
        elif trial.fun > start.fun + ARMIJO * step * start.slope:
            high, step = step, _quadratic_minimum(low, trial)
        elif trial.slope < CURVATURE * start.slope and step < longest:
            best, previous, low = trial, low, trial
            step = _secant_step(previous, trial) if np.isinf(high) else 0.5 * (low.step + high)
            step = min(step, longest)
        else:
            return trial
        if np.isfinite(high) and high - low.step <= 1e-14 * high:
            break
    return best


def _quadratic_minimum(low: Trial, high: Trial) -> float:
    """Minimum of the parabola through both values and the first slope, kept off both ends."""
    width = high.step - low.step
    curvature = high.fun - low.fun - low.slope * width
    fraction = -0.5 * low.slope * width / curvature if curvature > 0 else 0.5
    return low.step + width * float(np.clip(fraction, 0.1, 0.9))


def _secant_step(previous: Trial, current: Trial) -> float:
    """Where the slope would vanish, one to four times the last advance further on."""
    advance = current.step - previous.step
    change = current.slope - previous.slope
    ratio = -current.slope / change if change > 0 else np.inf
    return current.step + advance * float(np.clip(ratio, 1.0, 4.0))
