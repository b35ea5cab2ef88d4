"""A force channel behind a filter: late, and slow to follow a corner."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.catalogue.time_lag import growth_over, longest_lag_s
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import percent

_LEAST = 0.3  # as of eleven equal stages: hardly different from a pure delay, which is `time_lag`
_SHARES = (0.3, 0.5, 0.75, 1.0)


class FilteredForce(Effect):
    """A force channel that is late as a whole, and of that lag a share is a low-pass's."""

    name = "filtered_force"
    family = "time_lag"
    title = "Force behind a low-pass filter"
    order = 6
    summary = (
        "The amplifier or the converter smooths the force, which is therefore late, and comes to "
        "each new course only gradually. A filter of several stages, or a mean over a window, lies "
        "between a pure delay and a low-pass of first order."
    )
    formula = (
        "tau dF_read/dt = F(t - lag + tau) - F_read,  tau = share lag,  undone along the course "
        "of each phase of a press"
    )
    latex = (
        r"\tau \, \dot F_{\text{read}} = F(t - \text{lag} + \tau) - F_{\text{read}}, \quad \tau = "
        r"\text{share} \cdot \text{lag}"
    )
    source = (
        "J. Schoukens, R. Pintelon, Y. Rolain, Mastering System Identification in 100 Exercises, "
        "IEEE Press 2012, ch. 1; the response of a first-order system to a ramp is elementary"
    )
    gives_away = "the misfit follows the speed of the force, and dies away after each corner"
    cure = "Widen the filter's band, press slowly, and hold before each reading."
    parameters = (
        EffectParameter("lag_s", "s", "delay of the force channel", 0.0, 0.0, 0.5, 0.02),
        EffectParameter("share", "1", "share of it that is the low-pass's", None, _LEAST, 1.0, 0.5,
                        natural="both"),
    )  # fmt: skip
    needs = ("time", "several forces")
    contains = ("time_lag",)
    examples = (
        WorkedExample(
            "The force rises by 0.1 N/s from a touch at t = 0; long after it, a reading 0.5 s late "
            "is 0.05 N low, whatever makes it late.",
            {"lag_s": 0.5, "share": 0.3},
            {"time_s": (8.0, 9.0, 10.0), "force_n": (0.8, 0.9, 1.0)},
            {"force_n": (0.85, 0.95, 1.05)},
        ),
    )

    def force(
        self, readings: Readings, force_n: np.ndarray, *, lag_s: float, share: float
    ) -> np.ndarray:
        """Add the force's growth over the lag, and what it lacks of it after each corner."""
        return force_n + growth_over(readings, lag_s, share * lag_s)

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """From a delay that is hardly smoothed to a low-pass of first order."""
        return [{"share": share} for share in _SHARES]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the lag by a part of a press."""
        lag, share = self.parameters
        return (replace(lag, upper=longest_lag_s(readings, lag.upper)), share)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how late the force is, and how much of that a filter makes."""
        return (
            f"The force lies {1e3 * values['lag_s']:.0f} ms behind the displacement, at every "
            f"place, and comes to a new course gradually: {percent(values['share'])} of the lag "
            "is a low-pass's."
        )
