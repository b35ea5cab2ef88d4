"""The quintic blend: from 0 to 1 with no speed and no acceleration at either end."""

from sim.robot.compiled import compiled

PEAK_SPEED = 15 / 8
"""Largest rate of the blend over its mean rate."""

PEAK_ACCELERATION = 10 / 3**0.5
"""Largest acceleration of the blend, for a duration of 1 s."""


@compiled
def blend(s: float, duration_s: float) -> tuple[float, float, float]:
    """Return how much of the way is gone at a part `s` of it in time, its rate and acceleration."""
    position = s**3 * (10 - 15 * s + 6 * s * s)
    velocity = 30 * s * s * (1 - s) ** 2 / duration_s
    acceleration = 60 * s * (1 - s) * (1 - 2 * s) / duration_s**2
    return position, velocity, acceleration
