"""Optimisers: Gauss-Newton, BFGS, line search, and their common result."""

from identify.optimize.gauss_newton import minimize_gauss_newton
from identify.optimize.optimizers import OPTIMIZERS, Optimizer
from identify.optimize.result import InadmissibleError

__all__ = ["OPTIMIZERS", "InadmissibleError", "Optimizer", "minimize_gauss_newton"]
