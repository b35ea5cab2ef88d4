"""The body moves up and down on its own, in a rhythm that changes slowly."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.breathing import Breathing, band, free_frequencies
from identify.effects.base import EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, seconds

_STEP = 3.0  # between neighbouring drifts, in 1 / T^2: cosines of 0.93 and more
_MOST = 0.25  # change of the frequency over the scan, as a share
_SHAPES = 4000  # of the grid: a long scan is searched for smaller drifts alone, one at least
_AROUND = 0.15  # of a frequency: where its larger drifts are sought


class BreathingDrifting(Breathing):
    """One tone whose frequency changes slowly over the scan, as a parabola over time."""

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
        "d = u + m(t),  m = sine sin(a) + cosine cos(a),  a = 2 pi (f t + drift t^2 / 2 + "
        "bend t^3 / 6);  less m(t_touch) where travel counts from each touch"
    )
    latex = (
        r"\begin{array}{l} d = u + m(t) - m(t_{\text{touch}}), \quad m = \text{sine} \cdot \sin a "
        r"+ \text{cosine} \cdot \cos a \\ a = 2\pi \left(f t + \tfrac{1}{2} \, \text{drift} \, "
        r"t^2 + \tfrac{1}{6} \, \text{bend} \, t^3\right) \end{array}"
    )
    gives_away = "the misfit swings with the clock, at the end in another rhythm than at first"
    parameters = (
        *Breathing.parameters[:-1],
        replace(Breathing.parameters[-1], meaning="of the motion, at the scan's start"),
        EffectParameter("drift_hz_per_s", "Hz/s", "change of the frequency, at the scan's start",
                        None, -0.01, 0.01, 1e-4),
        EffectParameter("bend_hz_per_s2", "Hz/s^2", "change of the drift", None, -1e-3, 1e-3, 1e-6),
    )  # fmt: skip
    examples = (
        WorkedExample(
            "0.1 mm at 0.25 Hz that gains 0.1 Hz a second: a quarter and a twentieth of a turn "
            "after one second, half and a fifth after two.",
            {
                "sine_m": 1e-4,
                "cosine_m": 0.0,
                "frequency_hz": 0.25,
                "drift_hz_per_s": 0.1,
                "bend_hz_per_s2": 0.0,
            },
            {"time_s": (5.0, 6.0, 7.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.0951057e-3, 0.9048943e-3)},
        ),
        WorkedExample(
            "0.1 mm at 0.2 Hz whose drift grows by 0.3 Hz/s a second: a fifth and a twentieth of "
            "a turn after one second, two fifths and 8 twentieths after two.",
            {
                "sine_m": 1e-4,
                "cosine_m": 0.0,
                "frequency_hz": 0.2,
                "drift_hz_per_s": 0.0,
                "bend_hz_per_s2": 0.3,
            },
            {"time_s": (5.0, 6.0, 7.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.1e-3, 0.9048943e-3)},
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
        bend_hz_per_s2: float,
    ) -> np.ndarray:
        """Add the motion."""
        course = (frequency_hz, (sine_m, cosine_m), drift_hz_per_s, bend_hz_per_s2)
        return travel_m + self.moved(readings, *course)

    def rhythms(self, readings: Readings) -> list[Values]:
        """Return frequencies as of `Breathing`, each with drifts to either side."""
        frequency, free = free_frequencies(readings, self.tones)
        time = float(readings.elapsed_s[-1])
        step = _STEP / time**2
        first = frequency[frequency <= self.highest_hz]
        few = max(int(_SHAPES // max(2 * len(first), 1)), 1)
        most = min(few, int(_MOST * self.highest_hz / time / step))
        drift = step * np.delete(np.arange(-most, most + 1), most)
        last = first[:, None] + drift * time
        tested = np.interp(np.maximum(first[:, None], last), frequency, free) > 0.5
        tested |= np.interp(np.minimum(first[:, None], last), frequency, free) > 0.5
        tested &= np.abs(last / first[:, None] - 1) <= _MOST
        return [
            {"frequency_hz": float(first[i]), "drift_hz_per_s": float(drift[k]),
             "bend_hz_per_s2": 0.0}
            for i, k in np.argwhere(tested)
        ]  # fmt: skip

    def around(self, shape: Values, readings: Readings) -> list[Values]:
        """Return all drifts of frequencies near the one that the scan has in its middle."""
        frequency, free = free_frequencies(readings, self.tones)
        time = float(readings.elapsed_s[-1])
        middle = shape["frequency_hz"] + shape["drift_hz_per_s"] * time / 2
        near = frequency[free & (np.abs(frequency / middle - 1) < _AROUND)]
        most = int(_MOST * middle * time / _STEP)
        return [
            {"frequency_hz": float(f - drift * time / 2), "drift_hz_per_s": float(drift),
             "bend_hz_per_s2": 0.0}
            for f in near
            for drift in _STEP / time**2 * np.arange(-most, most + 1)
            if f > abs(drift) * time / 2
        ]  # fmt: skip

    def doubt(self, values: Values, readings: Readings) -> str | None:
        """Doubt a rhythm that keeps step with the presses from the first to the last."""
        frequency, free = free_frequencies(readings, self.tones)
        ends = _ends(values, readings)
        if np.interp(ends, frequency, free).max() > 0.5:
            return None
        return f"{ends[0]:.3g} Hz keeps step with the presses, whose own course it imitates"

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound drift and bend by the frequency over the length of the scan."""
        if readings.time_s is None:
            return self.parameters
        *others, drift, bend = super().bounded(readings, state)
        time = float(readings.elapsed_s[-1])
        most = 0.5 * band(readings)[1] / time
        return (
            *others,
            replace(drift, lower=-2 * most, upper=2 * most, typical=1 / time**2),
            replace(bend, lower=-4 * most / time, upper=4 * most / time, typical=6 / time**3),
        )

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
    time = float(readings.elapsed_s[-1])
    last = first + time * (values["drift_hz_per_s"] + time * values["bend_hz_per_s2"] / 2)
    return first, max(last, 1e-9)
