"""A force sensor whose zero changes at one instant."""

import numpy as np

from identify.effects.base import EffectParameter, Values, WorkedExample
from identify.effects.jump import Jump, step_in_time
from identify.effects.readings import Readings
from identify.effects.units import force, more, seconds


class ForceJump(Jump):
    """A step of the zero at one instant of the scan."""

    name = "force_jump"
    family = "force_drift"
    title = "Jump of the force sensor's zero"
    order = 33
    summary = (
        "The sensor was zeroed anew, knocked or overloaded during the scan. All readings after "
        "that instant are off by one force."
    )
    formula = "F = F_read - zero step(t),  step from 0 to 1 at the instant"
    latex = r"F = F_{\text{read}} - \text{zero} \cdot H(t - t_{\text{jump}})"
    source = (
        "International Vocabulary of Metrology, JCGM 200:2012, 2.53 (correction); the step is a "
        "definition"
    )
    gives_away = "from one press on, all readings are off by the same force"
    cure = "Zero the sensor in the air before each press, and note when it was touched."
    parameters = (
        EffectParameter("zero_n", "N", "height of the step", 0.0, -1.0, 1.0, 0.01),
        EffectParameter("at_s", "s", "instant on the scan's clock", None, 0.0, 1e6, 10.0),
    )
    needs = ("time", "several presses")
    examples = (
        WorkedExample(
            "10 mN more after 100 s: 0.31 N read are 0.31 N at the start and 0.3 N after 200 s.",
            {"zero_n": 0.01, "at_s": 100.0},
            {"time_s": (7.0, 207.0), "press": (0.0, 1.0), "force_n": 0.31},
            {"force_n": (0.31, 0.3)},
        ),
    )

    def force(
        self, readings: Readings, force_n: np.ndarray, *, zero_n: float, at_s: float
    ) -> np.ndarray:
        """Take the step off."""
        return force_n - zero_n * step_in_time(readings, at_s)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say when the step came, and how high it is."""
        height = values["zero_n"]
        return (
            f"The force sensor's reading {more(height, 'rises', 'falls')} by {force(abs(height))} "
            f"{seconds(values['at_s'])} after the start of the scan, and stays there."
        )
