"""The body moves up and down on its own, along a wave of another shape than a sine."""

import numpy as np

from identify.catalogue.breathing import Breathing
from identify.effects.base import EffectParameter, WorkedExample
from identify.effects.readings import Readings

_TONE, _SECOND = Breathing.parameters[:-1], ("in phase", "a quarter ahead")


class BreathingHarmonics(Breathing):
    """A tone and its second harmonic over the whole scan."""

    name = "breathing_harmonics"
    family = "breathing"
    title = "Breathing with a harmonic"
    order = 102
    tones = 2
    highest_hz = 0.6  # of a breath
    summary = (
        "The body rises and falls on its own, along a wave that is not a sine: a breath is short "
        "and its pause long. A tone of twice the frequency goes with the first."
    )
    formula = (
        "d = u + sum over n = 1, 2 of sine_n sin(2 pi n f t) + cosine_n cos(2 pi n f t),  t since "
        "the scan's first reading"
    )
    latex = (
        r"d = u + \sum_{n=1}^{2} \text{sine}_n \sin(2\pi n f t) + \text{cosine}_n "
        r"\cos(2\pi n f t), \quad f = \text{frequency}"
    )
    source = (
        "A. E. Lujan, E. W. Larsen, J. M. Balter, R. K. Ten Haken, Med. Phys. 26 (1999) 715-720 "
        "(a breath is a power of a cosine)"
    )
    gives_away = "the misfit swings with the clock, along a wave with flat or pointed turns"
    parameters = (
        *_TONE,
        *(EffectParameter(f"{p.name[:-2]}2_m", "m", f"of twice the frequency, {part}", 0.0, -0.05,
                          0.05, 1e-4) for p, part in zip(_TONE, _SECOND, strict=True)),
        Breathing.parameters[-1],
    )  # fmt: skip
    examples = (
        WorkedExample(
            "0.1 mm at 0.25 Hz and 0.05 mm of cosine at 0.5 Hz: the second tone turns within a "
            "second.",
            {"sine_m": 1e-4, "cosine_m": 0.0, "sine2_m": 0.0, "cosine2_m": 5e-5,
             "frequency_hz": 0.25},
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
        frequency_hz: float,
    ) -> np.ndarray:
        """Add the motion."""
        return travel_m + self.moved(readings, frequency_hz, (sine_m, cosine_m, sine2_m, cosine2_m))
