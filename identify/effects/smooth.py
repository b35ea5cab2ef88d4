"""Functions of time over a scan: natural cubic splines, the free form of a drift, and steps."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import expit

from identify.effects.readings import Readings

KNOTS = 5
"""Knots after the first, evenly over the scan: courses no faster than two fifths of it."""


_STEP = 0.03  # of a press's time: a third of the rise of a step
_EDGE = 3  # presses on either side of a step, at least


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
    return _basis()(time / end) @ np.asarray(values, float)


@lru_cache(maxsize=1)
def _basis() -> CubicSpline:
    """One spline a knot after the first: 1 there, 0 at the others."""
    return CubicSpline(np.linspace(0, 1, KNOTS + 1), np.eye(KNOTS + 1)[:, 1:], bc_type="natural")


def step_in_time(readings: Readings, at_s: float) -> np.ndarray:
    """Return a step (m,) from 0 to 1 at an instant of the scan's clock.

    It takes a tenth of the time of a press, so that its instant can be sought.
    """
    width = _STEP * max(float(readings.elapsed_s.max()) / max(readings.presses, 1), 1e-9)
    return expit((readings.elapsed_s - at_s) / width)


def pauses(readings: Readings) -> list[float]:
    """Return the middle of each pause between two presses on the scan's clock, s."""
    first = readings.first[_EDGE : readings.presses - _EDGE + 1]
    return (0.5 * (readings.elapsed_s[first - 1] + readings.elapsed_s[first])).tolist()
