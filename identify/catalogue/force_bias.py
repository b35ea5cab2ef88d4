"""A force sensor that does not read zero at no force."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force, more

_PULLS = 0.1  # of the force at first touch: so much less is no rounding of a law
_OF_MEDIAN = 1.86  # standard error of a median, in median deviations over the root of their number
_SURE = 4.0  # standard errors


class ForceBias(Advice, Effect):
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

    def doubt(self, values: Values, readings: Readings) -> str | None:
        """Doubt a bias above what the sensor reads at first touch: the body would pull at the tip.

        A force at which touch is declared looks like one, where a ball's law is not quite right.
        """
        first = readings.force_n[readings.first]
        middle = float(np.median(first))
        error = _OF_MEDIAN * float(np.median(np.abs(first - middle))) / np.sqrt(len(first))
        if values["bias_n"] <= middle + max(_PULLS * abs(middle), _SURE * error):
            return None
        return f"the presses begin at {force(middle)}, so that the body would pull at the tip"

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the reading of the sensor at no force."""
        bias = values["bias_n"]
        return (
            f"The force sensor reads {force(abs(bias))} too {more(bias, 'much', 'little')} in "
            "every reading: lines of travel over force miss the origin, most at soft places."
        )
