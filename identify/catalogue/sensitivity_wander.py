"""A force sensor whose sensitivity follows a smooth curve, or a body whose stiffness does."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import KNOTS, knot_names, smooth_in_time
from identify.effects.units import percent

_MOST = 0.5  # change of the reading


class SensitivityWander(Effect):
    """A factor on the force along a natural cubic spline through five knots, evenly over a scan."""

    name = "sensitivity_wander"
    family = "sensitivity_drift"
    title = "Smooth wander of the sensor's sensitivity, or of the body's stiffness"
    order = 41
    summary = (
        "The sensor reads more or less of the same force along some smooth course over the scan, "
        "or the body stiffens and softens as it cools, dries and warms. "
        "It is the free form of a drift, for courses that are not straight."
    )
    formula = "F = F_read / (1 + gain(t)),  a natural cubic spline, 0 at the scan's first reading"
    latex = r"F = \frac{F_{\text{read}}}{1 + \text{gain}(t)}, \quad \text{gain}(0) = 0"
    source = (
        "P. J. Green, B. W. Silverman, Nonparametric Regression and Generalized Linear Models, "
        "Chapman and Hall 1994, ch. 2 (natural cubic splines)"
    )
    gives_away = "the misfit moves smoothly with time, in proportion to the force"
    cure = (
        "Press a spring of known stiffness now and then, which separates the sensor from the "
        "body, and visit the points in random order."
    )
    parameters = tuple(
        EffectParameter(name, "1", f"growth of the reading after {share} of the scan", 0.0, -_MOST,
                        _MOST, 0.03)
        for name, share in knot_names("gain")
    )  # fmt: skip
    needs = ("time", "several presses")
    contains = ("sensitivity_drift",)
    examples = (
        WorkedExample(
            "1 % more with every fifth of a scan of 100 s is a straight line: 2.5 % after 50 s.",
            {name: 0.01 * (i + 1) for i, (name, _) in enumerate(knot_names("gain"))},
            {"time_s": (7.0, 57.0, 107.0), "press": (0.0, 1.0, 2.0), "force_n": 0.3},
            {"force_n": (0.3, 0.3 / 1.025, 0.3 / 1.05)},
        ),
    )

    def force(
        self,
        readings: Readings,
        force_n: np.ndarray,
        *,
        gain_20: float,
        gain_40: float,
        gain_60: float,
        gain_80: float,
        gain_100: float,
    ) -> np.ndarray:
        """Undo the change of sensitivity."""
        knots = (gain_20, gain_40, gain_60, gain_80, gain_100)
        return force_n / (1 + smooth_in_time(readings, knots))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the sensitivity wanders."""
        course = np.array([0.0, *(values[p.name] for p in self.parameters)])
        return (
            f"The same depth costs more force at one time of the scan than at another, by up to "
            f"{percent(np.ptp(course))} at {KNOTS + 1} instants, at every place: the sensor's "
            "sensitivity wanders, or the body's stiffness does."
        )
