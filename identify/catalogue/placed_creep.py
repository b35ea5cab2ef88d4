"""Common parts of the forms of creep that act at some places only."""

from dataclasses import replace

import numpy as np

from identify.catalogue.viscoelasticity import time_constants
from identify.effects.base import Effect, EffectParameter
from identify.effects.readings import Readings

_TIMES = 4  # time constants of a grid


class PlacedCreep(Effect):
    """Linear creep with one relaxation time at some places of the pressed surface."""

    cure = "Hold each press for several time constants and take the last readings."
    needs = ("time", "several presses")
    contains = ("viscoelasticity",)

    def untestable(self, readings: Readings) -> str | None:
        """Name the lack of the scan for placing the creep."""
        lacking = super().untestable(readings)
        low, high = surface(readings)
        return lacking or ("all presses are at one line" if min(high - low) <= 0 else None)


def few_times(readings: Readings) -> list[float]:
    """Return few time constants for a grid, within those that the scan can show, s."""
    return np.geomspace(*time_constants(readings), _TIMES + 2)[1:-1].tolist()


def within_scan(tau: EffectParameter, readings: Readings) -> EffectParameter:
    """Return the time constant's parameter, bounded by the timing of the scan."""
    shortest, longest = time_constants(readings)
    return replace(tau, lower=shortest / 2, upper=2 * longest)


def surface(readings: Readings) -> tuple[np.ndarray, np.ndarray]:
    """Return the lower and the upper corner, (2,) m each, of the pressed surface."""
    points = readings.point_m[:, :2]
    return points.min(axis=0), points.max(axis=0)
