"""A force sensor whose zero wanders towards a limit while it warms up."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force, more, seconds

_RATIO = 1.6  # between neighbouring time constants of the grid
_SHORTEST, _LONGEST = 1 / 50, 1.0  # time constants of the grid, of the scan's length


class ForceWarmUp(Effect):
    """An exponential approach of the zero to its value in a warm sensor."""

    name = "force_warm_up"
    family = "force_drift"
    title = "Warm-up of the force sensor"
    order = 31
    summary = (
        "The sensor's zero moves fast after switching on and settles as the sensor warms up. "
        "Early presses are wrong, late ones hardly."
    )
    formula = "F = F_read - zero (1 - exp(-t / tau)),  t since the first reading of the scan"
    latex = r"F = F_{\text{read}} - \text{zero} \left(1 - e^{-t/\tau}\right)"
    source = (
        "International Vocabulary of Metrology, JCGM 200:2012, 4.21 (instrumental drift); "
        "the exponential is Newton's law of cooling"
    )
    gives_away = "the misfit moves with time, fast at first, by the same force whatever the force"
    cure = "Switch the sensor on an hour before the scan, and zero it in the air before each press."
    parameters = (
        EffectParameter("zero_n", "N", "growth of the reading in the end", 0.0, -1.0, 1.0, 0.01),
        EffectParameter("tau_s", "s", "time constant", None, 1.0, 1e5, 100.0, log=True),
    )
    needs = ("time", "several presses")
    contains = ("force_drift",)
    examples = (
        WorkedExample(
            "10 mN with a time constant of 100 s: after 100 s 63 % of it, so that 0.3 N read are "
            "0.29368 N.",
            {"zero_n": 0.01, "tau_s": 100.0},
            {"time_s": (7.0, 107.0), "press": (0.0, 1.0), "force_n": 0.3},
            {"force_n": (0.3, 0.2936788)},
        ),
    )

    def force(
        self, readings: Readings, force_n: np.ndarray, *, zero_n: float, tau_s: float
    ) -> np.ndarray:
        """Take the drift off."""
        return force_n + zero_n * np.expm1(-readings.elapsed_s / tau_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Time constants from a fiftieth of the scan to all of it; beyond, the law is straight."""
        length = float(readings.elapsed_s.max())
        count = 1 + int(np.ceil(np.log(_LONGEST / _SHORTEST) / np.log(_RATIO)))
        spread = np.geomspace(_SHORTEST * length, _LONGEST * length, count)
        return [{"tau_s": float(tau)} for tau in spread]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the zero by the largest force, the time constant by the scan's length."""
        if readings.time_s is None:
            return self.parameters
        zero, tau = self.parameters
        most = 3 * max(readings.largest_force_n, 1e-3)
        length = max(float(readings.elapsed_s.max()), 1e-3)
        return (
            replace(zero, lower=-most, upper=most, typical=0.01 * most),
            replace(tau, lower=_SHORTEST * length / 4, upper=4 * _LONGEST * length, typical=length),
        )

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far the zero went, and how soon."""
        zero, tau = values["zero_n"], values["tau_s"]
        gone = -zero * np.expm1(-float(readings.elapsed_s.max()) / tau)
        return (
            f"The force sensor's reading {more(zero, 'rises', 'falls')} by {force(abs(gone))} over "
            f"the scan, with a time constant of {seconds(tau)}, at every place."
        )
