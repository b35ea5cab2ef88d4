"""A robot whose zero of displacement wanders along a smooth curve."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import KNOTS, knot_names, smooth_in_time
from identify.effects.units import length


class DisplacementWander(Effect):
    """A zero on a natural cubic spline through five knots, evenly over the scan."""

    name = "displacement_wander"
    family = "displacement_drift"
    title = "Smooth wander of the displacement"
    order = 91
    counted_from = "plane"
    summary = (
        "The arm warms up and settles, or the body sinks into its bed and stops. "
        "Displacements are off by a length that follows some smooth course over the scan."
    )
    formula = "d = u + zero(t),  a natural cubic spline, 0 at the scan's first reading"
    latex = r"d = u + \text{zero}(t), \quad \text{zero}(0) = 0"
    source = (
        "P. J. Green, B. W. Silverman, Nonparametric Regression and Generalized Linear Models, "
        "Chapman and Hall 1994, ch. 2 (natural cubic splines)"
    )
    gives_away = "the misfit moves smoothly with time, by the same travel whatever the force"
    cure = "Find first touch anew in each press, and let the arm warm up."
    parameters = tuple(
        EffectParameter(f"{name}_m", "m", f"zero after {share} of the scan",
                        0.0, -0.05, 0.05, 1e-4)
        for name, share in knot_names("zero")
    )  # fmt: skip
    needs = ("time", "several presses")
    contains = ("displacement_drift",)
    examples = (
        WorkedExample(
            "20 µm more with every fifth of a scan of 100 s is a straight line: 50 µm after 50 s.",
            {f"{name}_m": 2e-5 * (i + 1) for i, (name, _) in enumerate(knot_names("zero"))},
            {"time_s": (7.0, 57.0, 107.0), "press": (0.0, 1.0, 2.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.05e-3, 1.1e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        zero_20_m: float,
        zero_40_m: float,
        zero_60_m: float,
        zero_80_m: float,
        zero_100_m: float,
    ) -> np.ndarray:
        """Add the zero."""
        knots = (zero_20_m, zero_40_m, zero_60_m, zero_80_m, zero_100_m)
        return travel_m + smooth_in_time(readings, knots)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the zero wanders."""
        course = np.array([0.0, *(values[p.name] for p in self.parameters)])
        return (
            f"Displacements wander smoothly, over a range of {length(np.ptp(course))} at "
            f"{KNOTS + 1} instants of the scan, at every force and place."
        )
