"""Bias of the residual by the curvature of a fitted model.

A fit follows the noise over a curved surface of predictions, so that the mean of its residual is
not zero: with the covariance V of the estimate and the second derivatives H of the whitened
residual r,

    E r = 1/2 (I - P) sum_ab H_ab V_ab,

P the projection on the fitted parameters. It is small (hundredths of a standard error of an
effect's size), yet the same in every scan, and lies along the effects that act like a change of
stiffness: without it their p-values are not quite uniform. Source: R. D. Cook, C.-L. Tsai, B. C.
Wei, Bias in nonlinear regression, Biometrika 73 (1986) 615.
"""

from collections.abc import Callable

import numpy as np

from identify.fit.settings import PRECISE, FitSettings
from identify.optimize.result import InadmissibleError

_HELD = 1e-9  # distance from a bound


def expected_residual(
    residual: Callable[[np.ndarray], np.ndarray],
    u: np.ndarray,
    here: np.ndarray,
    covariance: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    settings: FitSettings = PRECISE,
) -> np.ndarray:
    """Mean of a fit's residual (m,) under noise alone, up to its part along the fitted parameters.

    Parameters
    ----------
    residual : whitened residual (m,) at scaled coordinates (k,)
    u : (k,) the estimate, in coordinates of order one
    here : (m,) the residual there
    covariance : (k, k) of the estimate; a direction of more than `longest_step`, or than the room
        up to a bound, counts as known to that: beyond it the series says nothing, and a second
        difference scaled up to it would be rounding times the covariance
    bounds : (k,) each; a coordinate at one does not move, and none moves beyond one
    settings : `straight_step` and `longest_step` of the difference quotients

    Examples
    --------
    Of y = u^2 with a variance of 0.04: the second derivative of y - u^2 is -2.

    >>> here, no = np.zeros(1), np.full(1, np.inf)
    >>> expected_residual(lambda u: 1 - u**2, np.ones(1), here, np.full((1, 1), 0.04), (-no, no))
    array([-0.04])
    """
    total = np.zeros_like(here)
    room = np.minimum(u - bounds[0], bounds[1] - u)
    moves = room > _HELD
    variances, directions = np.linalg.eigh(covariance[np.ix_(moves, moves)])
    for size, direction in zip(np.sqrt(np.maximum(variances, 0.0)), directions.T, strict=True):
        step = np.zeros_like(u)
        step[moves] = size * direction
        reach = float(np.abs(step).max(initial=0.0))
        if reach < settings.straight_step:
            continue
        step *= min(1.0, settings.longest_step / reach)
        step *= min(1.0, float((room[moves] / np.maximum(np.abs(step[moves]), 1e-300)).min()))
        try:
            total += residual(u + step) + residual(u - step) - 2 * here
        except InadmissibleError:
            continue  # beyond it there is no body
    return total / 2
