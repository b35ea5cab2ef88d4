"""A tip that is rounder than the model takes it for: its contact grows with the force."""

import numpy as np

from identify.effects.base import Advice, Effect, EffectParameter, Pressing, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.sphere import beyond_fixed
from identify.effects.units import length, percent


class SphericalTip(Advice, Effect):
    """Part of the near travel becomes that of Hertz's ball of the probe's radius R.

    On a half-space of plane modulus E* = E / (1 - nu^2) the model's fixed contact travels
    F / (2 E* Re), Re the radius of a flat tip, 5/6 of that of a Hertz pressure; a ball travels
    (3 F / (4 E*))^(2/3) R^(-1/3) (`identify.effects.sphere`). Only this near part of C depends on
    the tip. What the contact's growth changes far from it, and that a ball is no paraboloid (at a
    contact radius of 0.8 R the force is 9 % less), is left out. Between 0 and 1 the share stands
    for tips that are neither: domed, or flat with a rounded rim. Beyond 1 it stands for that growth
    far from the tip, too: 1.6 on a silicone organ pressed by a ball.
    """

    name = "spherical_tip"
    title = "Rounded or spherical tip"
    order = 10
    summary = (
        "The tip is a ball, or domed, and its contact grows with the force, while the model takes "
        "one contact for all forces. It sinks easily at first and ever harder later."
    )
    formula = (
        "d = C F + share ((a/2) L - F / (2 E* Re)),  F = E* ((a^2 + R^2) L / 2 - a R),  "
        "L = ln((R + a)/(R - a)),  E* = E / (1 - nu^2)"
    )
    latex = (
        r"\begin{array}{l} d = C F + \text{share} \left(\frac{a}{2} L "
        r"- \frac{F}{2 E^* R_e}\right) \\ F = E^* \left(\frac{a^2 + R^2}{2} L - a R\right),"
        r"\quad L = \ln\frac{R + a}{R - a} \\ E^* = E / (1 - \nu^2) \end{array}"
    )
    source = (
        "I. N. Sneddon, Int. J. Eng. Sci. 3 (1965) 47; K. L. Johnson, Contact Mechanics, "
        "Cambridge 1985, sections 3.8 and 4.2"
    )
    gives_away = "travel grows less than in proportion to the force, most so at small forces"
    cure = "Use a flat tip, or state tip = 'sphere' in the study; press to several forces."
    parameters = (
        EffectParameter(
            "share", "1", "0: the model's fixed contact, 1: a ball", 0.0, 0.0, 3.0, 0.1
        ),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "Half-space of E = 7.5 kPa, nu = 0.5: E* = 10 kPa. 0.2 N on a flat tip of 5 mm go "
            "0.2 / (2 x 10000 x 0.005) = 2 mm deep; under a ball of 5 mm radius a = 3.786 mm and "
            "L = 1.9794 give F = 10000 ((a^2 + R^2) L / 2 - a R) = 0.2 N, and a L / 2 = 3.747 mm.",
            {"share": 1.0},
            {
                "force_n": 0.2,
                "travel_m": 2e-3,
                "compliance_m_per_n": 0.01,
                "modulus_pa": 7500.0,
                "poisson_ratio": 0.5,
                "radius_m": 5e-3,
                "contact_radius_m": 5e-3,
            },
            {"travel_m": 3.747295e-3},
        ),
        WorkedExample(
            "A body in which 0.5 mm of the 2.5 mm are far from the tip: only the near 2 mm change.",
            {"share": 1.0},
            {
                "force_n": 0.2,
                "travel_m": 2.5e-3,
                "compliance_m_per_n": 0.0125,
                "modulus_pa": 7500.0,
                "poisson_ratio": 0.5,
                "radius_m": 5e-3,
                "contact_radius_m": 5e-3,
            },
            {"travel_m": 4.247295e-3},
        ),
    )

    def contact(
        self,
        readings: Readings,
        pressing: Pressing,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        share: float,
    ) -> np.ndarray:
        """Exchange a share of the near travel."""
        return travel_m + share * beyond_fixed(readings, pressing, force_n)

    def redundant(self, profile: str, nonlinear: bool) -> str | None:
        """Say that a study of a ball has it."""
        return "the study says that the tip is a ball" if profile == "hertz" else None

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the tip is on the way from flat to a ball."""
        radius = float(np.median(readings.radius_m))
        return (
            "The body seems softer to small forces than to large ones, as under a tip that is "
            f"{percent(values['share'])} of the way from the model's fixed contact to a ball of "
            f"{length(radius)} radius (a ball alone yields 2.2 times as easily to a tenth of "
            "the force)."
        )
