"""A force sensor that reads too little at high force."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import force, percent

_SHARPNESS = (1.0, 1.6, 2.5, 4.0, 6.3, 10.0, 16.0, 25.0)


class ForceSaturation(Effect):
    """A loss that grows with a power of the reading.

    Sharpness 1 is a quadratic loss and 2 the first term of a tanh; high ones are almost
    clipping, which cannot be undone: a clipped reading holds no information, and its noise is
    multiplied by the slope 1 + loss (sharpness + 1).
    """

    name = "force_saturation"
    title = "Saturation of the force sensor"
    order = 50
    summary = (
        "The sensor reads too little at high force, as near the end of its range. "
        "The body seems to give way once the force is high, everywhere at the same force."
    )
    formula = "F = F_read (1 + loss |F_read / Fref|^sharpness),  Fref the scan's largest force read"
    latex = (
        r"F = F_{\text{read}} \left(1 + \text{loss} "
        r"\left|\frac{F_{\text{read}}}{F_{\text{ref}}}\right|^{\text{sharpness}}\right)"
    )
    source = (
        "J. Fraden, Handbook of Modern Sensors, Springer 2016, ch. 3 (saturation, nonlinearity); "
        "the power law is the simplest loss of one size and one shape"
    )
    gives_away = "travel runs away from a certain force on, the same at soft and stiff places"
    cure = "Calibrate with weights up to the largest force, or take a sensor of wider range."
    parameters = (
        EffectParameter("loss", "1", "force not read at the largest force", 0.0, 0.0, 2.0, 0.03),
        EffectParameter(
            "sharpness", "1", "power of the reading: 1 gradual, 10 sudden", None, 0.7, 40.0, 2.0,
            log=True,
        ),
    )  # fmt: skip
    needs = ("several forces",)
    examples = (
        WorkedExample(
            "A tenth is lost at 0.2 N, with the square of the reading: 0.2 N read are 0.22 N, and "
            "0.1 N read are 0.1 (1 + 0.1 / 4) = 0.1025 N.",
            {"loss": 0.1, "sharpness": 2.0},
            {"force_n": (0.1, 0.2)},
            {"force_n": (0.1025, 0.22)},
        ),
    )

    def force(
        self, readings: Readings, force_n: np.ndarray, *, loss: float, sharpness: float
    ) -> np.ndarray:
        """Add the lost force."""
        level = np.abs(force_n) / max(readings.scales.force_n, 1e-9)
        return force_n * (1 + loss * level**sharpness)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """From a gradual loss to almost clipping."""
        return [{"sharpness": sharpness} for sharpness in _SHARPNESS]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the loss such that noise in the reading is at most multiplied by ten or so."""
        loss, sharpness = self.parameters
        return replace(loss, upper=1.0), sharpness

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say the loss of the sensor at the largest force and at half of it."""
        loss, n = values["loss"], values["sharpness"]
        share, half = loss / (1 + loss), loss * 0.5**n / (1 + loss * 0.5**n)
        most = force(readings.scales.force_n)
        return (
            f"The sensor reads {percent(share)} too little at {most} and "
            f"{percent(half)} too little at half of that: travel runs ahead of the force as it "
            "grows, at soft and stiff places alike."
        )
