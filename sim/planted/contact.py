"""Hidden effects of the contact: the elastic travel is not proportional to the force."""

from __future__ import annotations

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect

SHARES = (0.25, 0.45, 0.7, 1.0, 1.5)
"""Contact radii at which the truth is solved, in units of the tip's radius."""


class FiniteStrain(HiddenEffect):
    """The deeper the tip, the softer the body, as its shape changes under it.

    A size of 1 is what neo-Hookean finite elements give for a rigid flat tip on a thick block.
    """

    name, category = "finite_strain", "structured"
    law = "u (1 + size x (0.076 + 0.08 x)), x = u/a"
    amplitude, typical, limit = "size", 1.0, 4.0

    def contact(self, bench, travel_m, values):
        """Lengthen the deep travels."""
        depth = travel_m / bench.program.radius_m[:, None]
        return travel_m * (1 + values["size"] * depth * (0.076 + 0.08 * depth))


class StrainStiffening(HiddenEffect):
    """Fung's exponential law, as porcine liver shows it."""

    name, category = "strain_stiffening", "structured"
    law = "F = a/(b C) (exp(b d/a) - 1), so d = (a/b) ln(1 + b u/a)"
    amplitude, typical, limit = "exponent", 0.1, 20.0

    def contact(self, bench, travel_m, values):
        """Solve the law for the travel."""
        scale = values["exponent"] / bench.program.radius_m[:, None]
        return np.log1p(scale * travel_m) / scale if values["exponent"] else travel_m


class SphericalTip(HiddenEffect):
    """The tip is rounded: a share of the travel is that of a sphere, whose contact grows.

    For each force the contact radius minimises the complementary energy
    F^2 C(a)/2 + F a^2/(5 R) with C(a) under Hertz's pressure from the truth's finite elements.
    """

    name, category = "spherical_tip", "structured"
    law = "(1 - share) u + share (F C(a) + a^2/(5 R))"
    amplitude, typical, limit = "share", 0.1, 1.0

    def contact(self, bench, travel_m, values):
        """Mix the sphere's travel in."""
        share = values["share"]
        return (1 - share) * travel_m + share * sphere_travel(bench)


def sphere_travel(bench: Bench) -> np.ndarray:
    """Travel of a sphere with the tip's radius, (j, t) m, for the bench's forces."""
    tip = bench.program.radius_m
    edges = np.array(bench.body.size_m[:2])
    room = np.minimum(bench.points_m, edges - bench.points_m).min(axis=1)
    radii = [np.minimum(share * tip, 0.98 * room) for share in SHARES]
    # C a hardly varies with a (on a half-space it is a constant)
    known = np.array([bench.compliance(radius, "hertz") * radius for radius in radii])
    shares = np.array(radii) / tip
    travel = np.empty_like(bench.force_n)
    fine = np.linspace(0.01, 2.0, 4000)
    for j, radius in enumerate(tip):
        a = fine * radius
        smooth = np.polynomial.Polynomial.fit(shares[:, j], known[:, j], 3)
        compliance = smooth(fine) / a
        # Stationary: F dC/da / 2 + 2 a/(5 R) = 0 gives the force of each contact radius
        force = -4 * a / (5 * radius) / np.gradient(compliance, a)
        depth = force * compliance + a**2 / (5 * radius)
        rising = np.append(True, np.diff(np.maximum.accumulate(force)) > 0) & (force > 0)
        travel[j] = np.interp(  # Hertz: depth ~ F^(2/3)
            bench.force_n[j] ** (2 / 3),
            np.append(0.0, force[rising] ** (2 / 3)),
            np.append(0.0, depth[rising]),
        )
    return travel
