"""A robot, or a body, that moves steadily along the presses while the scan goes on."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, more, seconds


class DisplacementDrift(Effect):
    """A displacement that grows steadily from the scan's first reading on."""

    name = "displacement_drift"
    title = "Drift of the displacement"
    order = 90
    counted_from = "plane"
    summary = (
        "The arm grows as it warms up, or the body settles on its bed, and displacements change "
        "with it. They are too large or too small by a length that grows over the scan."
    )
    formula = "d = u + rate t,  t since the first reading of the scan"
    latex = r"d = u + \text{rate} \cdot t"
    source = (
        "ISO 230-3:2020, Determination of thermal effects; "
        "International Vocabulary of Metrology, JCGM 200:2012, 4.21 (instrumental drift)"
    )
    gives_away = "the misfit grows steadily with time, by the same travel whatever the force"
    cure = "Find first touch anew in each press, and let the arm warm up."
    parameters = (
        EffectParameter("rate_m_per_s", "m/s", "growth of the reading", 0.0, -1e-4, 1e-4, 3e-7),
    )
    needs = ("time", "several presses")
    examples = (
        WorkedExample(
            "1 µm/s over the 100 s from the first reading: 0.1 mm.",
            {"rate_m_per_s": 1e-6},
            {"time_s": (7.0, 107.0), "press": (0.0, 1.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.1e-3)},
        ),
    )

    def reading(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, *, rate_m_per_s: float
    ) -> np.ndarray:
        """Add the drift."""
        return travel_m + rate_m_per_s * readings.elapsed_s

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the displacement went over the scan."""
        rate, time = values["rate_m_per_s"], float(readings.elapsed_s[-1])
        return (
            f"Displacements {more(rate, 'grow', 'shrink')} steadily, by {length(abs(rate) * time)} "
            f"over the {seconds(time)} of the scan, at every force and place."
        )
