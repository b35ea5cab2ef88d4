"""Smooth functions of time: splines over a scan, the free form of a drift; lines within a phase."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from identify.effects.readings import Readings

_LEAST, _SMOOTH_S = 3, 0.1  # readings, and time, to each side of one in a local line
KNOTS = 5
"""Knots after the first, evenly over the scan: courses no faster than two fifths of it."""


def knot_names(prefix: str) -> list[tuple[str, str]]:
    """Name of each knot's value, and its place in the scan in words.

    >>> knot_names("zero")[0]
    ('zero_20', '20 %')
    """
    return [(f"{prefix}_{100 * k // KNOTS}", f"{100 * k // KNOTS} %") for k in range(1, KNOTS + 1)]


def smooth_in_time(readings: Readings, values: Sequence[float]) -> np.ndarray:
    """Natural cubic spline (m,) at the readings: 0 at the scan's start, `values` at the knots."""
    time = readings.elapsed_s
    end = max(float(time.max()), 1e-9)
    return natural_spline(time / end) @ np.asarray(values, float)


def natural_spline(share: np.ndarray) -> np.ndarray:
    """Basis (m, KNOTS) at shares (m,) of a way: one spline a knot, 1 there and 0 at the others."""
    return _basis()(share)


@lru_cache(maxsize=1)
def _basis() -> CubicSpline:
    """One spline a knot after the first: 1 there, 0 at the others."""
    return CubicSpline(np.linspace(0, 1, KNOTS + 1), np.eye(KNOTS + 1)[:, 1:], bc_type="natural")


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
