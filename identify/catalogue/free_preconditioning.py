"""Softening of the body from press to press by any law that settles."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.preconditioning import by_order_or_time
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.monotone import risen
from identify.effects.readings import Readings
from identify.effects.units import percent

_PLACES = ("at the start", "half way", "at the end")


class FreePreconditioning(Effect):
    """Travel grows with the logarithm of the press's number by any curve that never falls."""

    name = "free_preconditioning"
    family = "preconditioning"
    title = "Preconditioning of free shape"
    order = 22
    summary = (
        "Fresh tissue yields a little more with each press, and by no single exponential: at once "
        "and then ever more slowly, or by even steps until it has settled. The softening is any "
        "smooth curve over the logarithm of the press's number that never falls, up to a press "
        "from which on the body stays as it is."
    )
    formula = "d = u (1 + S(ln(1 + k) / ln(1 + k0))),  S a rising spline, S(0) = 0, constant from 1"
    latex = (
        r"d = u \left(1 + S\left(\frac{\ln(1 + k)}{\ln(1 + k_0)}\right)\right), \quad S' \ge 0, "
        r"\quad S(0) = 0, \quad S(x > 1) = S(1)"
    )
    source = (
        "free form of the exponential that settles (Y. C. Fung, Biomechanics: Mechanical "
        "Properties of Living Tissues, Springer 1993, ch. 7); rising splines: J. O. Ramsay, "
        "Statist. Sci. 3 (1988) 425-441"
    )
    gives_away = "the misfit follows the order in which the presses were made, not their place"
    cure = (
        "Press a dozen times before the scan starts, visit the points in random order, "
        "and repeat the first presses at the end."
    )
    parameters = (
        *(
            EffectParameter(f"rise_{number}", "1", f"rise of the softening {place}", 0.0, 0.0, 5.0,
                            0.05)
            for number, place in enumerate(_PLACES, 1)
        ),
        EffectParameter("k0", "presses", "presses to settle wholly", None, 4.0, 1e4, 10.0,
                        log=True),
    )  # fmt: skip
    needs = ("several presses",)
    contains = ("preconditioning",)
    examples = (
        WorkedExample(
            "Rises of 2.5, 5 and 2.5 % make S = x / 10 up to press 15: press 3 has "
            "ln 4 / ln 16 = a half of the softening of 10 %, presses 15 and 40 have all of it.",
            {"rise_1": 0.025, "rise_2": 0.05, "rise_3": 0.025, "k0": 15.0},
            {
                "press": (0.0, 1.0, 2.0, 3.0),
                "order": (0.0, 3.0, 15.0, 40.0),
                "travel_m": 1e-3,
            },
            {"travel_m": (1e-3, 1.05e-3, 1.1e-3, 1.1e-3)},
        ),
    )

    def response(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        rise_1: float,
        rise_2: float,
        rise_3: float,
        k0: float,
    ) -> np.ndarray:
        """Scale each press's travel by its order."""
        level = np.log1p(readings.order) / np.log1p(k0)
        return travel_m * (1 + risen(level, (rise_1, rise_2, rise_3))[readings.press])

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """From a few presses to as many as there are."""
        return [{"k0": float(k0)} for k0 in np.geomspace(5, _last(readings), 12)]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound k0 by the number of the last press."""
        *rises, k0 = self.parameters
        most = _last(readings)
        return (*rises, replace(k0, upper=most, typical=min(k0.typical, most / 2)))

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much softer the last presses are than the first, and when they have settled."""
        last = sum(values[f"rise_{number}"] for number in (1, 2, 3))
        return (
            f"Later presses sink deeper whatever their place: the last ones by {percent(last)} "
            f"more than the first, settled after {values['k0']:.2g} presses."
            f"{by_order_or_time(readings)}"
        )


def _last(readings: Readings) -> float:
    return float(max(readings.presses_made - 1, 6))
