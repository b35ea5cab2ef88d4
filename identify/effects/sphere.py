r"""Travel of a ball, whose contact grows with the force, by the compliance of a fixed contact.

`ball_travel` takes the compliance C and its growth g = (a_0/C) dC/da_0 under a Hertz pressure of
radius a_0 on this body. A flat punch of five sixths of that radius is as compliant; between it and
the smallest contacts, which feel the half-space at the contact point, the punch of radius a has

    S(a) = 2 E* a exp(x t + y t^2),   t = a / (5/6 a_0),
    x + y = ln(0.6/(E* a_0 C)),   x + 2 y = -1 - g.

While the force rises by dF the ball sinks by dF/S(a), as a series of punches (Mossakovskii 1963,
Jaeger 1995), so that with the mean gap h(a) between ball and surface under a punch's pressure

    F = h' S^2/S',   d = F/S + h,   h = R/2 - (R^2 - a^2)/(2 a) artanh(a/R) + c a^2/3,

c the mean curvature of the body's surface. On a half-space that is Sneddon's solution. Against the
exact contact of a bonded layer (nu = 0.45, R = 3.16 mm, contacts up to 0.8 R, a_0 = 0.6 R) the
travel is right to 0.03 % on 10 mm, 0.15 % on 6 mm, 0.5 % on 4 mm, 1.3 % on 2 mm.

`beyond_fixed` knows a half-space alone:

On a half-space of plane modulus E* = E / (1 - nu^2) a fixed contact travels F / (2 E* Re), Re the
radius of a flat tip, 5/6 of that of a Hertz pressure. A rigid ball of radius R whose contact has
the radius a feels and travels

    F = E* ((a^2 + R^2)/2 ln((R + a)/(R - a)) - a R),    d = (a/2) ln((R + a)/(R - a)),

for a << R Hertz's (3 F / (4 E*))^(2/3) R^(-1/3), which is 3 % less at d = 0.4 R and 6 % at
d = 0.9 R. Distant parts (sides, base, inclusions in the depth) feel the force alone, so that
C F - F / (2 E* Re) is the same under both: right to 0.01 % on the layer of 30 mm, 0.5 % on 10 mm,
2.4 % on 6 mm.
Sources: I. N. Sneddon, Int. J. Eng. Sci. 3 (1965) 47; K. L. Johnson, Contact Mechanics, Cambridge
1985, sections 3.8 and 4.2.
"""

from functools import cache
from typing import NamedTuple

import numba
import numpy as np
from scipy.interpolate import CubicSpline

from identify.effects.base import Pressing
from identify.effects.readings import Readings

_RIM = {"flat": 1.0, "hertz": 1.2}  # contact radius over that of the flat tip of equal compliance
_SMOOTH = 0.01  # of the press's largest force: below it F^(2/3) is a straight line
_DEEPEST = 0.9999  # contact radius, of the ball's, up to which the contact grows
_HOLLOW = -0.8  # least curvature of the surface, of the ball's: in a closer one it would not fit
_STIFFENS = 0.1  # least growth of a punch's stiffness with its radius, in logarithms
_ROUNDS, _SETTLED = 15, 1e-5  # steps towards the radius, and the last one's logarithm
_SERIES = 0.02  # contact radius, of the ball's, below which the gap is a series


class ElasticTravel(NamedTuple):
    """Elastic travel of a tip, and how it changes.

    Attributes
    ----------
    travel_m : (m,)
    by_force : (m,) its derivative by the force, m/N
    by_log_compliance : (m,) by ln C of a body that is softer everywhere alike (E ~ 1/C), m
    """

    travel_m: np.ndarray
    by_force: np.ndarray
    by_log_compliance: np.ndarray


