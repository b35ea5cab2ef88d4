"""A force sensor whose zero wanders."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force, more, seconds


class ForceDrift(Effect):
    """A zero that moves steadily from the scan's first reading on."""

    name = "force_drift"
    title = "Drift of the force sensor"
    order = 30
    summary = (
        "The sensor's zero wanders steadily over the scan, as it does while it warms up. "
        "Late presses seem stiffer or softer than early ones."
    )
    formula = "F = F_read - rate t,  t since the first reading of the scan"
    latex = r"F = F_{\text{read}} - \text{rate} \cdot t"
    source = "International Vocabulary of Metrology, JCGM 200:2012, 4.21 (instrumental drift)"
    gives_away = "the misfit grows steadily with time, by the same force whatever the force"
    cure = "Zero the sensor in the air before each press, and let it warm up."
    parameters = (
        EffectParameter("rate_n_per_s", "N/s", "growth of the reading", 0.0, -0.1, 0.1, 3e-5),
    )
    needs = ("time", "several presses")
    examples = (
        WorkedExample(
            "0.1 mN/s over the 100 s from the first reading: 0.3 N read are 0.29 N then.",
            {"rate_n_per_s": 1e-4},
            {"time_s": (7.0, 107.0), "press": (0.0, 1.0), "force_n": 0.3},
            {"force_n": (0.3, 0.29)},
        ),
    )

    def force(self, readings: Readings, force_n: np.ndarray, *, rate_n_per_s: float) -> np.ndarray:
        """Take the drift off."""
        return force_n - rate_n_per_s * readings.elapsed_s

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the rate by the largest force over the scan."""
        if readings.time_s is None:
            return self.parameters
        most = max(readings.largest_force_n, 1e-3) / max(readings.elapsed_s[-1], 1e-3)
        return (replace(self.parameters[0], lower=-most, upper=most, typical=0.03 * most),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the zero went over the scan."""
        rate, time = values["rate_n_per_s"], float(readings.elapsed_s[-1])
        return (
            f"The force sensor's reading {more(rate, 'rises', 'falls')} steadily by "
            f"{force(abs(rate) * time)} over the {seconds(time)} of the scan, at every place."
        )
