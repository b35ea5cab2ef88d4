"""Small least-squares problems, independent of each other, solved side by side.

Each has a damping of its own (Levenberg-Marquardt, as in `identify.optimize.gauss_newton`);
evaluations are made for all at once.
"""

from collections.abc import Callable

import numpy as np

_LESS, _MORE = 0.3, 6.0  # factors on the damping after a step that was taken, and one that was not


def minimize_side_by_side(
    residuals: Callable[[np.ndarray], np.ndarray],
    owner: np.ndarray,
    x0: np.ndarray,
    bounds: tuple[np.ndarray, np.ndarray],
    step: np.ndarray,
    rounds: int = 20,
) -> tuple[np.ndarray, np.ndarray]:
    """Minimise |r_j(x_j)|^2 of j problems with k unknowns each.

    Parameters
    ----------
    residuals : x (k, j) -> r (m,); what is not finite counts as a step too far, but at `x0`
    owner : (m,) problem of each residual
    x0 : (k, j)
    bounds : lower and upper, both (k, j)
    step : (k,) of the difference quotients
    rounds : steps that are tried

    Returns
    -------
    x : (k, j)
    squares : (j,)
    """
    (lower, upper), x = bounds, np.clip(x0, *bounds)
    unknowns, problems = x.shape
    damping = np.full(problems, 1e-3)

    def sums(values: np.ndarray) -> np.ndarray:
        return np.bincount(owner, values, problems)

    r = residuals(x)
    squares = sums(r**2)
    for _ in range(rounds):
        jacobian = np.empty((unknowns, len(r)))
        for k in range(unknowns):
            inwards = np.where(x[k] + step[k] > upper[k], -step[k], step[k])
            moved = x.copy()
            moved[k] += inwards
            jacobian[k] = (residuals(moved) - r) / inwards[owner]
        jacobian = np.nan_to_num(jacobian, posinf=0.0, neginf=0.0)
        gradient = np.array([sums(row * r) for row in jacobian]).T
        normal = np.array([[sums(a * b) for a in jacobian] for b in jacobian]).transpose(2, 0, 1)
        diagonal = np.maximum(np.diagonal(normal, axis1=1, axis2=2), 1e-30)
        damped = normal + (damping[:, None] * diagonal)[:, :, None] * np.eye(unknowns)
        change = -np.linalg.solve(damped, gradient[..., None])[..., 0].T
        trial = np.clip(x + change, lower, upper)
        there = residuals(trial)
        lowered = sums(np.where(np.isfinite(there), there, np.inf) ** 2)
        better = lowered < squares
        x, squares = np.where(better, trial, x), np.where(better, lowered, squares)
        r = np.where(better[owner], there, r)
        damping = np.clip(damping * np.where(better, _LESS, _MORE), 1e-9, 1e9)
    return x, squares
