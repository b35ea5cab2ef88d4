"""A tip that is rounder than the model takes it for: its contact grows with the force."""

from __future__ import annotations

import numpy as np

from identify.effects.effect import Effect, EffectParameter, Pressing, Values, WorkedExample
from identify.effects.words import percent
from identify.readings import Readings

_RIM = {"flat": 1.0, "hertz": 1.2}  # contact radius over that of the flat tip of equal compliance
_SMOOTH = 0.01  # of the scan's largest force: below it F^(1 - p) is a straight line


class SphericalTip(Effect):
    """Between a flat tip and a ball there are tips of profile r^n / (n R^(n - 1)), n = 2 a ball.

    On a half-space of plane modulus E* = E / (1 - nu^2) such a tip travels, with p = 1 / (n + 1),

        near = f^(1 - p) L^(2 p - 1),  f = F / (2 E* (1 - p)),  L = Re^(1 - 3 p) R^(3 p),

    where lengths are normalised such that p = 1/3 is Hertz's ball of the probe's radius R exactly,
    and p = 0 the fixed contact that the model has: F / (2 E* Re), Re the contact radius of a flat
    tip, 5/6 of it for a Hertz pressure. Only this near part depends on the tip; the rest of C does
    not. It is the half-space's: for a contact that is wide against the body's height the change
    of the far part with the contact radius is left out.
    """

    name = "spherical_tip"
    title = "Rounded or spherical tip"
    link = "contact"
    summary = (
        "The tip is a ball, or domed, and its contact grows with the force, while the model takes "
        "one contact for all forces. It sinks easily at first and ever harder later."
    )
    formula = (
        "d = C F - F / (2 E* Re) + near(F),  near from F / (2 E* Re) for roundness 0 to Hertz's "
        "(3 F / (4 E*))^(2/3) R^(-1/3) for 1"
    )
    source = (
        "K. L. Johnson, Contact Mechanics, Cambridge 1985, eq. 4.22 and 4.23; power-law profiles: "
        "I. N. Sneddon, Int. J. Eng. Sci. 3 (1965) 47-57"
    )
    gives_away = "travel grows with less than the force, the more so the smaller the force"
    cure = "Use a flat tip, or state tip = 'sphere' in the study; press to several forces."
    parameters = (
        EffectParameter(
            "roundness", "1", "0: the model's fixed contact, 1: a ball", 0.0, 0.0, 1.4, 0.2
        ),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "Half-space of E = 7.5 kPa, nu = 0.5: E* = 10 kPa. 0.2 N on a flat tip of 5 mm go "
            "0.2 / (2 x 10000 x 0.005) = 2 mm deep; a ball of 5 mm radius has "
            "a^3 = 3 x 0.2 x 0.005 / (4 x 10000), a = 4.217 mm, and goes a^2 / R = 3.557 mm deep.",
            {"roundness": 1.0},
            {
                "force_n": 0.2,
                "travel_m": 2e-3,
                "compliance_m_per_n": 0.01,
                "modulus_pa": 7500.0,
                "poisson_ratio": 0.5,
                "radius_m": 5e-3,
                "contact_radius_m": 5e-3,
            },
            {"travel_m": 3.55686e-3},
        ),
        WorkedExample(
            "A body in which 0.5 mm of the 2.5 mm are far from the tip: only the near 2 mm change.",
            {"roundness": 1.0},
            {
                "force_n": 0.2,
                "travel_m": 2.5e-3,
                "compliance_m_per_n": 0.0125,
                "modulus_pa": 7500.0,
                "poisson_ratio": 0.5,
                "radius_m": 5e-3,
                "contact_radius_m": 5e-3,
            },
            {"travel_m": 4.05686e-3},
        ),
    )

    def contact(
        self,
        readings: Readings,
        pressing: Pressing,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        values: Values,
    ) -> np.ndarray:
        """Exchange the near part of the travel.

        F^(1 - p) is taken as F (F^2 + s^2)^(-p / 2), which is smooth through no force.
        """
        p = values["roundness"] / 3
        plane = pressing.modulus_pa / (1 - pressing.poisson_ratio**2)
        fixed = pressing.radius_m / _RIM[pressing.profile]
        length = fixed ** (1 - 3 * p) * readings.radius_m ** (3 * p)
        smooth = np.hypot(force_n, _SMOOTH * max(readings.largest_force_n, 1e-9))
        area = 2 * plane * (1 - p) * length**2  # f / L = F / area
        near = length / area * (smooth / area) ** -p * force_n
        return travel_m + (near - force_n / (2 * plane * fixed))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much softer small forces find the body."""
        p = values["roundness"] / 3
        return (
            "The body seems softer to small forces than to large ones, as under a tip that is "
            f"{percent(values['roundness'])} of the way from flat to a ball: close to the tip, a "
            f"tenth of the force finds {percent(10**p - 1)} more compliance."
        )
