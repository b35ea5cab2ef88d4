"""Stiffness that changes steadily from one side of the body to the other."""

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent


class SideGradient(Effect):
    """A factor on the modulus, linear along the surface, one in the body's middle."""

    name = "side_gradient"
    title = "Stiffness changing from side to side"
    summary = (
        "The whole body grows stiffer towards one side, as where a gel has set unevenly. "
        "A map with one background cannot follow, and its inclusions drift that way."
    )
    formula = "E -> E (1 + g_x (x/l_x - 1/2) + g_y (y/l_y - 1/2)), x and y from the body's corner"
    latex = (
        r"E \to E \left(1 + g_x \left(\frac{x}{l_x} - \frac{1}{2}\right) + g_y "
        r"\left(\frac{y}{l_y} - \frac{1}{2}\right)\right)"
    )
    source = "derivation: the first terms of a Taylor series of ln E along the surface"
    gives_away = "one side of the body is felt stiffer than the other, evenly and at every force"
    cure = "None is needed if the body is so; else let the gel set evenly, or warm up throughout."
    parameters = (
        EffectParameter("g_x", "1", "change along x over the mean", 0.0, -0.95, 0.95, 0.2),
        EffectParameter("g_y", "1", "change along y over the mean", 0.0, -0.95, 0.95, 0.2),
    )
    needs = ("several presses",)
    examples = (
        WorkedExample(
            "0.4 along x in a body 96 mm long: 0.8 at one end, 1.2 at the other.",
            {"g_x": 0.4, "g_y": 0.0},
            {"point_m": ((0.0, 0.048, 0.0), (0.096, 0.048, 0.0))},
            {"factor": (0.8, 1.2)},
        ),
    )

    def body(self, state: BodyState, *, g_x: float, g_y: float) -> BodyState:
        """Grade the modulus."""
        slope = np.array([g_x, g_y])
        low, high = (np.array(corner[:2]) for corner in state.box_m)

        def graded(points_m: np.ndarray) -> np.ndarray:
            return 1 + ((points_m[:, :2] - low) / (high - low) - 0.5) @ slope

        return state.changed(factors=(*state.factors, graded))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say where it is stiffer, and by how much."""
        sides = " and ".join(
            f"{percent(abs(g))} {'stiffer' if g > 0 else 'softer'} where {axis} is largest"
            for axis, g in (("x", values["g_x"]), ("y", values["g_y"]))
        )
        return f"The body is {sides} than on the side across, in shares of its mean stiffness."
