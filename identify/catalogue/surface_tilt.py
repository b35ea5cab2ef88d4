"""The surface does not lie where the robot believes it."""

import math

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length


class SurfaceTilt(Effect):
    """A plane added to every displacement."""

    name = "surface_tilt"
    title = "Tilted surface"
    order = 80
    counted_from = "plane"
    summary = (
        "The surface is tilted and shifted against the plane from which depths are counted. "
        "Displacements are too large on one side of the scan and too small on the other."
    )
    formula = (
        "d = u + offset + slope_x (x - xc) + slope_y (y - yc),  (xc, yc) the middle of the scan"
    )
    latex = r"d = u + \text{offset} + \text{slope}_x (x - x_c) + \text{slope}_y (y - y_c)"
    source = "derivation: height of a plane, to first order in its slopes"
    gives_away = (
        "lines of travel over force miss the origin, by amounts that change across the body"
    )
    cure = "Touch the surface lightly at three corners first, or detect first touch in each press."
    parameters = (
        EffectParameter("offset_m", "m", "in the middle of the scan", 0.0, -0.01, 0.01, 1e-4),
        EffectParameter("slope_x", "m/m", "along x", 0.0, -0.3, 0.3, 2e-3),
        EffectParameter("slope_y", "m/m", "along y", 0.0, -0.3, 0.3, 2e-3),
    )
    needs = ("several forces", "several presses")
    contains = ("contact_offset",)
    examples = (
        WorkedExample(
            "Presses at x = 0 and 20 mm, middle at 10 mm: 0.1 mm and 1 % of 10 mm down and up.",
            {"offset_m": 1e-4, "slope_x": 0.01, "slope_y": 0.0},
            {
                "press": (0.0, 1.0),
                "point_m": ((0.0, 0.0, 0.0), (0.02, 0.0, 0.0)),
                "travel_m": 3e-3,
            },
            {"displacement_m": (3e-3, 3.2e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        offset_m: float,
        slope_x: float,
        slope_y: float,
    ) -> np.ndarray:
        """Add the plane."""
        x, y, _ = (readings.point_m - readings.scales.middle_m).T
        return travel_m + offset_m + slope_x * x + slope_y * y

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the slope of the tilt and its effect at the far ends."""
        slope = math.hypot(values["slope_x"], values["slope_y"])
        towards = math.degrees(math.atan2(values["slope_y"], values["slope_x"])) % 360
        x, y, _ = (readings.point_m - readings.scales.middle_m).T
        plane = values["offset_m"] + values["slope_x"] * x + values["slope_y"] * y
        return (
            f"Displacements are off by {length(float(plane.min()))} on one side of the scan and by "
            f"{length(float(plane.max()))} on the other: the surface is tilted by "
            f"{math.degrees(math.atan(slope)):.2g} degrees, towards {towards:.0f} degrees from x."
        )
