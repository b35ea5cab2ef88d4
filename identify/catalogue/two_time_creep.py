"""Creep of the whole body with a fast and a slow part."""

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.viscoelasticity import lagging, time_constants
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent, seconds

_FAST, _RATIOS = 2.0, (4.0, 10.0, 30.0)  # factors between candidates, and of slow over fast


class TwoTimeCreep(Effect):
    """Linear creep with two relaxation times, the same at soft and stiff places."""

    name = "two_time_creep"
    family = "viscoelasticity"
    title = "Creep with two times"
    order = 11
    summary = (
        "The body yields fast at first and goes on slowly, as gels and tissues do whose fluid "
        "moves too. Two time constants describe it, for all places."
    )
    formula = (
        "d(t) = ∫ J(t - s) du(s),  J(t) = 1 + g_fast (1 - exp(-t / tau)) + "
        "g_slow (1 - exp(-t / (ratio tau)))"
    )
    latex = (
        r"d(t) = \int_0^t J(t - s) \, \mathrm{d}u(s), \quad J(t) = 1 + g_{\text{fast}} \left(1 - "
        r"e^{-t/\tau}\right) + g_{\text{slow}} \left(1 - e^{-t/(\text{ratio} \cdot \tau)}\right)"
    )
    source = (
        "J. D. Ferry, Viscoelastic Properties of Polymers, Wiley 1980, ch. 1 and 3 "
        "(generalized Voigt model)"
    )
    gives_away = "the tip sinks under a held force fast at first, and does not come to rest"
    cure = "Hold each press for several of the slow time constants and take the last readings."
    parameters = (
        EffectParameter("g_fast", "1", "fast creep in the end, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("g_slow", "1", "slow creep in the end, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("tau_s", "s", "fast time constant", None, 1e-3, 1e3, 1.0, log=True),
        EffectParameter("ratio", "1", "slow over fast time constant", None, 3.0, 300.0, 10.0,
                        log=True),
    )  # fmt: skip
    needs = ("time",)
    contains = ("viscoelasticity",)
    examples = (
        WorkedExample(
            "The travel rises by 1 mm/s from a touch at t = 0. The lagging parts are "
            "t - tau (1 - exp(-t / tau)): 0.80135 and 0.36788 mm at 1 s, 1.80001 and 1.13534 mm "
            "at 2 s for 0.2 s and 1 s; 5 % of the first and 10 % of the second are added.",
            {"g_fast": 0.05, "g_slow": 0.1, "tau_s": 0.2, "ratio": 5.0},
            {"time_s": (1.0, 2.0), "force_n": (0.1, 0.2), "travel_m": (1e-3, 2e-3)},
            {"travel_m": (1.0768553e-3, 2.2035340e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        g_fast: float,
        g_slow: float,
        tau_s: float,
        ratio: float,
    ) -> np.ndarray:
        """Add the two lagging parts."""
        fast = lagging(readings, travel_m, tau_s)
        return travel_m + g_fast * fast + g_slow * lagging(readings, travel_m, ratio * tau_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Fast times over the scan's timing, each with slow ones up to a few presses."""
        shortest, longest = time_constants(readings)
        count = 1 + int(np.ceil(np.log(longest / shortest) / np.log(_FAST)))
        return [
            {"tau_s": float(tau), "ratio": ratio}
            for tau in np.geomspace(shortest, longest, count)
            for ratio in _RATIOS
            if ratio * tau <= 2 * longest
        ]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the fast time constant by the timing of the scan."""
        if readings.time_s is None:
            return self.parameters
        *parts, tau, ratio = self.parameters
        shortest, longest = time_constants(readings)
        tau = EffectParameter(
            tau.name, tau.unit, tau.meaning, None, shortest / 2, longest, 1.0, log=True
        )
        return *parts, tau, ratio

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how strong and how slow the two parts are."""
        fast, slow = values["tau_s"], values["tau_s"] * values["ratio"]
        return (
            f"Under a held force the tip sinks by {percent(values['g_fast'])} with a time constant "
            f"of {seconds(fast)} and by {percent(values['g_slow'])} with {seconds(slow)}, at soft "
            "and stiff places alike."
        )
