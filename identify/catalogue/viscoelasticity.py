"""Creep of the whole body: one relaxation time, the same at soft and stiff places."""

import math

import numba
import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent, seconds

_RATIO = 1.5  # between neighbouring time constants of the grid
_SHORTEST_S, _LONGEST_S = 0.05, 30.0


class Viscoelasticity(Effect):
    """Linear creep; with a constant Poisson's ratio it is one factor for all of the body."""

    name = "viscoelasticity"
    title = "Creep (viscoelasticity)"
    order = 10
    summary = (
        "The body goes on yielding under a constant force and lags behind a changing one. "
        "Its creep is described by one strength and one time constant for all places."
    )
    formula = "d(t) = ∫ J(t - s) du(s),  J(t) = 1 + g (1 - exp(-t / tau)), u the elastic travel"
    latex = (
        r"d(t) = \int_0^t J(t - s) \, \mathrm{d}u(s), \quad J(t) = 1 + g \left(1 - "
        r"e^{-t/\tau}\right)"
    )
    source = (
        "E. H. Lee, J. R. M. Radok, J. Appl. Mech. 27 (1960) 438-444; quasi-linear form: "
        "Y. C. Fung, Biomechanics: Mechanical Properties of Living Tissues, Springer 1993, ch. 7"
    )
    gives_away = "the tip keeps sinking while the force is held, fast at first, then more slowly"
    cure = (
        "Hold each press for several time constants and take the last readings, "
        "or press at two clearly different speeds."
    )
    parameters = (
        EffectParameter("g", "1", "creep after a long time, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("tau_s", "s", "time constant", None, 1e-3, 1e3, 1.0, log=True),
    )
    needs = ("time",)
    examples = (
        WorkedExample(
            "The travel rises by 1 mm/s from a touch at t = 0. The lagging part is "
            "z = t - tau (1 - exp(-t / tau)) = 0.36788 mm at 1 s and 1.13534 mm at 2 s for "
            "tau = 1 s; a tenth of it is added.",
            {"g": 0.1, "tau_s": 1.0},
            {"time_s": (1.0, 2.0), "force_n": (0.1, 0.2), "travel_m": (1e-3, 2e-3)},
            {"travel_m": (1.036788e-3, 2.113534e-3)},
        ),
        WorkedExample(
            "1 mm reached in 1 ms and held: after one time constant z = 1 - 1/e, so that 20 % "
            "creep adds 0.1264 mm.",
            {"g": 0.2, "tau_s": 2.0},
            {
                "time_s": (1e-5, 2e-5, 2.00001),
                "force_n": (0.15, 0.3, 0.3),
                "travel_m": (0.5e-3, 1e-3, 1e-3),
                "phase": ("load", "load", "hold"),
            },
            {"travel_m": (0.5e-3, 1e-3, 1.126424e-3)},
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
    ) -> np.ndarray:
        """Add g z, where z lags behind the travel."""
        return travel_m + g * lagging(readings, travel_m, tau_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Time constants from half a sampling step to a few presses, evenly in the logarithm."""
        shortest, longest = time_constants(readings)
        count = 1 + int(np.ceil(np.log(longest / shortest) / np.log(_RATIO)))
        return [{"tau_s": float(tau)} for tau in np.geomspace(shortest, longest, count)]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the time constant by the timing of the scan."""
        g, tau = self.parameters
        if readings.time_s is None:
            return g, tau
        shortest, longest = time_constants(readings)
        return g, EffectParameter(
            tau.name, tau.unit, tau.meaning, None, shortest / 2, longest * 2, 1.0, log=True
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say by how much the tip sinks during the holds, or else after a long time."""
        g, tau = values["g"], values["tau_s"]
        crept = _creep_of_holds(readings, g, tau)
        place = "at soft and stiff places alike"
        if crept is None:
            return (
                f"The travel lags behind the force, by {percent(g)} with a time constant of "
                f"{seconds(tau)}, {place}."
            )
        return (
            f"The tip keeps sinking during every hold, by {percent(crept)} with a time constant "
            f"of {seconds(tau)}, {place} (a hold without end would add {percent(g)})."
        )


def lagging(readings: Readings, travel_m: np.ndarray, tau_s: float) -> np.ndarray:
    """Solve tau dz/dt = u - z for z (m,), u piecewise linear, nothing at first touch.

    Closed form over a step h from (u0, z0) to u: z = u - (u0 - z0) e - (u - u0) (1 - e) tau / h,
    e = exp(-h / tau).
    """
    u = np.ascontiguousarray(travel_m, float)
    return _lagging(readings.first, readings.timed_s, readings.touch_time_s, u, float(tau_s))


@numba.njit(cache=True)
def _lagging(first, time_s, touch_s, travel_m, tau_s):
    z = np.zeros_like(travel_m)
    for j in range(len(first)):
        before, u0, z0 = touch_s[j], 0.0, 0.0
        for i in range(first[j], first[j + 1] if j + 1 < len(first) else len(z)):
            x, u = (time_s[i] - before) / tau_s, travel_m[i]
            mean = -math.expm1(-x) / x if x > 0 else 1.0  # of exp(-s / tau) over the step
            z[i] = u - (u0 - z0) * math.exp(-x) - (u - u0) * mean
            before, u0, z0 = time_s[i], u, z[i]
    return z


def time_constants(readings: Readings) -> tuple[float, float]:
    """Return the shortest and the longest time constant that the scan can show, s."""
    shortest = float(np.clip(0.5 * readings.sampling_step_s, _SHORTEST_S, _LONGEST_S / 10))
    longest = float(np.clip(4 * readings.press_length_s, 4 * shortest, _LONGEST_S))
    return shortest, longest


def _creep_of_holds(readings: Readings, g: float, tau: float) -> float | None:
    """Mean growth of the travel from the first to the last held reading, as a share."""
    held = np.flatnonzero(readings.phase == "hold")
    if held.size == 0:
        return None
    first = held[np.searchsorted(readings.press[held], np.unique(readings.press[held]))]
    last = held[np.searchsorted(readings.press[held], np.unique(readings.press[held]), "right") - 1]
    steady = np.where(readings.phase == "hold", readings.peak_force_n, readings.force_n)
    z = lagging(readings, steady, tau)
    size = readings.peak_force_n[first]
    growth = g * (z[last] - z[first])[size > 0] / size[size > 0]
    return float(growth.mean()) if growth.size else None
