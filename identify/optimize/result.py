"""Result of an optimiser, and the exception of an inadmissible trial."""

from dataclasses import dataclass

import numpy as np


class InadmissibleError(ValueError):
    """Parameters at which the model has no answer (E <= 0 somewhere): a failed step, no crash."""


@dataclass(frozen=True)
class OptimizeResult:
    """The end of a minimisation, with scipy's names.

    `x` (k,) best point, `fun` its value, `jac` (k,) the gradient there, `nit` accepted steps,
    `nfev` evaluations (value and derivative together), `success`, `status` (0 converged,
    1 limit of evaluations, 2 no further decrease possible), `message` in words.
    """

    x: np.ndarray
    fun: float
    jac: np.ndarray
    nit: int
    nfev: int
    success: bool
    status: int
    message: str


def free_directions(
    x: np.ndarray, gradient: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> np.ndarray:
    """Mask (k,) of the coordinates that are not held at a bound by the descent direction."""
    return ~(((x <= lower) & (gradient > 0)) | ((x >= upper) & (gradient < 0)))
