"""Hidden effects of the contact: the elastic travel is not proportional to the force."""

from __future__ import annotations

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import on_contact

SHARES = (0.2, 0.4, 0.6, 0.8, 0.99)
"""Contact radii at which the truth is solved, in units of the tip's radius."""

FLAT_OF_HERTZ = 5 / 6
"""Compliance under a flat punch, of that under Hertz's pressure of the same radius."""


@on_contact("structured", "u (1 + size x (0.076 + 0.08 x)), x = u/a", "size", 1.0, limit=4.0)
def finite_strain(bench, travel_m, values):
    """The deeper the tip, the softer the body, as its shape changes under it.

    A size of 1 is that of neo-Hookean finite elements for a rigid flat tip on a thick block.
    """
    depth = travel_m / bench.program.radius_m[:, None]
    return travel_m * (1 + values["size"] * depth * (0.076 + 0.08 * depth))


@on_contact("structured", "F = a/(b C) (exp(b d/a) - 1), so d = (a/b) ln(1 + b u/a)", "exponent",
            0.1, limit=20.0)  # fmt: skip
def strain_stiffening(bench, travel_m, values):
    """Fung's exponential law, as porcine liver shows it."""
    scale = values["exponent"] / bench.program.radius_m[:, None]
    return np.log1p(scale * travel_m) / scale if values["exponent"] else travel_m


def levelling(x: np.ndarray, share: float, knee: float) -> np.ndarray:
    """Curve of slope 1 at 0 that falls to 1 - share well beyond a knee."""
    return (1 - share) * x + share * knee * np.arctan(x / knee)


STIFFENED = 0.3
"""Depth over radius about which the planted free stiffening sets in."""


@on_contact("structured", "(1 - share) u + share c arctan(u/c), c = 0.3 a", "share", 0.2, limit=0.9)
def free_stiffening(bench, travel_m, values):
    """Tissue that stiffens from a depth on, and then no more."""
    tip = bench.program.radius_m[:, None]
    return tip * levelling(travel_m / tip, values["share"], STIFFENED)


@on_contact("structured", "(1 - share) u + share (F C(a) + m(a))", "share", 0.1, limit=1.0)
def spherical_tip(bench, travel_m, values):
    """The tip is rounded: a share of the travel is that of a sphere, whose contact grows.

    For each force the contact radius minimises the complementary energy
    F^2 C(a)/2 + F m(a), with C(a) under Hertz's pressure from the truth's finite elements and m(a)
    the mean height of the sphere under that pressure (a^2/(5 R) for a << R).
    """
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
    fine = np.linspace(0.01, 0.99, 4000)
    # With s^2 = 1 - r^2/a^2 the pressure has the weight 3 s^2 ds
    s, weight = np.polynomial.legendre.leggauss(40)
    s, weight = (s + 1) / 2, 1.5 * weight * ((s + 1) / 2) ** 2
    below = 1 - np.sqrt(1 - fine[:, None] ** 2 * (1 - s**2))
    mean_height = below @ weight  # in tip radii
    for j, radius in enumerate(tip):
        a = fine * radius
        smooth = np.polynomial.Polynomial.fit(shares[:, j], known[:, j], 3)
        compliance = smooth(fine) / a
        # Stationary: F dC/da / 2 + dm/da = 0 gives the force of each contact radius
        work = mean_height * radius
        force = -2 * np.gradient(work, a) / np.gradient(compliance, a)
        depth = force * compliance + work
        rising = np.append(True, np.diff(np.maximum.accumulate(force)) > 0) & (force > 0)
        force, depth, compliance = force[rising], depth[rising], compliance[rising]
        travel[j] = np.interp(  # Hertz: depth ~ F^(2/3)
            bench.force_n[j] ** (2 / 3), np.append(0.0, force ** (2 / 3)), np.append(0.0, depth)
        )
        # Beyond its equator the tip is a shaft: a contact that grows no more, hence a flat punch's
        travel[j] += FLAT_OF_HERTZ * compliance[-1] * np.maximum(bench.force_n[j] - force[-1], 0)
    return travel
