"""An effect of one's own: the force sensor's zero moves while it warms up, then stands still."""

import numpy as np

from palpmap import Effect, EffectParameter, WorkedExample


class WarmUp(Effect):
    """The zero starts right and ends `rise_n` too high."""

    name, title = "warm_up", "Warm-up of the force sensor"
    summary = "The force sensor warms up during the scan. Its zero moves fast at first, then rests."
    formula = "F = F_read - rise (1 - exp(-t / tau)),  t since the scan's first reading"
    source = "the sensor's data sheet"
    gives_away = "early presses misfit, late ones agree with each other"
    cure = "Switch the sensor on half an hour before the scan."
    parameters = (
        EffectParameter("rise_n", "N", "excess of the reading when warm", 0.0, -1.0, 1.0, 0.01),
        EffectParameter("tau_s", "s", "time to warm up", None, 1.0, 1e4, 30.0, log=True),
    )
    needs = ("time", "several presses")
    examples = (
        WorkedExample(
            "63 % of 0.02 N after tau = 60 s: 0.3 N read are 0.2874 N.",
            {"rise_n": 0.02, "tau_s": 60.0},
            {"time_s": (0.0, 60.0), "press": (0.0, 1.0), "force_n": 0.3},
            {"force_n": (0.3, 0.2873576)},
        ),
    )

    def force(self, readings, force_n, *, rise_n, tau_s):
        """Subtract the excess of the reading."""
        return force_n + rise_n * np.expm1(-readings.elapsed_s / tau_s)

    def grid(self, readings, state):
        """Try times from some presses to the whole scan."""
        scan_s = readings.elapsed_s[-1]
        return [{"tau_s": tau} for tau in np.geomspace(0.02 * scan_s, scan_s, 8)]
