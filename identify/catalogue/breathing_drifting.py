"""The body moves up and down on its own, ever faster or ever slower."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.breathing import Breathing, band, free_frequencies
from identify.effects.base import EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, seconds

_STEP = 3.0  # between neighbouring drifts, in 1 / T^2: cosines of 0.93 and more
_MOST = 0.25  # change of the frequency over the scan, as a share
_SHAPES = 4000  # of the grid: a long scan is searched for smaller drifts alone


class BreathingDrifting(Breathing):
    """One tone whose frequency changes evenly over the scan."""

    name = "breathing_drifting"
    family = "breathing"
    title = "Breathing that becomes faster or slower"
    order = 104
    counted_from = ""
    highest_hz = 0.6  # of a breath
    summary = (
        "The body rises and falls on its own, as with breath, and the rhythm changes slowly from "
        "the first press to the last. No single frequency fits the whole scan."
    )
    formula = (
        "d = u + m(t),  m = sine sin(a) + cosine cos(a),  a = 2 pi (f t + drift t^2 / 2);  less "
        "m(t_touch) where travel counts from each touch"
    )
    latex = (
        r"\begin{array}{l} d = u + m(t) - m(t_{\text{touch}}), \quad m = \text{sine} \cdot \sin a "
        r"+ \text{cosine} \cdot \cos a \\ a = 2\pi \left(f t + \tfrac{1}{2} \, \text{drift} \, "
        r"t^2\right) \end{array}"
    )
    gives_away = "the misfit swings with the clock, at the end in another rhythm than at first"
    parameters = (
        *Breathing.parameters[:-1],
        replace(Breathing.parameters[-1], meaning="of the motion, at the scan's start"),
        EffectParameter("drift_hz_per_s", "Hz/s", "change of the frequency", None, -0.01, 0.01,
                        1e-4),
    )  # fmt: skip
    examples = (
        WorkedExample(
            "0.1 mm at 0.25 Hz that gains 0.1 Hz a second: a quarter and a twentieth of a turn "
            "after one second, half and a fifth after two.",
            {"sine_m": 1e-4, "cosine_m": 0.0, "frequency_hz": 0.25, "drift_hz_per_s": 0.1},
            {"time_s": (5.0, 6.0, 7.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.0951057e-3, 0.9048943e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        sine_m: float,
        cosine_m: float,
        frequency_hz: float,
        drift_hz_per_s: float,
    ) -> np.ndarray:
        """Add the motion."""
        waves = (sine_m, cosine_m)
        return travel_m + self.moved(readings, frequency_hz, waves, drift_hz_per_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Frequencies as of `Breathing`, each with drifts to either side."""
        frequency, free = free_frequencies(readings, self.tones)
        time = float(readings.elapsed_s[-1])
        step = _STEP / time**2
        first = frequency[frequency <= self.highest_hz]
        most = min(
            int(_SHAPES // max(2 * len(first), 1)), int(_MOST * self.highest_hz / time / step)
        )
        drift = step * np.delete(np.arange(-most, most + 1), most)
        last = first[:, None] + drift * time
        tested = np.interp(np.maximum(first[:, None], last), frequency, free) > 0.5
        tested |= np.interp(np.minimum(first[:, None], last), frequency, free) > 0.5
        tested &= np.abs(last / first[:, None] - 1) <= _MOST
        return [
            {"frequency_hz": float(first[i]), "drift_hz_per_s": float(drift[k])}
            for i, k in np.argwhere(tested)
        ]

    def doubt(self, values: Values, readings: Readings) -> str | None:
        """Doubt a rhythm that keeps step with the presses from the first to the last."""
        frequency, free = free_frequencies(readings, self.tones)
        ends = _ends(values, readings)
        if np.interp(ends, frequency, free).max() > 0.5:
            return None
        return f"{ends[0]:.3g} Hz keeps step with the presses, whose own course it imitates"

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the drift by half of the frequency over the scan."""
        if readings.time_s is None:
            return self.parameters
        *others, drift = super().bounded(readings, state)
        time = float(readings.elapsed_s[-1])
        most = 0.5 * band(readings)[1] / time
        return *others, replace(drift, lower=-most, upper=most, typical=1 / time**2)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the body moves, and how often at first and at last."""
        size = float(np.hypot(values["sine_m"], values["cosine_m"]))
        first, last = _ends(values, readings)
        return (
            f"Readings swing up and down by {length(size)}, every {seconds(1 / first)} at first "
            f"and every {seconds(1 / last)} at the end, whatever the force."
        )


def _ends(values: Values, readings: Readings) -> tuple[float, float]:
    """Frequency at the scan's start and at its end, Hz."""
    first = values["frequency_hz"]
    last = first + values["drift_hz_per_s"] * float(readings.elapsed_s[-1])
    return first, max(last, 1e-9)
