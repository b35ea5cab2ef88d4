"""Softening of the body from press to press by any law that settles."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.monotone import PLACES, risen
from identify.effects.readings import Readings
from identify.effects.units import percent


class FreePreconditioning(Effect):
    """Travel grows with the logarithm of the press's number along any curve that never falls."""

    name = "free_preconditioning"
    family = "preconditioning"
    title = "Preconditioning of free shape"
    order = 22
    summary = (
        "Fresh tissue yields a little more with each press, and by no law of one exponential: at "
        "once and then slowly, evenly until it has settled, or without an end. The softening is "
        "any smooth function of the logarithm of the press's number that never falls."
    )
    formula = "d = u (1 + S(ln(1 + k) / ln(1 + k_max))),  S a rising spline, S(0) = 0"
    latex = (
        r"d = u \left(1 + S\left(\frac{\ln(1 + k)}{\ln(1 + k_{\max})}\right)\right), \quad S' \ge "
        r"0, \quad S(0) = 0"
    )
    source = (
        "free form of the exponential that settles (Y. C. Fung, Biomechanics: Mechanical "
        "Properties of Living Tissues, Springer 1993, ch. 7); rising splines: J. O. Ramsay, "
        "Statist. Sci. 3 (1988) 425-441"
    )
    gives_away = "the misfit follows the order in which the presses were made, not their place"
    cure = (
        "Press a dozen times before the scan starts, visit the points in random order, and rest "
        "for a minute now and then, which separates the order from time."
    )
    parameters = tuple(
        EffectParameter(f"rise_{number}", "1", f"rise of the softening {place}", 0.0, 0.0, 5.0,
                        0.05)
        for number, place in enumerate(PLACES, 1)
    )  # fmt: skip
    needs = ("several presses",)
    contains = ("preconditioning",)
    examples = (
        WorkedExample(
            "Rises of 1/60, 1/30, 1/30 and 1/60 make S = x / 10: of the presses 0, 3 and 15 the "
            "last has all, and the second ln 4 / ln 16 = a half, of the softening of 10 %.",
            {"rise_1": 1 / 60, "rise_2": 1 / 30, "rise_3": 1 / 30, "rise_4": 1 / 60},
            {"press": (0.0, 1.0, 2.0), "order": (0.0, 3.0, 15.0), "travel_m": 1e-3},
            {"travel_m": (1e-3, 1.05e-3, 1.1e-3)},
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
        rise_4: float,
    ) -> np.ndarray:
        """Scale each press's travel by its order."""
        settled = risen(_level(readings), (rise_1, rise_2, rise_3, rise_4))
        return travel_m * (1 + settled[readings.press])

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much softer the last presses are than the first, and when that came about."""
        rises = [values[p.name] for p in self.parameters]
        last = sum(rises)
        settled = risen(_level(readings), rises)
        half = int(readings.order[np.argmin(np.abs(settled - last / 2))])
        return (
            f"Later presses sink deeper whatever their place: the last ones by {percent(last)} "
            f"more than the first, half of it by press {half + 1}."
        )


def _level(readings: Readings) -> np.ndarray:
    """Logarithm of each press's number over that of the scan's last, (j,)."""
    return np.log1p(readings.order) / np.log1p(max(readings.scales.presses - 1, 1))
