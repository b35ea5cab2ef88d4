"""Dry friction between the force sensor and the tip."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force


class GuideFriction(Effect):
    """A constant force against the way, which turns with it."""

    name = "guide_friction"
    title = "Friction in the tip's guide"
    order = 25
    summary = (
        "The tip runs in a guide or a joint that rubs, behind which the force sensor sits. The "
        "sensor reads the friction with the force on the way in, and without it on the way back."
    )
    formula = "F = F_read - friction s,  s = 1 while loading and holding, -1 while unloading"
    latex = (
        r"F = F_{\text{read}} - \text{friction} \cdot s, \quad s = 1 \text{ in loading and "
        r"holding}, \; -1 \text{ in unloading}"
    )
    source = (
        "C. A. Coulomb, Théorie des machines simples, 1785; B. Armstrong-Hélouvry, P. Dupont, "
        "C. Canudas de Wit, Automatica 30 (1994) 1083-1138"
    )
    gives_away = "loading and unloading part by one force, alike at all forces and places"
    cure = "Put the force sensor at the tip, before any guide, or oil the guide."
    parameters = (EffectParameter("friction_n", "N", "of the guide", 0.0, -1.0, 10.0, 0.01),)
    needs = ("unloading",)
    examples = (
        WorkedExample(
            "10 mN of friction: 0.31 N read on the way in, and 0.29 N on the way back, are 0.3 N.",
            {"friction_n": 0.01},
            {"phase": ("load", "hold", "unload"), "force_n": (0.31, 0.31, 0.29)},
            {"force_n": (0.3, 0.3, 0.3)},
        ),
    )

    def force(self, readings: Readings, force_n: np.ndarray, *, friction_n: float) -> np.ndarray:
        """Take the friction off."""
        return force_n - friction_n * np.where(readings.phase == "unload", -1.0, 1.0)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how large the friction is."""
        friction = values["friction_n"]
        more, less = ("more", "less") if friction > 0 else ("less", "more")
        return (
            f"The force reads {force(abs(friction))} {more} on the way in and as much {less} on "
            "the way back, whatever its size and the place."
        )
