"""Minimisation by BFGS, the paper's method, made safe.

The textbook form leaves the admissible set in its first line search, as the first inverse Hessian
is the identity. Here it is that of the residuals' Jacobian at the start, or else the first step is
bounded; so is every later one, a trial at which the model has no answer counts as a failed step,
and coordinates stay within their bounds.

Source: Nocedal and Wright, "Numerical Optimization", eqs. 6.17 and 6.20; bounds by active set.
"""

from collections.abc import Callable

import numpy as np

from fem import SolverError
from identify.optimize.line_search import Trial, wolfe_step
from identify.optimize.result import InadmissibleError, OptimizeResult, free_directions

_RAISED = 1e-3  # of the largest curvature: the least that the first Hessian has
_ROUNDING = 8 * np.finfo(float).eps

Callback = Callable[[np.ndarray, float], None]


def minimize_bfgs(
    fun: Callable[[np.ndarray], tuple[float, np.ndarray]],
    x0: np.ndarray,
    *,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
    first_step: float = 0.1,
    max_step: float = 1.0,
    gtol: float = 1e-8,
    rtol: float = 0.0,
    above: float = 0.0,
    max_evaluations: int = 200,
    callback: Callback | None = None,
    inverse: np.ndarray | None = None,
) -> OptimizeResult:
    """Minimise a function that returns its value and gradient (k,).

    Parameters
    ----------
    fun
        x (k,) -> (value, gradient (k,)). It may raise `InadmissibleError` or `SolverError`, or
        return numbers that are not finite: the step is then shortened. Not so at `x0`.
    x0
        Start (k,); it is moved into the bounds.
    bounds
        Lower and upper (k,).
    first_step, max_step
        Largest change of a coordinate in the first step (without `inverse`) and in any.
    gtol
        Converged when no component of the projected gradient exceeds it.
    rtol, above
        Converged, too, when a step promises no more than the part rtol of what the value exceeds
        `above`; in any case at the value's rounding.
    max_evaluations
        Limit of evaluations.
    callback
        Called with x and value at the start and after each accepted step.
    inverse
        First inverse Hessian (k, k); the identity, of no scale, where not given.
    """
    search = _Search(fun, x0, bounds)
    current = search.start()
    scaled = inverse is not None
    inverse = np.eye(current.point.size) if inverse is None else inverse
    nit = 0
    if callback:
        callback(current.point, current.fun)
    while True:
        free = free_directions(current.point, current.gradient, search.lower, search.upper)
        size = float(np.abs(current.gradient[free]).max(initial=0.0))
        if size <= gtol:
            return search.result(current, nit, 0, f"gradient {size:.1e} is within gtol")
        if search.nfev >= max_evaluations:
            return search.result(current, nit, 1, f"limit of {max_evaluations} evaluations reached")
        direction = np.zeros_like(current.point)
        direction[free] = -inverse[np.ix_(free, free)] @ current.gradient[free]
        length = float(np.abs(direction).max())
        # A direction without a scale of its own; others are only kept from leaping.
        direction *= min(1.0, max_step / length) if scaled else first_step / length
        slack = max(rtol * max(current.fun - above, 0.0), _ROUNDING * abs(current.fun))
        if -float(current.gradient @ direction) <= slack:
            return search.result(current, nit, 0, "a further decrease would be within rtol")
        after = search.along(current, direction, max_step)
        if after is None:
            if np.array_equal(inverse, np.eye(inverse.shape[0])):
                return search.result(current, nit, 2, "no step along the gradient decreases fun")
            inverse, scaled = np.eye(inverse.shape[0]), False
            continue
        inverse = _update(
            inverse, after.point - current.point, after.gradient - current.gradient, not scaled
        )
        current, nit, scaled = after, nit + 1, True
        if callback:
            callback(current.point, current.fun)


