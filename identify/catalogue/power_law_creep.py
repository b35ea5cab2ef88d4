"""Creep of the whole body without a time constant: a power of time."""

import numba
import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent

_EXPONENTS = np.array([0.05, 0.1, 0.18, 0.28, 0.4, 0.53, 0.66, 0.8])


class PowerLawCreep(Effect):
    """Linear creep on all time scales at once (a fractional element beside a spring)."""

    name = "power_law_creep"
    family = "viscoelasticity"
    title = "Creep by a power of time"
    order = 12
    summary = (
        "The body goes on yielding under a constant force on all time scales, and never comes to "
        "rest. Its creep is described by its strength after one second and an exponent."
    )
    formula = "d(t) = ∫ J(t - s) du(s),  J(t) = 1 + g (t / 1 s)^alpha"
    latex = (
        r"d(t) = \int_0^t J(t - s) \, \mathrm{d}u(s), \quad J(t) = 1 + g \left(\frac{t}{1\,"
        r"\text{s}}\right)^{\alpha}"
    )
    source = (
        "A. Bonfanti, J. L. Kaplan, G. Charras, A. Kabla, Soft Matter 16 (2020) 6002-6020 "
        "(fractional models of soft matter)"
    )
    gives_away = "the tip keeps sinking under a held force, in equal steps for each doubled time"
    cure = (
        "Read all presses at the same time after touch, or press at two clearly different speeds."
    )
    parameters = (
        EffectParameter("g", "1", "creep after 1 s, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("alpha", "1", "exponent", None, 0.03, 0.9, 0.3),
    )
    needs = ("time",)
    examples = (
        WorkedExample(
            "The travel rises by 1 mm/s from a touch at t = 0: t^1.5 / 1.5 = 0.66667 mm at 1 s "
            "and 1.88562 mm at 2 s; a tenth of it is added.",
            {"g": 0.1, "alpha": 0.5},
            {"time_s": (1.0, 2.0), "force_n": (0.1, 0.2), "travel_m": (1e-3, 2e-3)},
            {"travel_m": (1.0666667e-3, 2.1885618e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        g: float,
        alpha: float,
    ) -> np.ndarray:
        """Add the creep, exact for a travel that is straight between the readings."""
        return travel_m + g * _power_creep(readings, travel_m, alpha)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Exponents from nearly a logarithm to nearly a fluid."""
        return [{"alpha": float(alpha)} for alpha in _EXPONENTS]

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much the tip sinks within a second, and with each doubling of the time."""
        g, alpha = values["g"], values["alpha"]
        return (
            f"Under a held force the tip sinks by {percent(g)} in the first second and by "
            f"{percent(2**alpha - 1)} of that more with each doubling of the time."
        )


def _power_creep(readings: Readings, travel_m: np.ndarray, alpha: float) -> np.ndarray:
    """Integral (m,) of (t - s)^alpha du(s) since touch, times in s, u straight between readings."""
    u = np.ascontiguousarray(travel_m, float)
    return _crept(readings.first, readings.timed_s, readings.touch_time_s, u, float(alpha))


@numba.njit(cache=True)
def _crept(first, time_s, touch_s, travel_m, alpha):
    crept = np.zeros_like(travel_m)
    for j in range(len(first)):
        begin = first[j]
        for i in range(begin, first[j + 1] if j + 1 < len(first) else len(crept)):
            since, u = touch_s[j], 0.0
            age = max(time_s[i] - since, 0.0) ** (1 + alpha)
            for k in range(begin, i + 1):
                step, older = time_s[k] - since, age
                age = max(time_s[i] - time_s[k], 0.0) ** (1 + alpha)
                if step > 0:
                    crept[i] += (travel_m[k] - u) / step * (older - age) / (1 + alpha)
                since, u = time_s[k], travel_m[k]
    return crept
