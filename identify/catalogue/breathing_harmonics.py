"""The body moves up and down on its own, along a wave of another shape than a sine."""

import numpy as np

from identify.catalogue.breathing import Breathing
from identify.effects.base import EffectParameter, WorkedExample
from identify.effects.readings import Readings

_SINE, _COSINE, _FREQUENCY = Breathing.parameters
_TIMES = {2: "twice", 3: "three times"}  # the frequency


class BreathingHarmonics(Breathing):
    """A tone and its second and third harmonics over the whole scan."""

    name = "breathing_harmonics"
    family = "breathing"
    title = "Breathing with harmonics"
    order = 102
    tones = 3
    highest_hz = 0.6  # of a breath
    summary = (
        "The body rises and falls on its own, along a wave that is not a sine: a breath is short "
        "and its pause long, or its turns are pointed. Tones of twice and three times the "
        "frequency go with the first."
    )
    formula = (
        "d = u + sum over n = 1, 2, 3 of sine_n sin(2 pi n f t) + cosine_n cos(2 pi n f t),  t "
        "since the scan's first reading"
    )
    latex = (
        r"d = u + \sum_{n=1}^{3} \text{sine}_n \sin(2\pi n f t) + \text{cosine}_n "
        r"\cos(2\pi n f t), \quad f = \text{frequency}"
    )
    source = (
        "A. E. Lujan, E. W. Larsen, J. M. Balter, R. K. Ten Haken, Med. Phys. 26 (1999) 715-720 "
        "(a breath is a power of a cosine)"
    )
    gives_away = "the misfit swings with the clock, along a wave with flat or pointed turns"
    parameters = (
        _SINE,
        _COSINE,
        *(
            EffectParameter(f"{part.name[:-2]}{n}_m", "m", f"of {times} the frequency, {turn}",
                            0.0, -0.05, 0.05, 1e-4)
            for n, times in _TIMES.items()
            for part, turn in ((_SINE, "in phase"), (_COSINE, "a quarter ahead"))
        ),
        _FREQUENCY,
    )  # fmt: skip
    examples = (
        WorkedExample(
            "0.1 mm at 0.25 Hz and 0.05 mm of cosine at 0.5 Hz: the second tone turns within a "
            "second.",
            {"sine_m": 1e-4, "cosine_m": 0.0, "sine2_m": 0.0, "cosine2_m": 5e-5,
             "sine3_m": 0.0, "cosine3_m": 0.0, "frequency_hz": 0.25},
            {"time_s": (5.0, 6.0, 7.0, 8.0), "travel_m": 1e-3},
            {"displacement_m": (1.05e-3, 1.05e-3, 1.05e-3, 0.85e-3)},
        ),
    )  # fmt: skip

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        sine_m: float,
        cosine_m: float,
        sine2_m: float,
        cosine2_m: float,
        sine3_m: float,
        cosine3_m: float,
        frequency_hz: float,
    ) -> np.ndarray:
        """Add the motion."""
        waves = (sine_m, cosine_m, sine2_m, cosine2_m, sine3_m, cosine3_m)
        return travel_m + self.moved(readings, frequency_hz, waves)
