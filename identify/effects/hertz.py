"""Near travel of a ball, and of the fixed contact of a linear model in its place.

On a half-space of plane modulus E* = E / (1 - nu^2) a fixed contact travels F / (2 E* Re), Re the
radius of a flat tip, 5/6 of that of a Hertz pressure; a ball of radius R travels
(3 F / (4 E*))^(2/3) R^(-1/3). Distant parts (sides, base, inclusions in the depth) feel the force
alone, so that C F - F / (2 E* Re) is the same under both.
Source: K. L. Johnson, Contact Mechanics, Cambridge 1985, sections 3.8 and 4.2.
"""

import numpy as np

from identify.effects.base import Pressing
from identify.effects.readings import Readings

_RIM = {"flat": 1.0, "hertz": 1.2}  # contact radius over that of the flat tip of equal compliance
_SMOOTH = 0.01  # of the press's largest force: below it F^(2/3) is a straight line


def beyond_fixed(readings: Readings, pressing: Pressing, force_n: np.ndarray) -> np.ndarray:
    """Travel (m,) of a ball of the probe's radius beyond that of the model's fixed contact, m.

    F^(2/3) is taken as F (F^2 + s^2)^(-1/6), which is smooth through no force.
    """
    plane = pressing.modulus_pa / (1 - pressing.poisson_ratio**2)
    fixed = force_n / (2 * plane * pressing.radius_m / _RIM[pressing.profile])
    smooth = np.hypot(force_n, _SMOOTH * np.maximum(readings.peak_force_n, 1e-9))
    ball = (0.75 / plane) ** (2 / 3) * readings.radius_m ** (-1 / 3)
    return ball * force_n * smooth ** (-1 / 3) - fixed
