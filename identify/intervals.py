"""95 % intervals that follow the bend of the misfit's valley.

Depth and weight of an inclusion answer for each other along a curved valley: a deeper one must be
much harder, one near the surface hardly softer. The covariance at the minimum knows the valley's
direction there and not its bend, and its intervals would then be too narrow for the weight. So
the depth is held on either side of the minimum, the rest is fitted again, and with t =
+-sqrt(rise of chi-square) as the coordinate along the valley a parabola q_i(t) follows each
parameter. Across the valley the spread s_i is the one at fixed depth. The interval is the range of

    q_i(c cos a) + c s_i sin a    over all angles a,    c = 1.96,

which for a straight valley is the usual one, and for the depth itself the profile likelihood's
(Bates & Watts, Nonlinear Regression Analysis, 1988, ch. 6). Where the model misfits grossly, the
noise says nothing of the valley, and the covariance's intervals are left as they are.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from identify.forward import Forward
from identify.scan_problem import Minimum, ScanProblem

NORMAL_95 = 1.959964
_EVALUATIONS = 10  # of each refit
_TRIES = 3  # at a step that raises chi-square as it should
_ANGLES = np.linspace(0, 2 * np.pi, 361)


def intervals(
    problem: ScanProblem,
    minimum: Minimum,
    total: np.ndarray,
    noise: np.ndarray,
    bent: bool = True,
) -> tuple[np.ndarray, int]:
    """Return the ends (k, 2) of the intervals in scaled coordinates, and the evaluations spent.

    Parameters
    ----------
    total, noise : (k, k) covariance with and without the model's own error, scaled coordinates
    bent : follow the bend of the valley; else the covariance's own intervals
    """
    u, space = minimum.result.x, minimum.forward.space
    deviation = np.sqrt(np.diag(total))
    ends = np.column_stack([u - NORMAL_95 * deviation, u + NORMAL_95 * deviation])
    spent = 0
    if not bent or problem.is_gross(minimum):
        return ends, spent
    for position, name in enumerate(space.free_names):
        if not name.endswith(".z_m") or len(u) < 2 or not np.isfinite(deviation).all():
            continue
        share = noise[position, position] / total[position, position]
        sides = []
        for side in (-1.0, 1.0):
            place, evaluations = _along(problem, minimum, total, position, side, share)
            spent += evaluations
            if place is not None:
                sides.append(place)
        if len(sides) == 2:
            curved = _range(u, sides, total, position)
            ends = np.column_stack(
                [np.minimum(ends[:, 0], curved[:, 0]), np.maximum(ends[:, 1], curved[:, 1])]
            )
            ends[position] = curved[position]
    return ends, spent


def _along(
    problem: ScanProblem,
    minimum: Minimum,
    total: np.ndarray,
    position: int,
    side: float,
    share: float,
) -> tuple[tuple[float, np.ndarray] | None, int]:
    """Hold one parameter beside the minimum and fit the rest: (t, u) there, or None at a bound."""
    forward, u = minimum.forward, minimum.result.x
    space = forward.space
    lower, upper = space.bounds
    others = np.delete(np.arange(len(u)), position)
    kept = tuple(index for i, index in enumerate(space.free) if i != position)
    step, spent, place = NORMAL_95 * np.sqrt(total[position, position]), 0, None
    for _ in range(_TRIES):
        held = float(np.clip(u[position] + side * step, lower[position], upper[position]))
        if abs(held - u[position]) < 0.1 * step:
            break  # the minimum sits at the body's edge: nothing to be learnt on this side
        start = u + total[:, position] / total[position, position] * (held - u[position])
        start = np.clip(start, lower, upper)
        start[position] = held
        fixed = replace(space, start=space.to_map(start), free=kept)
        refit = problem.minimize(
            Forward(forward.model, fixed, forward.ratio), start[others], _EVALUATIONS
        )
        spent += refit.nfev
        found = start.copy()
        found[others] = refit.result.x
        rise = max(2 * (refit.result.fun - minimum.result.fun) * share, 1e-12)
        place = (side * float(np.sqrt(rise)), found)
        at_edge = held in (lower[position], upper[position])
        if abs(place[0]) > 0.5 * NORMAL_95 or at_edge:
            break
        step *= min(NORMAL_95 / abs(place[0]), 2.0)
    return place, spent


def _range(
    u: np.ndarray, sides: list[tuple[float, np.ndarray]], total: np.ndarray, position: int
) -> np.ndarray:
    """Return the ends (k, 2) of the curved intervals."""
    (a, before), (b, after) = sides
    t = np.clip(NORMAL_95 * np.cos(_ANGLES), 1.5 * a, 1.5 * b)  # a parabola bears no more
    # Lagrange's parabola through (a, before), (0, u), (b, after)
    path = (
        u[:, None] * (t - a) * (t - b) / (a * b)
        + before[:, None] * t * (t - b) / (a * (a - b))
        + after[:, None] * t * (t - a) / (b * (b - a))
    )
    cross = np.diag(total) - total[:, position] ** 2 / total[position, position]
    spread = path + NORMAL_95 * np.sqrt(np.maximum(cross, 0))[:, None] * np.sin(_ANGLES)
    return np.column_stack([spread.min(axis=1), spread.max(axis=1)])
