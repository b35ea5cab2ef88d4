"""95 % intervals that follow the bend of the misfit's valley.

Depth and weight of an inclusion answer for each other along a curved valley: a deeper one must be
much harder, one near the surface hardly softer. The covariance at the minimum knows the valley's
direction there and not its bend, and its intervals would then be too narrow for the weight. So
the depth is held on either side of the minimum, the rest is fitted again, and with t =
+-sqrt(rise of chi-square) as the coordinate along the valley a parabola q_i(t) follows each
parameter. Where it leaves the minimum in another direction than the covariance says, places between
are sought as well, and a spline goes through all. Across the valley the spread s_i is the one at
fixed depth. The interval is the range of

    q_i(c cos a) + c s_i sin a    over all angles a,    c = 1.96,

which for a straight valley is the usual one, and for the depth itself the profile likelihood's
(Bates & Watts, Nonlinear Regression Analysis, 1988, ch. 6). Where the model misfits grossly, the
noise says nothing of the valley, and the covariance's intervals are left as they are.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.interpolate import CubicSpline

from fem import SolverError
from identify.fit.search import Search
from identify.fit.settings import FitSettings
from identify.measurement.model import MeasurementModel
from identify.optimize.result import InadmissibleError

NORMAL_95 = 1.959964
ENOUGH, TOO_FAR = 0.5, 1.5  # of that, how far along the valley a parabola is laid through
_ANGLES = np.linspace(0, 2 * np.pi, 361)
_TURNED = 0.1  # of a parameter's way along the valley and its spread across, by a wrong direction
_APART = 1.2  # ratio of the ways along the valley to two places of a spline

Place = tuple[float, np.ndarray]
"""Way along the valley from the minimum, and the scaled unknowns (k,) there."""


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
        of_meshes = noise[position, position] < settings.interval_noise * total[position, position]
        if quick.confirmed:  # differences of 3.84 in chi-square ask for the tolerances of a record
            search.finish()
        try:
            result, at = search.minimum(here, start, held=position)
            for _ in range(max(settings.interval_corrections, int(of_meshes))):
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

    def refitted(self, position: int, start: np.ndarray, side: float) -> Place:
        """Return t (inf where nothing is admissible) and the place (k,) of a refit on that side."""
        fun, found = self.refit(position, start)
        share = self.noise[position, position] / self.total[position, position]
        return side * float(np.sqrt(max(2 * (fun - self.fun) * share, 1e-12))), found


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
        sides = [way for side in (-1.0, 1.0) if (way := _along(valley, position, side))]
        if len(sides) == 2:
            ways = [_scaled(way) for way in _with_halves(valley, position, sides)]
            bent.append((position, _range(valley, ways, position)))
    if bent:
        curved = np.array([one for _, one in bent])
        ends = np.column_stack([curved[:, :, 0].min(axis=0), curved[:, :, 1].max(axis=0)])
        for position, bent_ends in bent:
            ends[position] = bent_ends[position]
    return ends


def _along(valley: Valley, position: int, side: float) -> list[Place]:
    """Hold one parameter beside the minimum and fit the rest: places, none at a bound.

    The way goes on, or back, until chi-square has risen about as far as 95 % allow: a parabola
    through a place far up the valley's wall would say nothing of its floor.
    """
    u, total, (lower, upper) = valley.u, valley.total, valley.bounds
    direction = total[:, position] / total[position, position]
    usual = NORMAL_95 * np.sqrt(total[position, position])
    step, near, far = usual, (0.0, 0.0), (np.inf, np.inf)
    places: list[tuple[float, float, np.ndarray]] = []
    for _ in range(valley.tries):
        held = float(np.clip(u[position] + side * step, lower[position], upper[position]))
        moved = held - u[position]
        if abs(moved) < 0.1 * usual and not places:
            break  # the minimum sits at the body's edge: nothing to be learnt on this side
        start = np.clip(u + direction * moved, lower, upper)
        start[position] = held
        t, found = valley.refitted(position, start, side)
        if not np.isfinite(t):
            break
        rate, direction = abs(t) / NORMAL_95, (found - u) / moved
        places.append((abs(moved), t, found))
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
    way: list[Place] = []  # from the last one inwards
    for moved, t, found in sorted(places, key=lambda place: -place[0]):
        if moved <= places[-1][0] and (not way or _APART * abs(t) < abs(way[-1][0])):
            way.append((t, found))
    return way[::-1]


def _scaled(way: list[Place]) -> list[Place]:
    """Return the places of a floor that is flat up to a bound with a scale: it ends there."""
    longer = max(1.0, ENOUGH * NORMAL_95 / abs(way[-1][0]))
    return [(longer * t, found) for t, found in way]


def _with_halves(valley: Valley, position: int, sides: list[list[Place]]) -> list[list[Place]]:
    """Add a place half way to either end where a parabola leaves the minimum as none should.

    The covariance knows the direction there. Elsewhere a parabola is enough.
    """
    u, noise = valley.u, valley.noise
    (a, before), (b, after) = (_scaled(way)[-1] for way in sides)
    slope = -u * (a + b) / (a * b) - before * b / (a * (a - b)) - after * a / (b * (b - a))
    length = np.sqrt(valley.total[position, position])
    expected = length * noise[:, position] / noise[position, position]
    reach = np.maximum(np.abs(before - u), np.abs(after - u)) + _across(valley, position)
    if np.all(np.abs(expected - slope) * min(-a, b) < _TURNED * reach):
        return sides
    found = []
    for side, way in zip((-1.0, 1.0), sides, strict=True):
        t_end, end = way[-1]
        if len(way) == 1:
            t, half = valley.refitted(position, 0.5 * (u + end), side)
            if np.isfinite(t) and _APART * abs(t) < abs(t_end) and abs(t) > abs(t_end) / 10:
                way = [(t, half), (t_end, end)]
        found.append(way)
    return found


def _across(valley: Valley, position: int) -> np.ndarray:
    """Return the standard deviations (k,) across the valley, at fixed depth."""
    total = valley.total
    cross = np.diag(total) - total[:, position] ** 2 / total[position, position]
    return np.sqrt(np.maximum(cross, 0.0))


def _parabola(u: np.ndarray, first: Place, last: Place, t: np.ndarray) -> np.ndarray:
    """Lagrange's parabola (k, n) at t (n,) through two places and the minimum between."""
    (a, before), (b, after) = first, last
    return (
        u[:, None] * (t - a) * (t - b) / (a * b)
        + before[:, None] * t * (t - b) / (a * (a - b))
        + after[:, None] * t * (t - a) / (b * (b - a))
    )


def _range(valley: Valley, sides: list[list[Place]], position: int) -> np.ndarray:
    """Return the ends (k, 2) of the curved intervals."""
    u, total, noise = valley.u, valley.total, valley.noise
    below, above = sides
    (a, _), (b, _) = below[-1], above[-1]
    t = np.clip(NORMAL_95 * np.cos(_ANGLES), 1.5 * a, 1.5 * b)  # a parabola bears no more
    path = _parabola(u, below[-1], above[-1], t)
    if len(below) + len(above) > 2:
        places = [*below[::-1], (0.0, u), *above]
        spline = CubicSpline([t for t, _ in places], np.array([place for _, place in places]))
        inside = (t > a) & (t < b)
        path[:, inside] = spline(t[inside]).T
    # The refits know the noise alone; the model's own error moves the others along differently
    turn = total[:, position] / total[position, position]
    turn = turn - noise[:, position] / noise[position, position]
    path = path + np.sqrt(total[position, position]) * turn[:, None] * t
    spread = path + NORMAL_95 * _across(valley, position)[:, None] * np.sin(_ANGLES)
    return np.column_stack([spread.min(axis=1), spread.max(axis=1)])
