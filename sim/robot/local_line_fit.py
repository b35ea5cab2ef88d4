"""A straight line over time with rounded ends: its rate grows and falls at a bounded pace."""

from __future__ import annotations

import math
from dataclasses import dataclass

ROUNDED = 0.1
"""Least part of the duration in each end. Sharper ones would be seen: the contact has a gram of
mass of its own (`contact_coupling`), and a row of the scan stands at the end of the line."""


@dataclass(frozen=True)
class RoundedLine:
    """From 0 to 1 in `duration_s`; the rate rises evenly for `blend_s` and falls as long."""

    duration_s: float
    blend_s: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Return how far it has come and its rate, 1/s."""
        rate = 1 / (self.duration_s - self.blend_s)
        left = self.duration_s - time_s
        if time_s < self.blend_s:
            grown = time_s / self.blend_s
            return rate * grown * time_s / 2, rate * grown
        if left < self.blend_s:
            grown = left / self.blend_s
            return 1 - rate * grown * left / 2, rate * grown
        return rate * (time_s - self.blend_s / 2), rate


def rounded_line(length_m: float, duration_s: float, acceleration: float) -> RoundedLine:
    """Return the line that takes a way in a time: rounded as far as needed, or else longer.

    Parameters
    ----------
    length_m : of the way
    duration_s : wanted
    acceleration : the most that the way may ask for, m/s^2

    Examples
    --------
    >>> line = rounded_line(0.04, 1.0, 0.25)
    >>> round(line.blend_s, 6), line.at(0.5)[0]
    (0.2, 0.5)
    >>> rounded_line(0.04, 0.5, 0.25).duration_s
    0.8
    """
    duration = max(duration_s, 2 * math.sqrt(length_m / acceleration))
    room = max(duration**2 - 4 * length_m / acceleration, 0.0)
    return RoundedLine(duration, max((duration - math.sqrt(room)) / 2, ROUNDED * duration))
