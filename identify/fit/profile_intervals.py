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

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from fem import SolverError
from identify.fit.search import Search
from identify.fit.settings import FitSettings
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError

NORMAL_95 = 1.959964
ENOUGH, TOO_FAR = 0.5, 1.5  # of that, how far along the valley a parabola is laid through
_ANGLES = np.linspace(0, 2 * np.pi, 361)


def valley_intervals(
    model: MeasurementModel,
    u: np.ndarray,
    fun: float,
    total: np.ndarray,
    noise: np.ndarray,
    settings: FitSettings,
) -> np.ndarray:
    """Return the ends (k, 2) of a fit's intervals in scaled coordinates; see `Valley`.

    Everything beside the depth that is held is fitted again, effects too.
    """
    quick = replace(
        settings,
        rtol=0.0,
        gross_rtol=0.0,
        enough=0.0,
        max_evaluations=settings.interval_evaluations,
    )

    def refit(position: int, start: np.ndarray) -> tuple[float, np.ndarray]:
        search, here = Search(quick), model
        if quick.confirmed:  # differences of 3.84 in chi-square ask for the tolerances of a record
            search.finish()
        try:
            result, at = search.minimum(here, start, held=position)
            for _ in range(settings.interval_corrections):
                # So far from the estimate the finer model corrects the map otherwise
                here = search.corrected(here, result.x)
                result, at = search.minimum(here, result.x, held=position)
                here = search.corrected(here, result.x)
                at = search.evaluate(here, result.x)
        except (InadmissibleError, SolverError):  # a map that a mesh does not resolve
            return np.inf, start  # no way on this side
        return 0.5 * at.chi2, result.x

    valley = Valley(u, fun, total, noise, model.bounds, refit, settings.interval_tries)
    return bent_intervals(valley, model.names)


@dataclass(frozen=True)
class Valley:
    """A minimum and the way to follow its valley.

    Attributes
    ----------
    u, fun : (k,) scaled estimate and half of chi-square there
    total, noise : (k, k) covariance with and without the model's own error
    bounds : lower and upper (k,)
    refit : from a position and a start (k,), whose coordinate there is held, to the least half of
        chi-square (inf where nothing is admissible) and where (k,) that is
    tries : lengths of the step along the valley, until chi-square rises as it should
    """

    u: np.ndarray
    fun: float
    total: np.ndarray
    noise: np.ndarray
    bounds: tuple[np.ndarray, np.ndarray]
    refit: Callable[[int, np.ndarray], tuple[float, np.ndarray]]
    tries: int


def straight(u: np.ndarray, total: np.ndarray) -> np.ndarray:
    """Return the ends (k, 2) of the covariance's own intervals."""
    deviation = np.sqrt(np.diag(total))
    return np.column_stack([u - NORMAL_95 * deviation, u + NORMAL_95 * deviation])


def bent_intervals(valley: Valley, names: Sequence[str]) -> np.ndarray:
    """Return the ends (k, 2) of intervals that follow the bend along each free depth.

    Of several depths' valleys, each parameter takes the widest interval.
    """
    u, total = valley.u, valley.total
    ends, bent = straight(u, total), []
    if len(u) < 2 or not np.isfinite(ends).all():
        return ends
    for position, name in enumerate(names):
        if not name.endswith(".z_m"):
            continue
        sides = [place for side in (-1.0, 1.0) if (place := _along(valley, position, side))]
        if len(sides) == 2:
            bent.append((position, _range(valley, sides, position)))
    if bent:
        curved = np.array([one for _, one in bent])
        ends = np.column_stack([curved[:, :, 0].min(axis=0), curved[:, :, 1].max(axis=0)])
        for position, bent_ends in bent:
            ends[position] = bent_ends[position]
    return ends


def _along(valley: Valley, position: int, side: float) -> tuple[float, np.ndarray] | None:
    """Hold one parameter beside the minimum and fit the rest: (t, u) there, or None at a bound.

    The way goes on, or back, until chi-square has risen about as far as 95 % allow: a parabola
    through a place far up the valley's wall would say nothing of its floor.
    """
    u, total, (lower, upper) = valley.u, valley.total, valley.bounds
    share = valley.noise[position, position] / total[position, position]
    direction = total[:, position] / total[position, position]
    usual = NORMAL_95 * np.sqrt(total[position, position])
    step, place, near, far = usual, None, (0.0, 0.0), (np.inf, np.inf)
    for _ in range(valley.tries):
        held = float(np.clip(u[position] + side * step, lower[position], upper[position]))
        moved = held - u[position]
        if abs(moved) < 0.1 * usual and place is None:
            break  # the minimum sits at the body's edge: nothing to be learnt on this side
        start = np.clip(u + direction * moved, lower, upper)
        start[position] = held
        fun, found = valley.refit(position, start)
        if not np.isfinite(fun):
            break
        rise = max(2 * (fun - valley.fun) * share, 1e-12)
        rate, direction = float(np.sqrt(rise)) / NORMAL_95, (found - u) / moved
        # A floor that is flat up to a bound ends there: a parabola through no rise has no scale
        place = (side * NORMAL_95 * max(rate, ENOUGH), found)
        at_edge = held in (lower[position], upper[position])
        if ENOUGH < rate < TOO_FAR or (rate <= ENOUGH and at_edge):
            break
        if rate >= TOO_FAR:
            far = (abs(moved), rate)
        else:
            near = (abs(moved), rate)
        (a, before), (b, after) = near, far
        part = np.clip((1 - before) / (after - before), 0.25, 0.75)
        step = a + part * (b - a) if np.isfinite(b) else 2 * a
    return place


def _range(valley: Valley, sides: list[tuple[float, np.ndarray]], position: int) -> np.ndarray:
    """Return the ends (k, 2) of the curved intervals."""
    u, total, noise = valley.u, valley.total, valley.noise
    (a, before), (b, after) = sides
    t = np.clip(NORMAL_95 * np.cos(_ANGLES), 1.5 * a, 1.5 * b)  # a parabola bears no more
    # Lagrange's parabola through (a, before), (0, u), (b, after)
    path = (
        u[:, None] * (t - a) * (t - b) / (a * b)
        + before[:, None] * t * (t - b) / (a * (a - b))
        + after[:, None] * t * (t - a) / (b * (b - a))
    )
    # The refits know the noise alone; the model's own error moves the others along differently
    turn = total[:, position] / total[position, position]
    turn = turn - noise[:, position] / noise[position, position]
    path = path + np.sqrt(total[position, position]) * turn[:, None] * t
    cross = np.diag(total) - total[:, position] ** 2 / total[position, position]
    spread = path + NORMAL_95 * np.sqrt(np.maximum(cross, 0))[:, None] * np.sin(_ANGLES)
    return np.column_stack([spread.min(axis=1), spread.max(axis=1)])
