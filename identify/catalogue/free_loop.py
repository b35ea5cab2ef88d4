"""A loop between loading and unloading of any smooth shape."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import natural_spline
from identify.effects.units import percent

_LEVELS = (0.0, 0.3, 0.6, 0.85)
"""Shares of the largest force at which the loop's width is free; at the largest it is closed."""


class FreeLoop(Effect):
    """The way back is another smooth function of the force, alike at all places."""

    name = "free_loop"
    family = "hysteresis"
    title = "Hysteresis of free shape"
    order = 32
    summary = (
        "On the way back the tip is deeper, or less deep, than on the way in at the same force. "
        "The width of the loop is any smooth function of the force that closes at the largest one."
    )
    formula = "d = u + u_max w(F / F_max) while unloading,  w a natural cubic spline, w(1) = 0"
    latex = r"d = u + u_{\max} \, w(F / F_{\max}) \quad \text{while unloading}, \quad w(1) = 0"
    source = (
        "free form of the loops in Y. C. Fung, Biomechanics: Mechanical Properties of Living "
        "Tissues, Springer 1993, ch. 7"
    )
    gives_away = "loading and unloading part at equal force, in the same way at all places"
    cure = "Take the loading branch only, or unload as slowly as you load and fit both."
    parameters = tuple(
        EffectParameter(f"width_{100 * level:.0f}", "1",
                        f"width at {100 * level:.0f} % of the largest force", 0.0, -1.0, 1.0, 0.03)
        for level in _LEVELS
    )  # fmt: skip
    needs = ("unloading",)
    contains = ("hysteresis",)
    any_shape = True
    examples = (
        WorkedExample(
            "Up to 2 mm at 0.3 N and back to 0.18 N, 60 % of it, where the loop is 5 % of 2 mm "
            "wide: 0.1 mm more. At no force it is 1 % wide.",
            {"width_0": 0.01, "width_30": 0.03, "width_60": 0.05, "width_85": 0.04},
            {
                "phase": ("load", "load", "unload", "unload"),
                "force_n": (0.15, 0.3, 0.18, 0.0),
                "travel_m": (1e-3, 2e-3, 1e-3, 0.0),
            },
            {"travel_m": (1e-3, 2e-3, 1.1e-3, 2e-5)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        width_0: float,
        width_30: float,
        width_60: float,
        width_85: float,
    ) -> np.ndarray:
        """Add the loop's width to the unloading branch."""
        peak = readings.peak_of(force_n)
        level = np.divide(force_n, peak, out=np.ones_like(force_n), where=peak > 0)
        widths = (width_0, width_30, width_60, width_85, 0.0)
        width = natural_spline(np.clip(level, 0, 1), widths, (*_LEVELS, 1.0))
        back = readings.phase == "unload"
        return travel_m + np.where(back, readings.peak_of(travel_m) * width, 0.0)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how wide the loop is, and where."""
        widths = [values[p.name] for p in self.parameters]
        widest = int(np.argmax(np.abs(widths)))
        deeper = "deeper" if widths[widest] > 0 else "less deep"
        return (
            f"On the way back a press is {deeper} than on the way in, by up to "
            f"{percent(abs(widths[widest]))} of its largest travel at about "
            f"{100 * _LEVELS[widest]:.0f} % of its largest force, at all places alike."
        )
