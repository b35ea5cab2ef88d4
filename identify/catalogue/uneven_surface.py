"""The surface departs smoothly, in any way, from the shape from which the robot counts."""

import numpy as np

from identify.effects.base import WorkedExample
from identify.effects.heights import Height, height_parameters, heights
from identify.effects.readings import Readings


class UnevenSurface(Height):
    """A height of fourth degree in the place, added to every displacement."""

    name = "uneven_surface"
    family = "surface_tilt"
    title = "Uneven surface"
    order = 82
    degree = 4
    summary = (
        "The surface has bumps and dents that the robot does not know, or first touch is declared "
        "later at some places than at others. Displacements are off by a length that changes "
        "smoothly over the body, in any way."
    )
    formula = "d = u + sum of h_ij P_i(x) P_j(y),  i + j <= 4, P Legendre's polynomials"
    latex = r"d = u + \sum_{i + j \le 4} h_{ij} \, P_i(x) \, P_j(y)"
    gives_away = (
        "lines of travel over force miss the origin, by amounts that change smoothly over the body"
    )
    cure = "Measure the surface with light touches first, or detect first touch in each press."
    parameters = height_parameters(4)
    contains = ("contact_offset", "surface_tilt", "curved_surface")
    examples = (
        WorkedExample(
            "Presses in a row at -1, 0 and 1 of the half width: P_4 is 1, 3/8 and 1 there, and "
            "0.1 mm of it is added.",
            {**{p.name: 0.0 for p in height_parameters(4)}, "h_40_m": 1e-4},
            {
                "press": (0.0, 1.0, 2.0),
                "point_m": ((0.0, 0.0, 0.0), (0.02, 0.0, 0.0), (0.04, 0.0, 0.0)),
                "travel_m": 3e-3,
            },
            {"displacement_m": (3.1e-3, 3.0375e-3, 3.1e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        h_00_m: float,
        h_10_m: float,
        h_01_m: float,
        h_20_m: float,
        h_11_m: float,
        h_02_m: float,
        h_30_m: float,
        h_21_m: float,
        h_12_m: float,
        h_03_m: float,
        h_40_m: float,
        h_31_m: float,
        h_22_m: float,
        h_13_m: float,
        h_04_m: float,
    ) -> np.ndarray:
        """Add the height."""
        sizes_m = (
            h_00_m,
            h_10_m, h_01_m,
            h_20_m, h_11_m, h_02_m,
            h_30_m, h_21_m, h_12_m, h_03_m,
            h_40_m, h_31_m, h_22_m, h_13_m, h_04_m,
        )  # fmt: skip
        return travel_m + heights(readings, self.degree, sizes_m)
