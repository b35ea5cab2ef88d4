"""Near travel of a ball, and of the fixed contact of a linear model in its place.

On a half-space of plane modulus E* = E / (1 - nu^2) a fixed contact travels F / (2 E* Re), Re the
radius of a flat tip, 5/6 of that of a Hertz pressure. A rigid ball of radius R whose contact has
the radius a feels and travels

    F = E* ((a^2 + R^2)/2 ln((R + a)/(R - a)) - a R),    d = (a/2) ln((R + a)/(R - a)),

for a << R Hertz's (3 F / (4 E*))^(2/3) R^(-1/3), which is 3 % less at d = 0.4 R and 6 % at
d = 0.9 R. Distant parts (sides, base, inclusions in the depth) feel the force alone, so that
C F - F / (2 E* Re) is the same under both. Against the exact contact of a bonded layer (nu = 0.45,
R = 3.16 mm, up to a = 0.8 R) the travel is right to 0.01 % on 30 mm, 0.5 % on 10 mm, 2.4 % on 6 mm:
on a thinner body the growth of the contact changes its distant part too.
Sources: I. N. Sneddon, Int. J. Eng. Sci. 3 (1965) 47; K. L. Johnson, Contact Mechanics, Cambridge
1985, sections 3.8 and 4.2.
"""

from functools import cache

import numpy as np
from scipy.interpolate import CubicSpline

from identify.effects.base import Pressing
from identify.effects.readings import Readings

_RIM = {"flat": 1.0, "hertz": 1.2}  # contact radius over that of the flat tip of equal compliance
_SMOOTH = 0.01  # of the press's largest force: below it F^(2/3) is a straight line
_DEEPEST = 0.9999  # contact radius, of the ball's, up to which the relation is tabulated


def beyond_fixed(readings: Readings, pressing: Pressing, force_n: np.ndarray) -> np.ndarray:
    """Travel (m,) of a ball of the probe's radius beyond that of the model's fixed contact, m.

    F^(2/3) is taken as F (F^2 + s^2)^(-1/6), which is smooth through no force.
    """
    plane = pressing.modulus_pa / (1 - pressing.poisson_ratio**2)
    fixed = force_n / (2 * plane * pressing.radius_m / _RIM[pressing.profile])
    smooth = np.hypot(force_n, _SMOOTH * np.maximum(readings.peak_force_n, 1e-9))
    ball = (0.75 / plane) ** (2 / 3) * readings.radius_m ** (-1 / 3)
    over_hertz = depth_over_hertz(smooth / (plane * readings.radius_m**2))
    return ball * over_hertz * force_n * smooth ** (-1 / 3) - fixed


def depth_over_hertz(load: np.ndarray) -> np.ndarray:
    """Depth (m,) of a ball over that of Hertz's paraboloid under the same force.

    Parameters
    ----------
    load : (m,) F / (E* R^2), not negative

    >>> depth_over_hertz(np.array([0.0, 1e-3, 1.0])).round(4).tolist()
    [1.0, 1.0006, 1.0634]
    """
    table, end, depth = _table()
    root = np.cbrt(load)
    inside = table(np.minimum(root, end))
    # Near the equator the force grows by 2 a unit of depth, in radii, as a tip that is a cylinder
    beyond = depth + (load - end**3) / 2
    return np.where(root <= end, inside, beyond / np.maximum(0.75 * load, 1e-30) ** (2 / 3))


@cache
def _table() -> tuple[CubicSpline, float, float]:
    """Depth over Hertz's by the cube root of the load; its end, and the depth there in radii."""
    angle = np.linspace(0, np.arctanh(_DEEPEST), 4000)[1:]
    a = np.tanh(angle)
    load, depth = (a * a + 1) * angle - a, a * angle
    ratio = depth / (0.75 * load) ** (2 / 3)
    ratio = np.where(a < 1e-2, 1 + a**2 / 15, ratio)  # else a difference of near equal numbers
    root = np.cbrt(load)
    spline = CubicSpline(np.append(0.0, root), np.append(1.0, ratio))
    return spline, float(root[-1]), float(depth[-1])
