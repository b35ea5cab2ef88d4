"""A loop between loading and unloading that does not depend on the speed."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent


class Hysteresis(Effect):
    """More travel at the same force on the way back."""

    name = "hysteresis"
    title = "Hysteresis"
    order = 30
    summary = (
        "On the way back the tip is deeper than on the way in at the same force. "
        "The loop closes at the largest force and at none, and does not depend on the speed."
    )
    formula = "d = u (1 + 4 h (1 - F / Fmax)) while unloading;  widest, h C Fmax, at Fmax / 2"
    latex = (
        r"d = u \left(1 + 4 h \left(1 - \frac{F}{F_{\max}}\right)\right) \quad \text{while "
        r"unloading}"
    )
    source = (
        "Y. C. Fung, Biomechanics: Mechanical Properties of Living Tissues, Springer 1993, ch. 7 "
        "(loops nearly independent of the rate); the parabola is the simplest loop that closes"
    )
    gives_away = "loading and unloading part at equal force, most at half of the largest force"
    cure = "Take the loading branch only, or unload as slowly as you load and fit both."
    parameters = (
        EffectParameter("h", "1", "width of the loop over the largest travel", 0.0, 0.0, 0.5, 0.03),
    )
    needs = ("unloading",)
    examples = (
        WorkedExample(
            "Up to 0.3 N and 2 mm, back to 0.15 N: 1 mm becomes 1 (1 + 4 x 0.05 x 0.5) = 1.1 mm, "
            "5 % of the largest travel more.",
            {"h": 0.05},
            {
                "phase": ("load", "load", "unload"),
                "force_n": (0.15, 0.3, 0.15),
                "travel_m": (1e-3, 2e-3, 1e-3),
            },
            {"travel_m": (1e-3, 2e-3, 1.1e-3)},
        ),
    )

    def response(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, *, h: float
    ) -> np.ndarray:
        """Widen the unloading branch."""
        peak = readings.peak_of(force_n)
        level = np.divide(force_n, peak, out=np.ones_like(force_n), where=peak > 0)
        back = readings.phase == "unload"
        return travel_m * (1 + np.where(back, 4 * h * (1 - level), 0.0))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how wide the loop is."""
        return (
            "At half of its largest force a press is deeper on the way back than on the way in, "
            f"by {percent(values['h'])} of its largest travel, at soft and stiff places alike."
        )
