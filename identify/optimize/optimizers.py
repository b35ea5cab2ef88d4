"""The least-squares optimisers by the name under which a command offers them."""

from collections.abc import Callable, Mapping
from types import MappingProxyType
from typing import Protocol

import numpy as np

from identify.optimize.bfgs import minimize_bfgs_residuals
from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.result import OptimizeResult


class Optimizer(Protocol):
    """Minimises |r(x)|^2 / 2 for residuals r (m,) that come with their Jacobian (m, k)."""

    def __call__(
        self,
        residuals: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
        x0: np.ndarray,
        /,
        *,
        bounds: tuple[np.ndarray, np.ndarray] | None = None,
        ftol: float = 1e-6,
        rtol: float = 0.0,
        above: float = 0.0,
        max_evaluations: int = 100,
        callback: Callable[[np.ndarray, float], None] | None = None,
    ) -> OptimizeResult:
        """Minimise from x0 (k,) within the bounds.

        A decrease of `ftol`, or of the part `rtol` of what the value has `above`, no longer counts.
        """
        ...


OPTIMIZERS: Mapping[str, Optimizer] = MappingProxyType(
    {"bfgs": minimize_bfgs_residuals, "gauss-newton": minimize_gauss_newton}
)
