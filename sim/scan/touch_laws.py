"""Laws of the force by the depth since first touch, and the fit of one to readings."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from sim.robot.compiled import compiled

ITERATIONS = 25

POWERS = 0.9, 2.0


@compiled
def _rounded(depth: np.ndarray, share: float) -> np.ndarray:
    """Force at a depth of which a share is a ball's: depth = (1 - share) F + share F^(2/3)."""
    share = min(max(share, 0.0), 1.0)
    root = np.cbrt(depth) if share < 0.5 else np.sqrt(depth)  # of the force, the third one
    for i in range(len(depth)):
        one = root[i]
        for _ in range(6):
            slope = (3 * (1 - share) * one + 2 * share) * one
            off = ((1 - share) * one + share) * one * one - depth[i]
            one -= off / max(slope, 1e-12)
        root[i] = one**3
    return root


Laws = tuple[tuple[Callable[..., np.ndarray], tuple[float, ...]], ...]

NEARLY_STRAIGHT: Laws = (
    (lambda s: s, ()),
    (lambda s, b: np.expm1(b * s) / b if abs(b) > 1e-6 else s, (0.1,)),
    (_rounded, (0.1,)),
)
"""Where the noise shows no curvature, one may hide in it and move the touch: a line's,
Fung's law and a rounded tip's."""

LAWS: Laws = (
    (lambda s: s, ()),
    (lambda s: s**1.5, ()),
    (lambda s, c: s * np.exp(c * s), (0.3,)),
    (lambda s, c: s**1.5 * np.exp(c * s), (0.1,)),
    (lambda s, p: s ** np.clip(p, *POWERS), (1.2,)),
    (lambda s, b: np.expm1(b * s) / b if abs(b) > 1e-6 else s, (1.0,)),
    (_rounded, (0.1,)),
    (lambda s, c: s * (1 + c * s * s), (0.5,)),
    (lambda s, p, c: s ** np.clip(p, *POWERS) * np.exp(c * s), (1.2, 0.1)),
    (lambda s, b, c: (np.expm1(b * s) / b if abs(b) > 1e-6 else s) * np.exp(c * s * s), (1.0, 0.0)),
)
"""Laws f of the force k f(s), s the depth since touch over the fitted range, with the values from
which their parameters start: a line; a ball's contact; both stiffening; a power; Fung's law; a
rounded tip's; a cubic one; and more general ones."""

BALL = (lambda s, b, c: s**1.5 * np.exp(b * np.sqrt(s) + c * s), (0.0, 0.0))
"""Law of a ball: Hertz's, and a series in the contact's radius for all that the body is beside a
half-space."""

BENT = 1.0
"""Standard deviation of the series' parameters about those of an even body, see `Ball`. With 0.3
deep presses near an edge, where the body softens, are 0.3 mm early at 0.12 mm of stated error."""

LOW, HIGH = -4.0, 12.0
"""Of a parameter of the laws."""


class Ball(NamedTuple):
    """Ball that presses on a body: its radius, and the body's thickness along the press, m."""

    radius_m: float
    thickness_m: float

    def series(self, depth_m: float) -> np.ndarray:
        """Return the parameters of `BALL` over a depth, for an even body on a firm base.

        The base stiffens by 1 + 1.133 x + 1.283 x^2, x = sqrt(radius depth)/thickness (Dimitriadis
        et al., Biophys. J. 2002); a sphere is no paraboloid, which is 1 - 0.1 depth/radius.
        """
        x = np.sqrt(self.radius_m * depth_m) / self.thickness_m
        return np.array([1.133 * x, 0.641 * x**2 - 0.1 * depth_m / self.radius_m])


def fit_law(
    law: Callable[..., np.ndarray],
    start: np.ndarray,
    x: np.ndarray,
    force: np.ndarray,
    sd: np.ndarray,
    expected: np.ndarray,
    spread: float,
) -> tuple[np.ndarray, float, float, float]:
    """Fit touch and parameters; zero of the force and factor of the law follow linearly.

    The parameters are `expected` before the readings, with that standard deviation.

    Returns
    -------
    touch and parameters, the factor, chi squared, and the touch's variance
    """
    weight = 1 / sd
    measured = force * weight
    aa, fa = float(weight @ weight), float(weight @ measured)

    def residual(p: np.ndarray) -> tuple[np.ndarray, float]:
        shape = law(np.maximum(x - p[0], 0.0), *p[1:]) * weight
        ab, bb, fb = float(weight @ shape), float(shape @ shape), float(shape @ measured)
        factor = max((aa * fb - ab * fa) / max(aa * bb - ab * ab, 1e-300), 0.0)
        offset = (fa - factor * ab) / aa
        misfit = measured - offset * weight - factor * shape
        return np.concatenate([misfit, (p[1:] - expected) / spread]), factor

    p, damping, normal = np.array(start, float), 1e-3, np.eye(len(start))
    low = np.array([x.min() - 0.1, *(LOW for _ in p[1:])])
    high = np.array([x.max() - 0.02, *(HIGH for _ in p[1:])])
    r, factor = residual(p)
    for _ in range(ITERATIONS):
        jacobian = np.empty((len(r), len(p)))
        for i in range(len(p)):
            moved = p.copy()
            moved[i] += 1e-5
            jacobian[:, i] = (residual(moved)[0] - r) / 1e-5
        normal, gradient = jacobian.T @ jacobian, jacobian.T @ r
        step = np.linalg.solve(normal + damping * np.diag(np.diag(normal) + 1e-12), -gradient)
        tried = np.clip(p + step, low, high)
        new, new_factor = residual(tried)
        if new @ new < r @ r:
            small = np.abs(tried - p).max() < 1e-6
            p, r, factor, damping = tried, new, new_factor, damping / 5
            if small:
                break
        else:
            damping = max(4 * damping, 1e-4)
            if damping > 1e4:
                break
    return p, factor, float(r @ r), float(np.linalg.pinv(normal)[0, 0])
