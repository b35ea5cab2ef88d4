"""Functions of time over a scan: natural cubic splines, the free form of a drift."""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np
from scipy.interpolate import CubicSpline

from identify.effects.readings import Readings

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
