"""Creep of a part of the body."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.placed_creep import PlacedCreep, few_times, surface, within_scan
from identify.catalogue.viscoelasticity import lagging
from identify.effects.base import EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent, seconds

_WIDTHS = (0.15, 0.3)  # radii of the grid, of the pressed surface's larger edge
_SMALLEST = 0.12  # radius, likewise: no single press
_APART = 0.9  # of a radius: between centres of the grid


class LocalCreep(PlacedCreep):
    """Linear creep with one relaxation time whose share falls off around a place."""

    name = "local_creep"
    family = "viscoelasticity"
    title = "Creep of a part of the body"
    order = 13
    summary = (
        "Only a part of the body creeps, such as an inclusion of another material. Presses above "
        "it sink on under a held force, the others do not."
    )
    formula = "d = u + g exp(-((x - x_c)^2 + (y - y_c)^2) / (2 radius^2)) z,  tau dz/dt = u - z"
    latex = (
        r"\begin{array}{l} d = u + g \, e^{-\left((x - x_c)^2 + (y - y_c)^2\right) / (2 r^2)} z "
        r"\\ \tau \dot z = u - z \end{array}"
    )
    source = (
        "J. D. Ferry, Viscoelastic Properties of Polymers, Wiley 1980, ch. 1 (Voigt element); the "
        "bell is the simplest place"
    )
    gives_away = "the tip sinks under a held force at some places, and not at the others"
    parameters = (
        EffectParameter("g", "1", "creep in the end at the centre, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("tau_s", "s", "time constant", None, 1e-3, 1e3, 1.0, log=True),
        EffectParameter("x_m", "m", "centre", None, -1.0, 1.0, 0.01),
        EffectParameter("y_m", "m", "centre", None, -1.0, 1.0, 0.01),
        EffectParameter("radius_m", "m", "of the place", None, 1e-3, 0.5, 0.01, log=True),
    )
    examples = (
        WorkedExample(
            "The travel rises by 1 mm/s from a touch at t = 0; z is t - tau (1 - exp(-t / tau)): "
            "0.36788 mm at 1 s, 1.13534 mm at 2 s for 1 s. One radius from the centre 6.065 % of "
            "it are added.",
            {"g": 0.1, "tau_s": 1.0, "x_m": 0.0, "y_m": 0.0, "radius_m": 0.01},
            {
                "time_s": (1.0, 2.0),
                "point_m": ((0.01, 0.0, 0.0), (0.01, 0.0, 0.0)),
                "force_n": (0.1, 0.2),
                "travel_m": (1e-3, 2e-3),
            },
            {"travel_m": (1.0223130e-3, 2.0688619e-3)},
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
        x_m: float,
        y_m: float,
        radius_m: float,
    ) -> np.ndarray:
        """Add the lagging part, weighed by the distance from the centre."""
        away = np.sum((readings.point_m[:, :2] - (x_m, y_m)) ** 2, axis=1)
        near = np.exp(-away / (2 * radius_m**2))
        return travel_m + g * near * lagging(readings, travel_m, tau_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Few time constants, at places that cover the pressed surface."""
        low, high = surface(readings)
        edge = float(max(high - low))
        found = []
        for width in _WIDTHS:
            radius = width * edge
            counts = np.maximum(np.ceil((high - low) / (_APART * radius)).astype(int), 1) + 1
            xs, ys = (np.linspace(a, b, n) for a, b, n in zip(low, high, counts, strict=True))
            found += [
                {"tau_s": tau, "x_m": x, "y_m": y, "radius_m": radius}
                for tau in few_times(readings)
                for x in xs.tolist()
                for y in ys.tolist()
            ]
        return found

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the place by the pressed surface, the time constant by the scan's timing."""
        g, tau, x, y, radius = self.parameters
        if readings.time_s is None:
            return self.parameters
        low, high = surface(readings)
        edge = float(max(high - low))
        return (
            g,
            within_scan(tau, readings),
            replace(x, lower=float(low[0]), upper=float(high[0]), typical=edge / 5),
            replace(y, lower=float(low[1]), upper=float(high[1]), typical=edge / 5),
            replace(radius, lower=_SMALLEST * edge, upper=10 * edge, typical=0.2 * edge),
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say where the body creeps, how much and how slowly."""
        x, y, radius = (1e3 * values[name] for name in ("x_m", "y_m", "radius_m"))
        return (
            f"Around ({x:.0f}, {y:.0f}) mm, within about {radius:.0f} mm, the tip keeps sinking "
            f"under a held force, by {percent(values['g'])} in the end with a time constant of "
            f"{seconds(values['tau_s'])}; elsewhere it does not."
        )
