"""Play in the joints of the robot."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, more


class Backlash(Effect):
    """A constant way lost where the robot turns back."""

    name = "backlash"
    title = "Backlash of the robot's joints"
    order = 65
    summary = (
        "The joints or gears of the robot have play. Where the tip turns back the robot moves "
        "through the play first, so that all displacements of the way back are off by a constant."
    )
    formula = "d = u - way while unloading"
    latex = r"d = u - \text{way} \quad \text{while unloading}"
    source = (
        "M. Nordin, P.-O. Gutman, Automatica 38 (2002) 1633-1649 (mechanical systems with backlash)"
    )
    gives_away = "loading and unloading part by one length, alike at all forces and places"
    cure = "Measure the tip's place at the tip, or take the loading branch only."
    parameters = (EffectParameter("way_m", "m", "lost at the turn", 0.0, -5e-3, 5e-3, 1e-4),)
    needs = ("unloading",)
    examples = (
        WorkedExample(
            "0.1 mm of play: 1 mm on the way back is reported as 0.9 mm.",
            {"way_m": 1e-4},
            {"phase": ("load", "hold", "unload"), "force_n": 0.3, "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1e-3, 0.9e-3)},
        ),
    )

    def reading(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, *, way_m: float
    ) -> np.ndarray:
        """Take the way off after the turn."""
        return travel_m - way_m * (readings.phase == "unload")

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much way is lost."""
        way = values["way_m"]
        return (
            f"On the way back every displacement is {length(abs(way))} too "
            f"{more(way, 'small', 'large')}, whatever force and place."
        )
