"""First touch declared too early or too late."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, more


class ContactOffset(Effect):
    """A constant in every displacement."""

    name = "contact_offset"
    title = "Offset of first touch"
    order = 60
    summary = (
        "First touch is declared too early or too late, by the same distance in every press. "
        "All displacements are then too large or too small by a constant."
    )
    formula = "d = u + offset"
    latex = r"d = u + \text{offset}"
    source = (
        "D. C. Lin, E. K. Dimitriadis, F. Horkay, J. Biomech. Eng. 129 (2007) 430-440 "
        "(uncertain contact point)"
    )
    gives_away = "lines of travel over force miss the origin, by the same travel everywhere"
    cure = "Find first touch from the force's rise, with a lower threshold and a slower approach."
    parameters = (
        EffectParameter("offset_m", "m", "reported travel at first touch", 0.0, -0.01, 0.01, 1e-4),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "Touch declared 0.1 mm too early, also where no force acts.",
            {"offset_m": 1e-4},
            {"force_n": (0.0, 0.3), "travel_m": (0.0, 3e-3)},
            {"displacement_m": (1e-4, 3.1e-3)},
        ),
    )

    def reading(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, *, offset_m: float
    ) -> np.ndarray:
        """Add the offset."""
        return travel_m + offset_m

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far off first touch is."""
        offset = values["offset_m"]
        return (
            f"Every displacement is {length(abs(offset))} too {more(offset, 'large', 'small')}, at "
            f"all forces and places: first touch is declared too {more(offset, 'early', 'late')}."
        )
