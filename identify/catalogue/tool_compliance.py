"""The tool, the sensor and the arm bend too."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings


class ToolCompliance(Effect):
    """A spring in series with every press."""

    name = "tool_compliance"
    title = "Compliance of tool and arm"
    order = 10
    summary = (
        "Tool, sensor and arm bend under the contact force, and the robot takes that for travel "
        "of the tip. The same is added at every place, so that hard places suffer most."
    )
    formula = "d = u + c F"
    latex = r"d = u + c F"
    source = "W. C. Oliver, G. M. Pharr, J. Mater. Res. 7 (1992) 1564-1583 (load-frame compliance)"
    gives_away = "each newton adds the same travel everywhere, which shows most where it is hard"
    cure = "Press on steel once: all travel there is the tool's. Or use tips of two radii."
    parameters = (
        EffectParameter("c_m_per_n", "m/N", "compliance of the tool", 0.0, 0.0, 0.05, 1e-4),
    )
    examples = (
        WorkedExample(
            "0.1 mm/N at 0.3 N add 0.03 mm.",
            {"c_m_per_n": 1e-4},
            {"force_n": 0.3, "travel_m": 3e-3},
            {"displacement_m": 3.03e-3},
        ),
    )

    def reading(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, *, c_m_per_n: float
    ) -> np.ndarray:
        """Add the tool's own travel."""
        return travel_m + c_m_per_n * force_n

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how stiff the tool is."""
        c = values["c_m_per_n"]
        stiffness = f", a tool of {1e-3 / c:.2g} N/mm" if c > 0 else ""
        return (
            f"Each newton adds {1e3 * c:.2g} mm of travel at soft and hard places alike{stiffness}."
        )
