"""A body that lies elsewhere than the study states."""

from dataclasses import replace

import numpy as np

from identify.body.shifted_block import room_m
from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length

_LARGEST = 0.12  # of the body's width


class BodyShift(Effect):
    """The body's sides, along x and y, under presses that stay where they are."""

    name = "body_shift"
    title = "Body elsewhere than stated"
    summary = (
        "The body lies further to one side under the robot than the study states, as after a "
        "registration that is off. Presses that are thought to be far from an edge are near it."
    )
    formula = "sides at x + x_m and y + y_m; presses and map stay in the robot's frame"
    latex = r"\Omega \to \Omega + (x, y, 0), \quad \text{presses and map stay in the robot's frame}"
    source = "derivation: the same boundary value problem on the moved body"
    gives_away = "presses along one side sink too far, those along the opposite side too little"
    cure = "Touch the body's sides with the robot, or keep presses away from the edges."
    parameters = (
        EffectParameter("x_m", "m", "shift of the body along x", 0.0, -0.02, 0.02, 1e-3),
        EffectParameter("y_m", "m", "shift of the body along y", 0.0, -0.02, 0.02, 1e-3),
    )
    needs = ("several presses",)
    examples = (
        WorkedExample(
            "A body set down 2 mm further along x.",
            {"x_m": 2e-3, "y_m": 0.0},
            {},
            {"shift_m": (2e-3, 0.0)},
        ),
    )

    def body(self, state: BodyState, *, x_m: float, y_m: float) -> BodyState:
        """Move it."""
        x, y = state.shift_m
        return state.changed(shift_m=(x + x_m, y + y_m))

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Keep the tips on the body."""
        first, box = readings.first, np.array(state.box_m)
        room = room_m(readings.point_m[first], readings.radius_m[first], box)
        most = np.minimum(room, _LARGEST * (box[1] - box[0])[:2, None])
        return tuple(
            replace(p, lower=-float(low), upper=float(high))
            for p, (low, high) in zip(self.parameters, most, strict=True)
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say where the body lies."""
        parts = [
            f"{length(abs(values[f'{axis}_m']))} towards {'+' if values[f'{axis}_m'] > 0 else '-'}"
            f"{axis}"
            for axis in "xy"
        ]
        return (
            "Presses along the sides misfit as if the body lay "
            f"{' and '.join(parts)} of where the study states it: check the registration of robot "
            "and body before any physics is blamed."
        )
