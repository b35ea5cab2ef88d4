"""Force and depth of one press: a curve through solutions of the finite elements.

A tip whose contact grows is a series of flat punches: while the force rises by dF at a contact
radius a, the tip sinks by C(a) dF, C being the compliance of a flat punch of that radius on this
body (Mossakovskii 1963, Jaeger 1995; on a half-space that is Hertz's and Sneddon's solution, on any
other body it is the best pressure among sums of punches). With the mean gap g(a) between tip and
surface under the punch's pressure,

    F(a) = -g'(a) / C'(a),        depth(a) = C(a) F(a) + g(a),        d depth/dF = C(a).

The compliance is solved at three radii and interpolated as C = 1/(2 E* a) + c1 + c2 a + c3 a^2,
whose first term is exact for a small contact. The surface's own curvature adds to the gap.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.motion.tip import Tip

SOLVED = (0.5, 1.0, 1.4)
"""Radii at which a punch is solved, in parts of that at the set force on a half-space."""

HERTZ_WIDTH = 1.2
"""Radius of the Hertz pressure that is as compliant as a flat punch, in radii of the punch."""

LEAST, POINTS = 0.01, 300
"""Of a curve with growing contact: first radius, in parts of the last one, and number of points."""

_S, _W = np.polynomial.legendre.leggauss(24)
_S, _W = (_S + 1) / 2, _W / 2  # a flat punch has even weight in s = sqrt(1 - r^2/a^2)


@dataclass(frozen=True)
class LawCurve:
    """Depth over force, by cubic pieces that hold depth and compliance; straight beyond the ends.

    Attributes
    ----------
    force_n, depth_m, compliance_m_per_n : (p,) rising
    """

    force_n: np.ndarray
    depth_m: np.ndarray
    compliance_m_per_n: np.ndarray

    @classmethod
    def line(cls, compliance_m_per_n: float) -> LawCurve:
        """Return the law of a linear body under a fixed contact."""
        force = np.array([0.0, 1.0])
        return cls(force, compliance_m_per_n * force, np.full(2, compliance_m_per_n))

    def at(self, force_n: float) -> tuple[float, float]:
        """Return depth and compliance at a force."""
        force, depth, slope = self.force_n, self.depth_m, self.compliance_m_per_n
        if force_n >= force[-1]:
            return float(depth[-1] + slope[-1] * (force_n - force[-1])), float(slope[-1])
        if force_n <= force[0]:
            return float(depth[0] + slope[0] * (force_n - force[0])), float(slope[0])
        i = int(force.searchsorted(force_n, "right")) - 1
        width = force[i + 1] - force[i]
        t = (force_n - force[i]) / width
        rise = depth[i + 1] - depth[i]
        first, second = slope[i] * width, slope[i + 1] * width
        c2, c3 = 3 * rise - 2 * first - second, first + second - 2 * rise
        found = depth[i] + t * (first + t * (c2 + t * c3))
        tangent = (first + t * (2 * c2 + 3 * t * c3)) / width
        return float(found), float(tangent)


def solved_radii(tip: Tip, force_n: float, plane_modulus_pa: float) -> np.ndarray:
    """Radii at which the punches of a growing contact are solved, (3,) m.

    Parameters
    ----------
    force_n : set force
    plane_modulus_pa : E / (1 - nu^2) at the contact point
    """
    expected = (3 * force_n * tip.radius_m / (4 * plane_modulus_pa)) ** (1 / 3)
    if tip.kind == "cone":  # Sneddon: F = 2/pi E* cot(angle) a^2, d depth... with its own slope
        slope = 1 / np.tan(np.radians(tip.angle_deg))
        expected = max(expected, float(np.sqrt(2 * force_n / (np.pi * plane_modulus_pa * slope))))
    # No wider than the ball itself, for which its place on the body was planned
    widest = min(tip.widest_m, tip.radius_m / HERTZ_WIDTH) if tip.kind == "ball" else tip.widest_m
    expected = min(expected, widest / SOLVED[-1])
    return expected * np.array(SOLVED)


def growing_contact(
    tip: Tip,
    radii_m: np.ndarray,
    compliance: np.ndarray,
    plane_modulus_pa: float,
    bend_per_m: float = 0.0,
) -> LawCurve:
    """Return the law of a tip whose contact grows.

    Parameters
    ----------
    tip : ball or cone
    radii_m, compliance : (3,) of flat punches on this body, m and m/N
    plane_modulus_pa : E / (1 - nu^2) at the contact point
    bend_per_m : mean curvature of the surface under the tip, positive where it is convex
    """
    near = 1 / (2 * plane_modulus_pa)
    scaled = radii_m / radii_m[-1]
    columns = np.column_stack([np.ones(3), scaled, scaled**2])
    c1, c2, c3 = np.linalg.solve(columns, compliance - near / radii_m)
    c2, c3 = c2 / radii_m[-1], c3 / radii_m[-1] ** 2
    largest = min(1.3 * radii_m[-1], tip.widest_m)
    a = np.geomspace(LEAST * largest, largest, POINTS)
    share = np.sqrt(1 - _S**2)
    r = a[:, None] * share
    gap = (tip.gap_m(r) + bend_per_m * r**2 / 2) @ _W
    by_radius = ((tip.slope(r) + bend_per_m * r) * share) @ _W
    punch = near / a + c1 + c2 * a + c3 * a**2
    force = by_radius / (near / a**2 - c2 - 2 * c3 * a)
    depth = punch * force + gap
    rising = np.r_[True, (np.diff(np.maximum.accumulate(force)) > 0) & (np.diff(depth) > 0)]
    rising &= (force > 0) & (punch > 0)
    force, depth, punch = force[rising], depth[rising], punch[rising]
    return LawCurve(np.r_[0.0, force], np.r_[0.0, depth], np.r_[1.5 * depth[0] / force[0], punch])


@dataclass(frozen=True)
class Creep:
    """Creep in proportion to the travel: after a step of force the depth grows to 1 + sum(shares).

    Attributes
    ----------
    shares : (n,) of the immediate travel
    times_s : (n,) of retardation
    """

    shares: tuple[float, ...]
    times_s: tuple[float, ...]
