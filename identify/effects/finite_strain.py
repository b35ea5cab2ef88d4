"""Geometry at large depth: the first-order correction to the straight line."""

from __future__ import annotations

import numpy as np

from identify.effects.effect import Effect, EffectParameter, Pressing, Values, WorkedExample
from identify.effects.words import length, percent
from identify.readings import Readings


class FiniteStrain(Effect):
    """F C = d / sqrt(1 - 2 s d / a), solved for d: one term beyond the straight line.

    Geometry brings a term of the order (d / a)^2 of either sign; what it is for a law, a body and a
    tip, only a finite-strain computation tells. This form has that term, is smooth for both signs
    and has no pole in the force. It and `strain_stiffening` begin alike (b / 2 = s); only depths
    of the order of the tip's radius tell them apart.
    """

    name = "finite_strain"
    title = "Large strain (geometry)"
    link = "contact"
    summary = (
        "The tip goes so deep that the body's changing shape matters, and force is no longer "
        "proportional to travel. The correction grows with the depth over the tip's radius."
    )
    formula = "d = u (sqrt(1 + q^2) - q),  q = s u / a,  u = C F:  C F = d (1 + s d / a + ...)"
    source = (
        "J. Bonet, R. D. Wood, Nonlinear Continuum Mechanics for Finite Element Analysis, "
        "Cambridge 2008, ch. 6 (neo-Hookean law); reduced here to its first term in d / a"
    )
    gives_away = "force and travel part from proportion, most so where the tip goes deepest"
    cure = "Press less deep, to a tenth of the tip's radius where noise allows; use a larger tip."
    parameters = (
        EffectParameter(
            "s", "1", "hardening (+) or softening (-) at a depth of a", 0.0, -1.0, 2.0, 0.05
        ),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "a = 5 mm, s = 0.75, u = 5 mm: q = 0.75, sqrt(1.5625) - 0.75 = 0.5, d = 2.5 mm. Back: "
            "2.5 / sqrt(1 - 2 x 0.75 x 0.5) = 5 mm.",
            {"s": 0.75},
            {"force_n": 0.3, "travel_m": 5e-3, "contact_radius_m": 5e-3},
            {"travel_m": 2.5e-3},
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
        """Bend the travel by its depth over the contact radius."""
        q = values["s"] * travel_m / pressing.radius_m
        return travel_m * (np.sqrt(1 + q**2) - q)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much the compliance changes with depth."""
        harder = "less" if values["s"] >= 0 else "more"
        tip = float(np.median(readings.radius_m))
        q = 0.2 * values["s"]
        return (
            "Force and travel are not proportional: the body yields "
            f"{percent(abs(np.sqrt(1 + q * q) - q - 1))} {harder} at a depth of {length(0.2 * tip)}"
            " than at the first touch, and the misfit is largest at the softest places."
        )
