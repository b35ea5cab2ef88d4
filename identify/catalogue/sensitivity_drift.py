"""A force sensor whose sensitivity wanders, or a body whose stiffness does."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent, seconds

_MOST = 0.5  # change of the reading over the scan


class SensitivityDrift(Effect):
    """A factor on the force that changes steadily from the scan's first reading on."""

    name = "sensitivity_drift"
    title = "Drift of the sensor's sensitivity, or of the body's stiffness"
    order = 40
    summary = (
        "The sensor reads steadily more or less of the same force, as it does while it warms up, "
        "or the body steadily stiffens or softens as it dries, cools or warms. "
        "Late presses seem stiffer or softer than early ones, by the same share at every force."
    )
    formula = "F = F_read / (1 + rate t),  t since the first reading of the scan"
    latex = r"F = \frac{F_{\text{read}}}{1 + \text{rate} \cdot t}"
    source = (
        "International Vocabulary of Metrology, JCGM 200:2012, 4.12 and 4.21 (sensitivity, "
        "instrumental drift); a body whose modulus goes with 1 + rate t gives the same readings"
    )
    gives_away = "the misfit grows steadily with time, in proportion to the force"
    cure = (
        "Press a spring of known stiffness before and after the scan, which separates the "
        "sensor from the body, and visit the points in random order."
    )
    parameters = (
        EffectParameter("rate_per_s", "1/s", "growth of the reading", 0.0, -1.0, 1.0, 1e-4),
    )
    needs = ("time", "several presses")
    examples = (
        WorkedExample(
            "Over the 100 s from the first reading 5 % more: 0.315 N read are 0.3 N then.",
            {"rate_per_s": 5e-4},
            {"time_s": (7.0, 107.0), "press": (0.0, 1.0), "force_n": 0.315},
            {"force_n": (0.315, 0.3)},
        ),
    )

    def force(self, readings: Readings, force_n: np.ndarray, *, rate_per_s: float) -> np.ndarray:
        """Undo the change of sensitivity."""
        return force_n / (1 + rate_per_s * readings.elapsed_s)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the change over the scan by a half."""
        if readings.time_s is None:
            return self.parameters
        most = _MOST / max(readings.elapsed_s[-1], 1e-3)
        return (replace(self.parameters[0], lower=-most, upper=most, typical=0.06 * most),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much of the reading was gained or lost over the scan."""
        time = float(readings.elapsed_s[-1])
        change = values["rate_per_s"] * time
        way = "more" if change >= 0 else "less"
        return (
            f"The same depth costs steadily {way} force, {percent(abs(change))} {way} after the "
            f"{seconds(time)} of the scan, at every place: the sensor's sensitivity drifts, or the "
            f"body {'stiffens' if change >= 0 else 'softens'}."
        )