def ball_travel(readings: Readings, pressing: Pressing, force_n: np.ndarray) -> ElasticTravel:
    """Travel of a ball of the probe's radius.

    Through no force it is smooth: d(s) F/s with s the force beside a hundredth of the largest.
    """
    plane = pressing.modulus_pa / (1 - pressing.poisson_ratio**2)
    ball = readings.radius_m
    unit = pressing.radius_m / _RIM["hertz"]
    stiffer = 0.6 / (plane * pressing.radius_m * pressing.compliance_m_per_n)
    level = np.log(stiffer)
    # Without a growth, what is distant feels the force alone: C less the half-space's is constant
    slope = stiffer - 1 if pressing.growth is None else -1 - pressing.growth
    bent = slope - level
    curvature = np.maximum(pressing.curvature_per_m * ball, _HOLLOW)
    first, bent = (level - bent) / unit, bent / unit**2
    smooth = np.hypot(force_n, _SMOOTH * np.maximum(readings.peak_force_n, 1e-9))
    law = np.array(np.broadcast_arrays(smooth, plane, ball, curvature, first, bent), order="F")
    deep, steep = _travels(law)
    share = force_n / smooth
    by_force = steep * share**2 + deep / smooth * (1 - share**2)
    return ElasticTravel(deep * share, by_force, steep * force_n)


@numba.njit(cache=True, nogil=True, error_model="numpy", parallel=True)
def _travels(law):
    """Travel (m,) m under forces and its slope (m,) m/N, by the rows of `law`: see `_travel`."""
    travel, slope = np.empty(law.shape[1]), np.empty(law.shape[1])
    for i in numba.prange(law.shape[1]):
        travel[i], slope[i] = _travel(
            law[0, i], law[1, i], law[2, i], law[3, i], law[4, i], law[5, i]
        )
    return travel, slope


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _travel(force, plane, ball, curvature, first, bent):
    """Travel of a ball under a positive force, and its slope by the force.

    A punch is as stiff as 2 `plane` a exp(`first` a + `bent` a^2). At the true radius the travel is
    stationary: an error of it counts by its square. Near the equator, where the contact has ended,
    the tip is as a cylinder.
    """
    end = np.log(_DEEPEST * ball)
    hertz = np.cbrt(0.75 * force * ball / plane / (1 + curvature))
    log_a = np.log(min(hertz, 0.9 * ball))
    low, high = -np.inf, end  # between which the force is reached
    steep = 1.0
    for _ in range(_ROUNDS):
        found, steep = _under(np.exp(log_a), plane, ball, curvature, first, bent)
        step = np.log(force / found) / steep
        if step > 0:
            low = log_a
        else:
            high = log_a
        after = min(log_a + step, end)
        if not low <= after <= high:
            after = (low + high) / 2
        moved, log_a = abs(after - log_a), after
        if moved < _SETTLED:
            break
    a = np.exp(log_a)
    stiffness = 2 * plane * a * np.exp(a * (first + bent * a))
    travel = force / stiffness + ball * _gap(a / ball) + curvature * a**2 / (3 * ball)
    slope, grown = 1 / stiffness, 1 + a * (first + 2 * bent * a)
    if grown < _STIFFENS and log_a < end:  # there the travel is not stationary
        gap = _gap_slopes(a / ball)[0] + 2 / 3 * curvature * a / ball
        slope += (gap - force / stiffness * grown / a) * a / (force * steep)
    return travel, slope


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _under(a, plane, ball, curvature, first, bent):
    """Force at a contact radius, and the slope of its logarithm by that of the radius."""
    share = a / ball
    own = 2 / 3 * curvature
    slope, bend = _gap_slopes(share)
    slope, bend = slope + own * share, bend + own
    linear, square = first * a, bent * a**2
    grown, more = 1 + linear + 2 * square, linear + 4 * square
    if grown <= _STIFFENS:
        grown, more = _STIFFENS, 0.0
    steep = share * bend / slope + 1 + grown - more / grown
    return 2 * plane * slope * a**2 * np.exp(linear + square) / grown, max(steep, 1.0)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gap(share):
    """Return the mean gap h/R under a punch, by a/R, without the body's curvature."""
    square = share**2
    if share < _SERIES:
        return square * (1 / 3 + square / 15)
    return 0.5 - (1 - square) / (2 * share) * np.arctanh(share)


@numba.njit(cache=True, nogil=True, error_model="numpy")
def _gap_slopes(share):
    """Return the first and second derivative of `_gap`."""
    square = share**2
    if share < _SERIES:
        bend = 2 / 3 + square * (4 / 5 + square * 6 / 7)
        return share * (2 / 3 + square * (4 / 15 + square * 6 / 35)), bend
    angle = np.arctanh(share)
    bend = (share + (1 + square) * share / (1 - square) - 2 * angle) / (2 * square * share)
    return ((1 + square) * angle - share) / (2 * square), bend


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
