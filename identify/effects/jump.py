"""Steps at one instant of the scan."""

from dataclasses import replace

import numpy as np
from scipy.special import expit

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values
from identify.effects.readings import Readings

_STEP = 0.03  # of a press's time: a third of the rise of a step
_EDGE = 3  # presses on either side of a step, at least


class Jump(Effect):
    """Base of effects with a height and the instant `at_s` of a step."""

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Middles of the pauses between two presses, but for those near the ends of the scan."""
        first = readings.first[_EDGE : readings.presses - _EDGE + 1]
        middles = 0.5 * (readings.elapsed_s[first - 1] + readings.elapsed_s[first])
        return [{"at_s": at} for at in middles.tolist()]

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the instant by the presses that it needs on either side.

        A step before all presses would be an offset of all of them. Its scale is the time of a
        press.
        """
        height, at = self.parameters
        if readings.time_s is None:
            return height, at
        time, first = readings.elapsed_s, readings.first
        end, low = max(float(time.max()), 1e-3), 0.0
        high, scale = end, end / readings.presses
        if readings.presses > 2 * _EDGE:
            low, high = float(time[first[_EDGE] - 1]), float(time[first[-_EDGE]])
        return height, replace(at, lower=low, upper=high, typical=scale)


def step_in_time(readings: Readings, at_s: float) -> np.ndarray:
    """Return a step (m,) from 0 to 1 at an instant of the scan's clock.

    It takes a tenth of the time of a press, so that its instant can be sought.
    """
    width = _STEP * max(readings.scales.pace_s, 1e-9)
    return expit((readings.elapsed_s - at_s) / width)
