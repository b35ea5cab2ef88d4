"""A force sensor that does not read zero at no force."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force, more


class ForceBias(Effect):
    """A constant that the sensor reads too much."""

    name = "force_bias"
    title = "Bias of the force sensor"
    order = 20
    summary = (
        "The force sensor reads a constant too much or too little. "
        "Travel is then missing or left over at small forces, most at soft places."
    )
    formula = "F = F_read - bias"
    latex = r"F = F_{\text{read}} - \text{bias}"
    source = "International Vocabulary of Metrology, JCGM 200:2012, 4.20 (instrumental bias)"
    gives_away = "lines of travel over force miss the origin, the softer the place the further"
    cure = "Zero the sensor in the air before each press."
    parameters = (
        EffectParameter("bias_n", "N", "constant excess of the reading", 0.0, -10.0, 10.0, 0.01),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "0.3 N read, of which 0.02 N are bias.",
            {"bias_n": 0.02},
            {"force_n": (0.3, 0.02)},
            {"force_n": (0.28, 0.0)},
        ),
    )

    def force(self, readings: Readings, force_n: np.ndarray, *, bias_n: float) -> np.ndarray:
        """Take the bias off."""
        return force_n - bias_n

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the bias by the largest force."""
        most = max(readings.largest_force_n, 1e-3)
        return (replace(self.parameters[0], lower=-most, upper=most, typical=0.03 * most),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the reading of the sensor at no force."""
        bias = values["bias_n"]
        return (
            f"The force sensor reads {force(abs(bias))} too {more(bias, 'much', 'little')} in "
            "every reading: lines of travel over force miss the origin, most at soft places."
        )
