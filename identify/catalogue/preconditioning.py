"""Softening of the body from press to press."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent


class Preconditioning(Effect):
    """Travel grows with the order of the press, towards a limit."""

    name = "preconditioning"
    title = "Preconditioning"
    order = 20
    summary = (
        "Fresh tissue yields a little more with each press until it has settled. "
        "Presses made later in the scan therefore seem softer, wherever they are."
    )
    formula = "d = u (1 + p (1 - exp(-k / k0))),  k = 0, 1, ... the order of the press"
    latex = (
        r"d = u \left(1 + p \left(1 - e^{-k/k_0}\right)\right), \quad k = 0, 1, \ldots \text{ "
        r"the order of the press}"
    )
    source = (
        "Y. C. Fung, Biomechanics: Mechanical Properties of Living Tissues, Springer 1993, ch. 7 "
        "(preconditioning); the exponential is the simplest law that settles"
    )
    gives_away = "the misfit follows the order in which the presses were made, not their place"
    cure = (
        "Press a dozen times before the scan starts, visit the points in random order, "
        "and repeat the first presses at the end."
    )
    parameters = (
        EffectParameter("p", "1", "softening in the end, as a share", 0.0, 0.0, 5.0, 0.1),
        EffectParameter("k0", "presses", "presses to settle", None, 0.3, 1e4, 10.0, log=True),
    )
    needs = ("several presses",)
    examples = (
        WorkedExample(
            "After k0 = 10 presses 63 % of the softening of 20 % has happened: 1 mm becomes "
            "1.1264 mm, while the first press is as it was.",
            {"p": 0.2, "k0": 10.0},
            {"press": (0.0, 1.0), "order": (0.0, 10.0), "travel_m": 1e-3},
            {"travel_m": (1e-3, 1.126424e-3)},
        ),
    )

    def response(
        self, readings: Readings, force_n: np.ndarray, travel_m: np.ndarray, *, p: float, k0: float
    ) -> np.ndarray:
        """Scale each press's travel by its order."""
        settled = -np.expm1(-readings.order[readings.press] / k0)
        return travel_m * (1 + p * settled)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """From one press to as many as there are; beyond, the law is a straight line."""
        made = max(readings.presses_made, 2)
        count = 1 + int(np.ceil(np.log2(made)))
        return [{"k0": float(k0)} for k0 in np.geomspace(1, made, count)]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound k0 by twice the number of presses."""
        p, k0 = self.parameters
        most = 2.0 * max(readings.presses_made, 2)
        return p, replace(k0, lower=0.5, upper=most, typical=min(k0.typical, most / 4))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much softer the last presses are than the first."""
        last = values["p"] * -np.expm1(-(readings.presses_made - 1) / values["k0"])
        return (
            f"Later presses sink deeper whatever their place: the last ones by {percent(last)} "
            f"more than the first, settling over about {values['k0']:.2g} presses."
            f"{by_order_or_time(readings)}"
        )


def by_order_or_time(readings: Readings) -> str:
    """Caution where the presses were made at an even pace, else empty."""
    if not readings.even_pace:
        return ""
    return (
        " Order and time are nearly one in this scan: a sensor that reads ever less of the same "
        "force would look the same. Rest for a minute between some presses."
    )
