"""What the curvature of a fitted model does to its residual.

A fit follows the noise over a curved surface of predictions, so that what it leaves is not zero on
average: with the covariance V of the estimate and the second derivatives H of the whitened
residual r,

    E r = 1/2 (I - P) sum_ab H_ab V_ab,

P the projection on what was fitted. It is small (hundredths of a standard error of an effect's
size), yet the same in every scan, and lies along the effects that act like a change of stiffness:
without it their p-values are not quite uniform.
Source: R. D. Cook, C.-L. Tsai, B. C. Wei, Bias in nonlinear regression, Biometrika 73 (1986) 615.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from identify.optimize_result import InadmissibleError

_STRAIGHT = 0.02  # largest coordinate of a standard deviation below which nothing bends
_FURTHEST = 0.5  # the same beyond which nothing is known of the other side: it counts as this far


def expected_residual(
    residual: Callable[[np.ndarray], np.ndarray],
    u: np.ndarray,
    here: np.ndarray,
    covariance: np.ndarray,
) -> np.ndarray:
    """Mean of a fit's residual (m,) under noise alone, up to its part along what was fitted.

    Parameters
    ----------
    residual : whitened residual (m,) at scaled coordinates (k,)
    u : (k,) the estimate, in coordinates of order one
    here : (m,) the residual there
    covariance : (k, k) of the estimate

    Examples
    --------
    Of y = u^2 with a variance of 0.04: the second derivative of y - u^2 is -2.

    >>> expected_residual(lambda u: 1 - u**2, np.ones(1), np.zeros(1), np.array([[0.04]])).round(6)
    array([-0.04])
    """
    total = np.zeros_like(here)
    variances, directions = np.linalg.eigh(covariance)
    steps = np.sqrt(np.maximum(variances, 0.0)) * directions
    for step in steps.T:
        reach = float(np.abs(step).max())
        if reach < _STRAIGHT:
            continue
        step = step * min(1.0, _FURTHEST / reach)
        try:
            total += residual(u + step) + residual(u - step) - 2 * here
        except InadmissibleError:
            continue  # beyond it there is no body
    return total / 2
