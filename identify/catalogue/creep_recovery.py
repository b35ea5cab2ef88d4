"""Creep of the whole body that outlasts the press."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.viscoelasticity import lagging, time_constants
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, percent, seconds

_RATIO = 2.0  # between neighbouring time constants of the grid
_REACHES = (0.5, 1.2)  # over the tip's radius
_NARROWEST, _WIDEST = 0.02, 4.0  # over the tip's radius
_LONGEST_PRESSES = 10.0  # time constant, in presses


class CreepRecovery(Effect):
    """Linear creep that goes back after each press, while the next ones are made nearby."""

    name = "creep_recovery"
    family = "viscoelasticity"
    title = "Creep that outlasts the press"
    order = 14
    summary = (
        "A press leaves a dent that rises again only slowly. A press that follows soon and near "
        "begins on the rising surface, which pushes back while it lasts."
    )
    formula = (
        "d = u + g z + g [w(t) - w(t_touch)],  tau dz/dt = u - z,  w = sum over earlier presses of "
        "(2/pi) asin(min(1, reach / distance)) z_end exp(-(t - t_end) / tau);  w(t_touch) only "
        "where travel counts from each touch"
    )
    latex = (
        r"\begin{array}{l} d = u + g z + g \left[w(t) - w(t_{\text{touch}})\right], \quad "
        r"\tau \dot z = u - z \\ w(t) = \sum_{\text{earlier}} \frac{2}{\pi} \arcsin \min\left(1, "
        r"\frac{\text{reach}}{\text{distance}}\right) z_{\text{end}} \, e^{-(t - t_{\text{end}}) / "
        r"\tau} \end{array}"
    )
    source = (
        "J. D. Ferry, Viscoelastic Properties of Polymers, Wiley 1980, ch. 1 (creep recovery, "
        "superposition); K. L. Johnson, Contact Mechanics, Cambridge 1985, sec. 3.8 (surface "
        "beside a punch)"
    )
    gives_away = "the tip sinks under a held force, less where the last press was near and recent"
    cure = "Wait several time constants after each press, or go on at a place far away."
    parameters = (
        EffectParameter("g", "1", "creep after a long time, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("tau_s", "s", "time constant", None, 1e-3, 1e3, 1.0, log=True),
        EffectParameter("reach_m", "m", "radius of the dent", None, 1e-6, 1.0, 0.005, log=True),
    )
    needs = ("time", "several presses")
    contains = ("viscoelasticity",)
    examples = (
        WorkedExample(
            "1 mm reached at once and held for 2 s, then the same 10 mm away after a pause of 2 s. "
            "With tau = 2 s z is 1 - 1/e at the end of each hold. A third of the first dent "
            "reaches the second press (asin(1/2) = pi/6), and goes from 1/e to 1/e^2 of its size "
            "during the hold: 0.63212 + 0.63212 / 3 (1/e^2 - 1/e) = 0.58312.",
            {"g": 0.2, "tau_s": 2.0, "reach_m": 0.005},
            {
                "press": (0.0, 0.0, 0.0, 1.0, 1.0, 1.0),
                "point_m": ((0.0, 0.0, 0.0),) * 3 + ((0.01, 0.0, 0.0),) * 3,
                "time_s": (1e-5, 2e-5, 2.00001, 4.00002, 4.00003, 6.00002),
                "force_n": (0.15, 0.3, 0.3, 0.15, 0.3, 0.3),
                "travel_m": (0.5e-3, 1e-3, 1e-3, 0.5e-3, 1e-3, 1e-3),
                "phase": ("load", "load", "hold", "load", "load", "hold"),
            },
            {"travel_m": (0.5e-3, 1e-3, 1.126424e-3, 0.5e-3, 1e-3, 1.116624e-3)},
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
        reach_m: float,
    ) -> np.ndarray:
        """Add g z and the dents of earlier presses nearby."""
        lagged = lagging(readings, travel_m, tau_s)
        since = readings.timed_s - readings.touch_time_s[readings.press]
        decayed = np.exp(-np.maximum(since, 0.0) / tau_s)
        if readings.travel_from != "plane":
            decayed = decayed - 1
        dent = _dents(readings, lagged, tau_s, reach_m)
        return travel_m + g * (lagged + dent[readings.press] * decayed)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Time constants over the timing of the scan, each with a narrow and a wide dent."""
        shortest, longest = _times(readings)
        count = 1 + int(np.ceil(np.log(longest / shortest) / np.log(_RATIO)))
        tip = float(np.median(readings.radius_m))
        return [
            {"tau_s": float(tau), "reach_m": reach * tip}
            for tau in np.geomspace(shortest, longest, count)
            for reach in _REACHES
        ]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the time constant by the timing of the scan, the dent by the tip."""
        g, tau, reach = self.parameters
        if readings.time_s is None:
            return self.parameters
        shortest, longest = _times(readings)
        tip = float(np.median(readings.radius_m))
        return (
            g,
            replace(tau, lower=shortest / 2, upper=2 * longest),
            replace(reach, lower=_NARROWEST * tip, upper=_WIDEST * tip, typical=tip),
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how strong and slow the creep is, and how far a dent reaches."""
        return (
            f"The tip sinks by {percent(values['g'])} in the end with a time constant of "
            f"{seconds(values['tau_s'])}, and the dent of a press, {length(values['reach_m'])} in "
            "radius, is still rising when the next press begins near it."
        )


def _dents(readings: Readings, lagged_m: np.ndarray, tau_s: float, reach_m: float) -> np.ndarray:
    """Depth (j,) that earlier presses have left at first touch of each press, over g, m.

    `lagged_m` (m,) are the lagging parts of all readings.
    """
    last = np.append(readings.first[1:], len(readings)) - 1
    begun, ended = readings.touch_time_s, readings.timed_s[last]
    passed = begun[:, None] - ended[None, :]
    nearness = np.arcsin(np.minimum(reach_m / np.maximum(readings.between_m, 1e-9), 1)) * 2 / np.pi
    left = nearness * np.exp(-np.maximum(passed, 0.0) / tau_s)
    return np.where(passed > 0, left, 0.0) @ lagged_m[last]


def _times(readings: Readings) -> tuple[float, float]:
    """Return the shortest and the longest time constant of the grid, s."""
    shortest, _ = time_constants(readings)
    return shortest, max(_LONGEST_PRESSES * readings.press_length_s, 4 * shortest)
