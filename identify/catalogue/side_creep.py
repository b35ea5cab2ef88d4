"""Creep of one side of the body."""

import math
from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.placed_creep import PlacedCreep, few_times, surface, within_scan
from identify.catalogue.viscoelasticity import lagging
from identify.effects.base import EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent, seconds

_DIRECTIONS = 8  # over a whole turn
_EDGES = (0.3, 0.5, 0.7)  # of the pressed surface across the edge
_WIDTH = 0.05  # of the pressed surface's larger edge
_NARROWEST = 0.02  # likewise: far below the distance of two presses


class SideCreep(PlacedCreep):
    """Linear creep with one relaxation time on one side of a line over the surface."""

    name = "side_creep"
    family = "viscoelasticity"
    title = "Creep of one side of the body"
    order = 15
    summary = (
        "The body creeps on one side of a line, such as the border between two tissues. Presses "
        "there sink on under a held force, those on the other side do not."
    )
    formula = (
        "d = u + g z / (1 + exp(-(x cos(angle) + y sin(angle) - edge) / width)),  tau dz/dt = u - z"
    )
    latex = (
        r"\begin{array}{l} d = u + g \, z / \left(1 + e^{-(x \cos\varphi + y \sin\varphi - "
        r"\text{edge}) / \text{width}}\right) \\ \tau \dot z = u - z \end{array}"
    )
    source = (
        "J. D. Ferry, Viscoelastic Properties of Polymers, Wiley 1980, ch. 1 (Voigt element); the "
        "logistic step is the simplest border"
    )
    gives_away = "the tip sinks under a held force on one side of the body, and not on the other"
    parameters = (
        EffectParameter("g", "1", "creep in the end far beyond it, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("tau_s", "s", "time constant", None, 1e-3, 1e3, 1.0, log=True),
        EffectParameter(
            "angle_rad", "rad", "direction towards the creeping side, from the x axis", None,
            -math.pi, 3 * math.pi, math.pi / 4,
        ),
        EffectParameter(
            "edge_m", "m", "border, from the middle of the presses that way", None, -1.0, 1.0, 0.01
        ),
        EffectParameter("width_m", "m", "of the border", None, 1e-4, 0.5, 0.01, log=True),
    )  # fmt: skip
    examples = (
        WorkedExample(
            "The travel rises by 1 mm/s from a touch at t = 0; z is t - tau (1 - exp(-t / tau)): "
            "0.36788 mm at 1 s, 1.13534 mm at 2 s for 1 s. One width beyond the border 7.311 % of "
            "it are added.",
            {"g": 0.1, "tau_s": 1.0, "angle_rad": 0.0, "edge_m": -0.005, "width_m": 0.005},
            {
                "time_s": (1.0, 2.0),
                "point_m": ((0.015, 0.0, 0.0), (0.015, 0.0, 0.0)),
                "force_n": (0.1, 0.2),
                "travel_m": (1e-3, 2e-3),
            },
            {"travel_m": (1.0268942e-3, 2.0830002e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        g: float,
        tau_s: float,
        angle_rad: float,
        edge_m: float,
        width_m: float,
    ) -> np.ndarray:
        """Add the lagging part, weighed by the place beyond the border."""
        beyond = (_along(readings, angle_rad) - edge_m) / width_m
        side = 0.5 * (1 + np.tanh(0.5 * beyond))
        return travel_m + g * side * lagging(readings, travel_m, tau_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Few time constants, and narrow borders that divide the pressed surface all ways."""
        width, found = _WIDTH * _size(readings), []
        for angle in (np.arange(_DIRECTIONS) * 2 * math.pi / _DIRECTIONS).tolist():
            along = _along(readings, angle)
            found += [
                {"tau_s": tau, "angle_rad": angle, "edge_m": edge, "width_m": width}
                for tau in few_times(readings)
                for edge in np.quantile([along.min(), along.max()], _EDGES).tolist()
            ]
        return found

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the border by the pressed surface, the time constant by the scan's timing."""
        g, tau, angle, edge, width = self.parameters
        if readings.time_s is None:
            return self.parameters
        size = _size(readings)
        reach = float(np.linalg.norm(_beside(readings), axis=1).max())
        return (
            g,
            within_scan(tau, readings),
            angle,
            replace(edge, lower=-reach, upper=reach, typical=size / 5),
            replace(width, lower=_NARROWEST * size, upper=size, typical=0.1 * size),
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say on which side the body creeps, how much and how slowly."""
        angle = values["angle_rad"]
        towards = np.array([math.cos(angle), math.sin(angle)])
        x, y = 1e3 * (readings.scales.middle_m[:2] + values["edge_m"] * towards)
        return (
            f"The tip keeps sinking under a held force on one side of the body: beyond a line "
            f"through ({x:.0f}, {y:.0f}) mm, in the direction {math.degrees(angle) % 360:.0f} "
            f"degrees from the x axis, by {percent(values['g'])} in the end with a time constant "
            f"of {seconds(values['tau_s'])}. On the other side it does not."
        )


def _along(readings: Readings, angle_rad: float) -> np.ndarray:
    """Place of each reading in a direction over the surface, (m,) m."""
    return _beside(readings) @ (math.cos(angle_rad), math.sin(angle_rad))


def _beside(readings: Readings) -> np.ndarray:
    """Place of each reading beside the middle of the presses, (m, 2) m."""
    return (readings.point_m - readings.scales.middle_m)[:, :2]


def _size(readings: Readings) -> float:
    """Larger edge of the pressed surface, m."""
    low, high = surface(readings)
    return float(max(high - low))
