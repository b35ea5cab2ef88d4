"""Smooth functions of time: splines over a scan, the free form of a drift; lines within a phase."""

from collections.abc import Sequence
from functools import lru_cache

import numba
import numpy as np
from scipy.interpolate import CubicSpline

from identify.effects.readings import Readings

_LEAST, _SMOOTH_S = 3, 0.1  # readings, and time, to each side of one in a local line
KNOTS = 5
"""Knots after the first, evenly over the scan: courses no faster than two fifths of it."""
EVEN = tuple(k / KNOTS for k in range(KNOTS + 1))


def knot_names(prefix: str) -> list[tuple[str, str]]:
    """Name of each knot's value, and its place in the scan in words.

    >>> knot_names("zero")[0]
    ('zero_20', '20 %')
    """
    return [(f"{prefix}_{100 * k // KNOTS}", f"{100 * k // KNOTS} %") for k in range(1, KNOTS + 1)]


def smooth_in_time(readings: Readings, values: Sequence[float]) -> np.ndarray:
    """Natural cubic spline (m,) at the readings: 0 at the scan's start, `values` at the knots."""
    return natural_spline(readings.elapsed_s / max(readings.scales.time_s, 1e-9), (0.0, *values))


def natural_spline(
    share: np.ndarray, values: Sequence[float] | np.ndarray, knots: tuple[float, ...] = EVEN
) -> np.ndarray:
    """Natural cubic spline (m,) at shares (m,) of a way, by its values at rising knots.

    It goes on as a straight line beyond the last one.

    >>> natural_spline(np.array([1.0, 2.0]), (0.0, 0.2, 0.4, 0.6, 0.8, 1.0)).round(9)
    array([1., 2.])
    """
    pieces = _pieces(knots) @ np.asarray(values, float)
    return _evaluated(np.ascontiguousarray(share), np.array(knots), pieces)


@numba.njit(cache=True)
def _evaluated(share, knots, pieces):  # scipy's own takes ten times as long for the same sum
    values = np.empty(len(share))
    for i in range(len(share)):
        piece = 0
        while piece < len(knots) - 2 and share[i] >= knots[piece + 1]:
            piece += 1
        past = max(share[i] - knots[-1], 0.0)
        beyond = share[i] - past - knots[piece]
        value, slope = 0.0, 0.0
        for power in range(4):
            slope = slope * beyond + value
            value = value * beyond + pieces[power, piece]
        values[i] = value + slope * past
    return values


@lru_cache(maxsize=4)
def _pieces(knots: tuple[float, ...]) -> np.ndarray:
    """Coefficients (4, pieces, knots) of the splines that are 1 at one knot, 0 at the others."""
    return CubicSpline(knots, np.eye(len(knots)), bc_type="natural").c


class LocalLines:
    """Least-squares lines of a column through neighbouring readings of one phase of a press.

    Parameters
    ----------
    phase : (m,) number of the phase of the press, rising
    time_s, values : (m,) within the press
    step_s : usual time between two readings
    """

    def __init__(self, phase: np.ndarray, time_s: np.ndarray, values: np.ndarray, step_s: float):
        self.phase = phase
        self.half = max(_LEAST, int(np.ceil(_SMOOTH_S / max(step_s, 1e-9))))
        rows = np.column_stack([np.ones_like(time_s), time_s, values, time_s**2, time_s * values])
        self.sums = np.vstack([np.zeros(5), np.cumsum(rows, axis=0)])

    def at(self, phase: np.ndarray, near: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        """Values (m,) at times on the courses of phases, each by the line nearest to a place."""
        n, t, f, slope = self._lines(phase, near)
        return f / n + slope * (time_s - t / n)

    def slopes(self) -> np.ndarray:
        """Rate of change (m,) at each reading, per second; 0 where its phase has no other."""
        return self._lines(self.phase, np.arange(len(self.phase)))[3]

    def _lines(self, phase: np.ndarray, near: np.ndarray) -> tuple[np.ndarray, ...]:
        low = np.searchsorted(self.phase, phase)
        high = np.searchsorted(self.phase, phase, "right")
        width = 2 * self.half + 1
        start = np.clip(np.minimum(near - self.half, high - width), low, None)
        stop = np.minimum(start + width, high)
        n, t, f, tt, tf = (self.sums[stop] - self.sums[start]).T
        n = np.maximum(n, 1)
        spread = np.maximum(tt - t * t / n, 0.0)
        slope = np.divide(tf - t * f / n, spread, out=np.zeros_like(t), where=spread > 1e-12)
        return n, t, f, slope
