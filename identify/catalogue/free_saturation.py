"""A force sensor that reads too little at high force, by any curve."""

import numpy as np

from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.monotone import PLACES, bent
from identify.effects.readings import Readings
from identify.effects.units import force, percent


class FreeSaturation(Effect):
    """The force by a further bit of the reading rises in any way from that at no force."""

    name = "free_saturation"
    family = "force_saturation"
    title = "Saturation of free shape"
    order = 51
    summary = (
        "The sensor reads too little at high force, by a curve of any shape that bends one way. "
        "The body seems to give way once the force is high, everywhere at the same force."
    )
    formula = "F = ∫ (1 + S(f / Fref)) df from 0 to F_read,  S a rising spline, S(0) = 0"
    latex = (
        r"F = \int_0^{F_{\text{read}}} \left(1 + S(f / F_{\text{ref}})\right) \mathrm{d}f, \quad "
        r"S' \ge 0, \quad S(0) = 0"
    )
    source = (
        "J. Fraden, Handbook of Modern Sensors, Springer 2016, ch. 3 (saturation, nonlinearity); "
        "rising splines: J. O. Ramsay, Statist. Sci. 3 (1988) 425-441"
    )
    gives_away = "travel runs away from a certain force on, the same at soft and stiff places"
    cure = "Calibrate with weights up to the largest force, or take a sensor of wider range."
    parameters = tuple(
        EffectParameter(f"rise_{number}", "1", f"rise of the force by the reading {place}", 0.0,
                        0.0, 5.0, 0.03)
        for number, place in enumerate(PLACES, 1)
    )  # fmt: skip
    needs = ("several forces",)
    contains = ("force_saturation",)
    any_shape = True
    examples = (
        WorkedExample(
            "Rises of 1/30, 1/15, 1/15 and 1/30 make S = 0.2 f / Fref: 0.2 N read are "
            "0.2 (1 + 0.1) = 0.22 N, and 0.1 N are 0.1 (1 + 0.05) = 0.105 N.",
            {"rise_1": 1 / 30, "rise_2": 1 / 15, "rise_3": 1 / 15, "rise_4": 1 / 30},
            {"force_n": (0.1, 0.2)},
            {"force_n": (0.105, 0.22)},
        ),
    )

    def force(
        self,
        readings: Readings,
        force_n: np.ndarray,
        *,
        rise_1: float,
        rise_2: float,
        rise_3: float,
        rise_4: float,
    ) -> np.ndarray:
        """Add the lost force."""
        whole = max(readings.scales.force_n, 1e-9)
        return whole * bent(force_n / whole, (rise_1, rise_2, rise_3, rise_4), stiffer=False)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the loss of the sensor at the largest force and at half of it."""
        rises = [values[p.name] for p in self.parameters]
        full, half = (bent(np.array([level]), rises, stiffer=False)[0] for level in (1.0, 0.5))
        most = force(readings.scales.force_n)
        return (
            f"The sensor reads {percent(1 - 1 / full)} too little at {most} and "
            f"{percent(1 - 0.5 / half)} too little at half of that: travel runs ahead of the force "
            "as it grows, at soft and stiff places alike."
        )
