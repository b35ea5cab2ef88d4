"""A body that grows stiffer with depth by any law."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Pressing, Values, WorkedExample
from identify.effects.monotone import PLACES, bent
from identify.effects.readings import Readings
from identify.effects.units import percent


class FreeStiffening(Effect):
    """The slope of the law, force by depth over radius, rises in any way from that at touch."""

    name = "free_stiffening"
    family = "strain_stiffening"
    title = "Stiffening of free shape"
    order = 31
    summary = (
        "The tissue grows stiffer with strain, and by no law of one number: slowly at first and "
        "then steeply, as fibres do that are straightened, or at first and then no more. "
        "The force that a further bit of depth costs is any smooth function of the depth that "
        "never falls."
    )
    formula = "d = a ∫ dx / (1 + S(x / x_max)) from 0 to C F / a,  S a rising spline, S(0) = 0"
    latex = (
        r"d = a \int_0^{C F / a} \frac{\mathrm{d}x}{1 + S(x / x_{\max})}, \quad S' \ge 0, \quad "
        r"S(0) = 0"
    )
    source = (
        "free form of Fung's law (Y. C. Fung, Am. J. Physiol. 213 (1967) 1532-1544); rising "
        "splines: J. O. Ramsay, Statist. Sci. 3 (1988) 425-441"
    )
    gives_away = "each further bit of depth costs more force than the last, most at soft places"
    cure = "Press less deep, use a larger tip, or keep the law and press to several forces."
    parameters = tuple(
        EffectParameter(f"rise_{number}", "1", f"rise of the stiffness {place}", 0.0, 0.0, 10.0,
                        0.1)
        for number, place in enumerate(PLACES, 1)
    )  # fmt: skip
    needs = ("several forces",)
    contains = ("strain_stiffening",)
    any_shape = True
    examples = (
        WorkedExample(
            "a = 5 mm; rises of 1/6, 1/3, 1/3 and 1/6 make S = x over a depth of a: the law is "
            "5 ln(1 + u / 5 mm) then, and u = 8.591 mm goes 5 mm deep.",
            {"rise_1": 1 / 6, "rise_2": 1 / 3, "rise_3": 1 / 3, "rise_4": 1 / 6},
            {"force_n": 0.3, "travel_m": 8.591409e-3, "contact_radius_m": 5e-3},
            {"travel_m": 5e-3},
        ),
    )

    def contact(
        self,
        readings: Readings,
        pressing: Pressing,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        rise_1: float,
        rise_2: float,
        rise_3: float,
        rise_4: float,
    ) -> np.ndarray:
        """Bend the travel by its share of the scan's largest depth over radius."""
        whole = readings.scales.depth * pressing.radius_m
        return whole * bent(travel_m / whole, (rise_1, rise_2, rise_3, rise_4), stiffer=True)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how much stiffer the body is at half of the largest depth, and there."""
        rises = [values[p.name] for p in self.parameters]
        half = rises[0] + 0.875 * rises[1] + 0.125 * rises[2]  # areas of the hats before it
        return (
            "The deeper the tip, the more force each further bit of travel costs: "
            f"{percent(half)} more half way and {percent(sum(rises))} more at the largest depth "
            "than at the first touch, so that soft places are bent most."
        )
