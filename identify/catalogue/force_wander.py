"""A force sensor whose zero wanders along a smooth curve."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import KNOTS, knot_names, smooth_in_time
from identify.effects.units import force


class ForceWander(Effect):
    """A zero on a natural cubic spline through five knots, evenly over the scan."""

    name = "force_wander"
    family = "force_drift"
    title = "Smooth wander of the force sensor"
    order = 32
    summary = (
        "The sensor's zero follows some smooth course over the scan, there and back. "
        "It is the free form of a drift, for courses that are neither straight nor exponential."
    )
    formula = "F = F_read - zero(t),  a natural cubic spline, 0 at the scan's first reading"
    latex = r"F = F_{\text{read}} - \text{zero}(t), \quad \text{zero}(0) = 0"
    source = (
        "P. J. Green, B. W. Silverman, Nonparametric Regression and Generalized Linear Models, "
        "Chapman and Hall 1994, ch. 2 (natural cubic splines)"
    )
    gives_away = "the misfit moves smoothly with time, by the same force whatever the force"
    cure = "Zero the sensor in the air before each press."
    parameters = tuple(
        EffectParameter(f"{name}_n", "N", f"zero after {share} of the scan", 0.0, -1.0, 1.0, 0.01)
        for name, share in knot_names("zero")
    )
    needs = ("time", "several presses")
    contains = ("force_drift", "force_warm_up")
    examples = (
        WorkedExample(
            "2 mN more with every fifth of a scan of 100 s is a straight line: 5 mN after 50 s.",
            {f"{name}_n": 0.002 * (i + 1) for i, (name, _) in enumerate(knot_names("zero"))},
            {"time_s": (7.0, 57.0, 107.0), "press": (0.0, 1.0, 2.0), "force_n": 0.3},
            {"force_n": (0.3, 0.295, 0.29)},
        ),
    )

    def force(
        self,
        readings: Readings,
        force_n: np.ndarray,
        *,
        zero_20_n: float,
        zero_40_n: float,
        zero_60_n: float,
        zero_80_n: float,
        zero_100_n: float,
    ) -> np.ndarray:
        """Take the zero off."""
        knots = (zero_20_n, zero_40_n, zero_60_n, zero_80_n, zero_100_n)
        return force_n - smooth_in_time(readings, knots)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound each knot by the largest force."""
        most = max(readings.largest_force_n, 1e-3)
        return tuple(
            replace(p, lower=-most, upper=most, typical=0.03 * most) for p in self.parameters
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the zero wanders."""
        course = np.array([0.0, *(values[p.name] for p in self.parameters)])
        return (
            f"The force sensor's zero wanders smoothly, over a range of {force(np.ptp(course))} at "
            f"{KNOTS + 1} instants of the scan, whatever the place."
        )
