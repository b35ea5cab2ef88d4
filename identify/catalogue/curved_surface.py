"""The surface bows away from the plane from which the robot counts."""

import numpy as np

from identify.effects.base import WorkedExample
from identify.effects.heights import Height, height_parameters, heights
from identify.effects.readings import Readings


class CurvedSurface(Height):
    """A height of second degree in the place, added to every displacement."""

    name = "curved_surface"
    family = "surface_tilt"
    title = "Curved surface"
    order = 81
    degree = 2
    summary = (
        "The surface bows or sags against the plane from which depths are counted, or first touch "
        "is declared later in the middle of the scan than at its edges. Displacements are off by "
        "a length that changes over the body like a bow."
    )
    formula = "d = u + sum of h_ij P_i(x) P_j(y),  i + j <= 2, P Legendre's polynomials"
    latex = r"d = u + \sum_{i + j \le 2} h_{ij} \, P_i(x) \, P_j(y)"
    gives_away = (
        "lines of travel over force miss the origin, by amounts that follow a bow over the body"
    )
    cure = "Touch the surface lightly at nine places first, or detect first touch in each press."
    parameters = height_parameters(2)
    contains = ("contact_offset", "surface_tilt")
    examples = (
        WorkedExample(
            "Presses in a row at -1, 0 and 1 of the half width: P_2 is 1, -1/2 and 1 there, and "
            "0.1 mm of it is added.",
            {"h_00_m": 0.0, "h_10_m": 0.0, "h_01_m": 0.0, "h_20_m": 1e-4, "h_11_m": 0.0,
             "h_02_m": 0.0},
            {
                "press": (0.0, 1.0, 2.0),
                "point_m": ((0.0, 0.0, 0.0), (0.02, 0.0, 0.0), (0.04, 0.0, 0.0)),
                "travel_m": 3e-3,
            },
            {"displacement_m": (3.1e-3, 2.95e-3, 3.1e-3)},
        ),
    )  # fmt: skip

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
    ) -> np.ndarray:
        """Add the height."""
        sizes_m = (
            h_00_m,
            h_10_m, h_01_m,
            h_20_m, h_11_m, h_02_m,
        )  # fmt: skip
        return travel_m + heights(readings, self.degree, sizes_m)