def minimize_bfgs_residuals(
    residuals: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]],
    x0: np.ndarray,
    *,
    bounds: tuple[np.ndarray, np.ndarray] | None = None,
    ftol: float = 1e-6,
    rtol: float = 0.0,
    above: float = 0.0,
    max_evaluations: int = 200,
    callback: Callback | None = None,
) -> OptimizeResult:
    """Minimise |r(x)|^2 / 2 by BFGS: the counterpart of `minimize_gauss_newton`.

    `residuals` returns r (m,) and its Jacobian J (m, k), of which BFGS sees the gradient only; but
    its first inverse Hessian is that of J'J at the start, whose small eigenvalues are raised.
    `ftol` stands for a gradient of sqrt(2 ftol), which is as close for a curvature of one.
    """
    lower, upper = bounds or (-np.inf, np.inf)
    start = np.clip(np.asarray(x0, float), lower, upper)
    first = residuals(start)
    known = {start.tobytes(): first}  # is not evaluated again

    def fun(x: np.ndarray) -> tuple[float, np.ndarray]:
        r, jac = known.pop(x.tobytes(), None) or residuals(x)
        return 0.5 * float(r @ r), jac.T @ r

    curvature = first[1].T @ first[1]
    curvature += (
        _RAISED * max(float(np.diag(curvature).max(initial=0.0)), 1e-300) * np.eye(len(start))
    )
    return minimize_bfgs(
        fun,
        x0,
        bounds=bounds,
        gtol=float(np.sqrt(2 * ftol)),
        rtol=rtol,
        above=above,
        max_evaluations=max_evaluations,
        callback=callback,
        inverse=np.linalg.inv(curvature),
    )


class _Search:
    """Evaluations within the bounds, counted."""

    def __init__(self, fun, x0: np.ndarray, bounds) -> None:
        self._fun = fun
        x0 = np.array(x0, dtype=float)
        self.lower, self.upper = bounds or (np.full(x0.shape, -np.inf), np.full(x0.shape, np.inf))
        self._x0 = np.clip(x0, self.lower, self.upper)
        self.nfev = 0

    def start(self) -> Trial:
        self.nfev += 1
        value, gradient = self._fun(self._x0)
        if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
            raise InadmissibleError(f"the start {self._x0} gives {value}: choose another start")
        return Trial(0.0, self._x0, float(value), gradient, 0.0)

    def along(self, current: Trial, direction: np.ndarray, max_step: float) -> Trial | None:
        """Step along the direction up to the first bound that it meets, or to `max_step`."""
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(
                direction > 0,
                (self.upper - current.point) / direction,
                np.where(direction < 0, (self.lower - current.point) / direction, np.inf),
            )
        longest = float(min(room.min(), max_step / np.abs(direction).max()))
        slope = float(current.gradient @ direction)
        if longest <= 0 or slope >= 0:
            return None
        start = Trial(0.0, current.point, current.fun, current.gradient, slope)

        def evaluate(step: float) -> Trial | None:
            point = np.clip(current.point + step * direction, self.lower, self.upper)
            self.nfev += 1
            try:
                value, gradient = self._fun(point)
            except (InadmissibleError, SolverError):
                return None
            if not (np.isfinite(value) and np.all(np.isfinite(gradient))):
                return None
            return Trial(step, point, float(value), gradient, float(gradient @ direction))

        return wolfe_step(evaluate, start, 1.0, longest)

    def result(self, end: Trial, nit: int, status: int, message: str) -> OptimizeResult:
        return OptimizeResult(
            end.point, end.fun, end.gradient, nit, self.nfev, status == 0, status, message
        )


def _update(inverse: np.ndarray, s: np.ndarray, y: np.ndarray, first: bool) -> np.ndarray:
    """BFGS update of the inverse Hessian (eq. 6.17); skipped without positive curvature."""
    curvature = float(s @ y)
    if curvature <= 1e-12 * float(np.linalg.norm(s) * np.linalg.norm(y)):
        return inverse
    if first:
        inverse = np.eye(s.size) * curvature / float(y @ y)  # eq. 6.20
    left = np.eye(s.size) - np.outer(s, y) / curvature
    return left @ inverse @ left.T + np.outer(s, s) / curvature
