"""Stiffness that changes steadily with depth."""

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent


class StiffnessGradient(Effect):
    """A factor on the modulus, linear in height, one at mid-height."""

    name = "stiffness_gradient"
    title = "Stiffness changing with depth"
    summary = (
        "The body grows stiffer or softer from its base to its top. "
        "With one tip this looks much like a different background."
    )
    formula = "E -> E (1 + gradient (z / height - 1/2)),  z from the base"
    latex = (
        r"E \to E \left(1 + \text{gradient} \left(\frac{z}{\text{height}} - "
        r"\frac{1}{2}\right)\right), \quad z \text{ from the base}"
    )
    source = (
        "A. E. Giannakopoulos, S. Suresh, Int. J. Solids Struct. 34 (1997) 2357-2392 "
        "(indentation of graded solids)"
    )
    gives_away = "wide tips find another stiffness than small ones, everywhere by like amounts"
    cure = "Press with two tips of clearly different radius: the wider one feels deeper."
    parameters = (
        EffectParameter(
            "gradient", "1", "change from base to top over the mean", 0.0, -1.8, 1.8, 0.3
        ),
    )
    examples = (
        WorkedExample(
            "0.4 in a body 48 mm high: 0.8 at the base, 1.2 at the top.",
            {"gradient": 0.4},
            {"point_m": ((0.0, 0.0, 0.0), (0.0, 0.0, 0.048))},
            {"factor": (0.8, 1.2)},
        ),
    )

    def body(self, state: BodyState, *, gradient: float) -> BodyState:
        """Grade the modulus."""
        base, height = state.box_m[0][2], state.height_m

        def graded(points_m: np.ndarray) -> np.ndarray:
            return 1 + gradient * ((points_m[:, 2] - base) / height - 0.5)

        return state.changed(factors=(*state.factors, graded))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much stiffer the top is than the base."""
        stiffer = "stiffer" if values["gradient"] >= 0 else "softer"
        return (
            f"The body is {stiffer} at its top than at its base, by "
            f"{percent(abs(values['gradient']))} of its mean stiffness."
        )
