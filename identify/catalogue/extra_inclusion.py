"""One more inclusion than the map has."""

from dataclasses import replace

import numpy as np

from fem.mesh import probed_box
from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, pressure
from identify.map.gaussian_map import Inclusion

# Measured on a block of 96 x 96 x 48 mm and 81 presses: any inclusion of 6 to 14 mm radius is like
# one of these candidates by a cosine of 0.93 or more, the background projected out; depths differ
# by 0.98, places next to each other by 0.84.
_RADIUS = 0.16  # of the body's height
_DEPTHS = (0.2, 0.5)  # of the height below the top
_SPACING = 0.95  # of the candidates, in radii
_MOST = 300  # candidates


class ExtraInclusion(Effect):
    """A Gaussian addition to the modulus, as the map's own inclusions are."""

    name = "extra_inclusion"
    title = "Further inclusion"
    summary = (
        "There is a harder or softer spot beside those that the map has. "
        "The map then bends its own inclusions towards it."
    )
    formula = "E -> E + weight exp(-|r - centre|^2 / (2 radius^2))"
    latex = (
        r"E \to E + \text{weight} \cdot \exp\left(-\frac{|\mathbf{r} - \mathbf{c}|^2}{2 \, "
        r"\text{radius}^2}\right), \quad \mathbf{c} = (x, y, z)"
    )
    source = (
        "Method to Generate Distribution Maps of the Material Parameters of the Human Body Using "
        "Robotic and Dynamic Simulation Systems, eq. 13"
    )
    gives_away = "neighbouring presses in one region misfit with the same sign, at every force"
    cure = "Raise the number of inclusions of the map, or press more densely there."
    parameters = (
        EffectParameter("weight_pa", "Pa", "modulus added at its centre", 0.0, -1e6, 1e7, 5e3),
        EffectParameter("x_m", "m", "centre", None, -1.0, 1.0, 0.01),
        EffectParameter("y_m", "m", "centre", None, -1.0, 1.0, 0.01),
        EffectParameter("z_m", "m", "centre", None, -1.0, 1.0, 0.01),
        EffectParameter("radius_m", "m", "standard radius", None, 1e-3, 0.5, 0.01, log=True),
    )
    needs = ("several presses",)
    examples = (
        WorkedExample(
            "9 kPa with a radius of 10 mm: all of it at the centre, exp(-1/2) of it 10 mm away.",
            {"weight_pa": 9000.0, "x_m": 0.04, "y_m": 0.05, "z_m": 0.03, "radius_m": 0.01},
            {"point_m": ((0.04, 0.05, 0.03), (0.04, 0.06, 0.03))},
            {"added_pa": (9000.0, 5458.776)},
        ),
    )

    def body(
        self,
        state: BodyState,
        *,
        weight_pa: float,
        x_m: float,
        y_m: float,
        z_m: float,
        radius_m: float,
    ) -> BodyState:
        """Put the inclusion into the body."""
        return state.changed(bumps=(*state.bumps, Inclusion(weight_pa, x_m, y_m, z_m, radius_m)))

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Places below the pressed area, a good radius apart, at two depths."""
        height = _shown_height_m(readings, state)
        radius = _RADIUS * height
        low, high = readings.point_m.min(axis=0), readings.point_m.max(axis=0)
        top = state.box_m[1][2]
        sides, spacing = (high - low)[:2], _SPACING * radius
        count = 1 + np.ceil(sides / spacing)
        while len(_DEPTHS) * count.prod() > _MOST:  # much wider than high: what can be afforded
            spacing *= 1.05
            count = 1 + np.ceil(sides / spacing)
        axes = [
            low[i] + sides[i] * (np.arange(count[i]) + 0.5 * (count[i] == 1)) / max(count[i] - 1, 1)
            for i in (0, 1)
        ]
        return [
            {
                "x_m": float(x),
                "y_m": float(y),
                "z_m": float(top - depth * height),
                "radius_m": float(radius),
            }
            for depth in _DEPTHS
            for x in axes[0]
            for y in axes[1]
        ]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Keep the centre inside the body and the radius between a fine and a coarse spot."""
        weight, *centre, radius = self.parameters
        if state.background_pa is not None:
            size = state.background_pa
            weight = replace(weight, lower=-0.95 * size, upper=100 * size, typical=size)
        places = [
            replace(p, lower=low, upper=high, typical=0.1 * (high - low))
            for p, low, high in zip(centre, *state.box_m, strict=True)
        ]
        height = _shown_height_m(readings, state)
        bounded = replace(radius, lower=0.04 * height, upper=0.6 * height, typical=0.2 * height)
        return weight, *places, bounded

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say where the spot is and how hard."""
        kind = "harder" if values["weight_pa"] >= 0 else "softer"
        top = float(readings.point_m[:, 2].max())
        x, y = (f"{1e3 * values[name]:.1f}" for name in ("x_m", "y_m"))
        return (
            f"Presses around x = {x} mm, y = {y} mm point to one more spot, "
            f"{pressure(abs(values['weight_pa']))} {kind} than its surroundings, "
            f"{length(top - values['z_m'])} below the top, of {length(values['radius_m'])} radius."
        )


def _shown_height_m(readings: Readings, state: BodyState) -> float:
    """Height of the part of the body that the presses show."""
    points, box = readings.point_m[readings.first], np.array(state.box_m)
    low, high = probed_box(points, box, float(readings.radius_m.min()))
    return float(high[2] - low[2])
