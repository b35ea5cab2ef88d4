"""Tissue that grows stiffer as it is strained."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Pressing, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, percent


class StrainStiffening(Effect):
    """Fung's exponential law, written for the travel of a tip.

    Strain under a tip is of the order of depth over radius, so that the law of the material shows
    as one of d / a. Its first term is that of `finite_strain` with s = b / 2: it is the sign that
    tells them apart, as geometry softens bodies that are thick beside the tip.
    """

    name = "strain_stiffening"
    title = "Strain stiffening"
    order = 30
    summary = (
        "The tissue itself grows stiffer with strain, as liver, skin and muscle do. "
        "The force grows exponentially with depth."
    )
    formula = "d = (a / b) ln(1 + b u / a),  u = C F;  that is C F = (a / b) (exp(b d / a) - 1)"
    latex = r"d = \frac{a}{b} \ln\left(1 + \frac{b\,u}{a}\right), \quad u = C F"
    source = "Y. C. Fung, Am. J. Physiol. 213 (1967) 1532-1544"
    gives_away = "each further bit of depth costs more force than the last, most at soft places"
    cure = "Press less deep, use a larger tip, or keep the law and press to several forces."
    parameters = (EffectParameter("b", "1", "exponent at a depth of a", 0.0, 0.0, 20.0, 0.3),)
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "a = 5 mm, b = 1: a linear body would go u = 5 (e - 1) = 8.591 mm deep, this one "
            "goes 5 ln(1 + 1.718) = 5 mm.",
            {"b": 1.0},
            {"force_n": 0.3, "travel_m": 8.591409e-3, "contact_radius_m": 5e-3},
            {"travel_m": 5e-3},
        ),
    )

    def contact(
        self,
        readings: Readings,
        pressing: Pressing,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        b: float,
    ) -> np.ndarray:
        """Bend the travel; on the negative side, noise only, by the first two terms of the law.

        As far as x = -1, and straight beyond: the noise of a press of no resistance stays noise.
        """
        x = b * travel_m / pressing.radius_m
        inward, outward = np.maximum(x, 0.0), np.clip(x, -1.0, 0.0)
        ratio = 1 - outward / 2  # ln(1 + x) / x
        np.divide(np.log1p(inward), inward, out=ratio, where=inward > 1e-8)
        beyond = np.minimum(x + 1.0, 0.0)
        np.divide(2 * beyond - 1.5, x, out=ratio, where=beyond < 0)
        return travel_m * ratio

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much stiffer the body is at depth."""
        tip = float(np.median(readings.radius_m))
        return (
            "The deeper the tip, the more force each further bit of travel costs: "
            f"{percent(np.expm1(0.2 * values['b']))} more at a depth of {length(0.2 * tip)} than "
            "at the first touch, so that soft places are bent most."
        )
