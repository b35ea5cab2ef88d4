"""A robot or a body that is knocked at one instant."""

import numpy as np

from identify.effects.base import EffectParameter, Values, WorkedExample
from identify.effects.jump import Jump, step_in_time
from identify.effects.readings import Readings
from identify.effects.units import length, more, seconds


class DisplacementJump(Jump):
    """A step of the displacement at one instant of the scan."""

    name = "displacement_jump"
    family = "displacement_drift"
    title = "Jump of the displacement's zero"
    order = 92
    counted_from = "plane"
    summary = (
        "The body, the arm or its table was knocked or set anew during the scan. All displacements "
        "after that instant are off by one length, as they count from the planned surface."
    )
    formula = "d = u + height step(t),  step from 0 to 1 at the instant"
    latex = r"d = u + \text{height} \cdot H(t - t_{\text{jump}})"
    source = (
        "International Vocabulary of Metrology, JCGM 200:2012, 2.53 (correction); the step is a "
        "definition"
    )
    gives_away = "from one press on, all readings are off by the same length"
    cure = "Find first touch anew in each press, and note when the rig was touched."
    parameters = (
        EffectParameter("height_m", "m", "height of the step", 0.0, -0.05, 0.05, 1e-4),
        EffectParameter("at_s", "s", "instant on the scan's clock", None, 0.0, 1e6, 10.0),
    )
    needs = ("time", "several presses")
    examples = (
        WorkedExample(
            "0.1 mm more after 100 s.",
            {"height_m": 1e-4, "at_s": 100.0},
            {"time_s": (7.0, 207.0), "press": (0.0, 1.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.1e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        height_m: float,
        at_s: float,
    ) -> np.ndarray:
        """Add the step."""
        return travel_m + height_m * step_in_time(readings, at_s)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say when the step came, and how high it is."""
        height = values["height_m"]
        return (
            f"The displacement {more(height, 'rises', 'falls')} by {length(abs(height))} "
            f"{seconds(values['at_s'])} after the start of the scan, and stays there."
        )
