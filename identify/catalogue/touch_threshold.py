"""First touch that is declared at a force: travel is counted from there."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force

_MOST = 0.9  # of the median press's largest force


class TouchThreshold(Advice, Effect):
    """Travel from the force on at which the robot declares first touch: u(F) - u(threshold).

    Soft places have yielded further by then than hard ones, so that no constant offset does as
    well. Under a contact of fixed size it acts exactly as a bias of the force sensor would,
    C F - C threshold, and is left to that; where the contact grows with the force, it differs.
    """

    name = "touch_threshold"
    title = "Force threshold of first touch"
    order = 70
    counted_from = "touch"
    summary = (
        "The robot takes the surface for touched when the force passes a threshold, and counts "
        "the travel from there. The travel up to then is missing in every "
        "displacement, most at soft places."
    )
    formula = "d = u(F) - u(threshold)"
    latex = r"d = u(F) - u(\text{threshold})"
    source = (
        "derived; D. C. Lin, E. K. Dimitriadis, F. Horkay, J. Biomech. Eng. 129 (2007) 430-440 "
        "for the contact point as an unknown"
    )
    gives_away = "the curves begin at one force and no travel, and are steeper there than a ball's"
    cure = "Count the travel from where the force begins to rise, or lower the threshold."
    parameters = (
        EffectParameter(
            "threshold_n", "N", "force at which travel begins to be counted", 0.0, 0.0, 1.0, 0.03
        ),
    )
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "A linear body of 10 mm/N, touch declared at 0.08 N: 0.8 mm are missing.",
            {"threshold_n": 0.08},
            {"force_n": (0.08, 0.3), "travel_m": (0.8e-3, 3e-3), "compliance_m_per_n": 0.01},
            {"displacement_m": (0.0, 2.2e-3)},
        ),
    )

    def touch(self, readings: Readings, *, threshold_n: float) -> float:
        """Return the threshold."""
        return threshold_n

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the threshold by the forces of an ordinary press."""
        ordinary = max(float(np.median(readings.peak_force_n)), 1e-6)
        return (replace(self.parameters[0], upper=_MOST * ordinary, typical=0.1 * ordinary),)

    def redundant(self, profile: str, nonlinear: bool) -> str | None:
        """Say that a linear contact makes it a bias of the force sensor."""
        return None if nonlinear else "under a contact of fixed size it is what force_bias is"

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say at which force travel begins to be counted."""
        return (
            f"Travel is counted from where the force has reached {force(values['threshold_n'])}, "
            "not from first touch: the travel up to that force is missing in every "
            "displacement, most at soft places."
        )
