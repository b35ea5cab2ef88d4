"""Two channels with different delays: force and displacement do not belong to one instant."""

from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import LocalLines
from identify.effects.units import more

_LONGEST = 0.25  # of the median press
_INSTANT_S = 1e-3  # a reading that close to a corner stays on its side


class TimeLag(Effect):
    """A force channel behind the displacement, or ahead of it, by a constant time."""

    name = "time_lag"
    title = "Lag between force and displacement"
    order = 5
    summary = (
        "The force of a row was measured earlier or later than its displacement, as with a filter "
        "in the sensor or two clocks. Loading and unloading part in proportion to the speed."
    )
    formula = "F(t) = F_read(t + lag),  along the course of each phase of a press"
    latex = r"F(t) = F_{\text{read}}(t + \text{lag})"
    source = (
        "J. Schoukens, R. Pintelon, Y. Rolain, Mastering System Identification in 100 Exercises, "
        "IEEE Press 2012, ch. 1 (synchronous measurements); the shift itself is a definition"
    )
    gives_away = "the misfit follows the speed of the force: one sign in loading, the other back"
    cure = "Record both channels with one clock, or press slowly and hold before each reading."
    parameters = (
        EffectParameter("lag_s", "s", "delay of the force channel", 0.0, -0.5, 0.5, 0.02),
    )
    needs = ("time", "several forces")
    examples = (
        WorkedExample(
            "The force rises by 0.1 N/s from a touch at t = 0; a reading 0.5 s late is 0.05 N low.",
            {"lag_s": 0.5},
            {"time_s": (1.0, 2.0, 3.0), "force_n": (0.1, 0.2, 0.3)},
            {"force_n": (0.15, 0.25, 0.35)},
        ),
    )

    def force(self, readings: Readings, force_n: np.ndarray, *, lag_s: float) -> np.ndarray:
        """Add the force's growth over the lag, taken from the sensor's own readings."""
        return force_n + _growth(readings, lag_s)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the lag by a part of a press."""
        if readings.time_s is None:
            return self.parameters
        most = min(self.parameters[0].upper, _LONGEST * readings.press_length_s)
        return (replace(self.parameters[0], lower=-most, upper=most),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say which channel is late, and by how much."""
        lag = values["lag_s"]
        return (
            f"The force lies {1e3 * abs(lag):.0f} ms {more(lag, 'behind', 'ahead of')} the "
            "displacement, in loading as in unloading, at every place."
        )


def _growth(readings: Readings, lag_s: float) -> np.ndarray:
    """Return the growth (m,) of the read force within a lag, from smooth courses of each phase.

    The force has its corner between two phases a lag later than the displacement, mostly between
    two readings: each phase's course goes on to its own corner. A local line through several
    readings passes on hardly any of their noise. It is a line through the readings as they are, not
    the latent force, so that each row depends on its own force alone.
    """
    press, force = readings.press, readings.force_n
    within = readings.timed_s - readings.touch_time_s[press]
    run = readings.run
    first = run[readings.first]
    last = np.append(first[1:], run[-1] + 1) - 1
    apart = 2 * (float(within.max()) + abs(lag_s)) + 1.0  # between presses, on one axis
    ends = (press * apart + within)[np.append(np.flatnonzero(np.diff(run)), len(run) - 1)]
    shift = np.sign(lag_s) * max(abs(lag_s) - _INSTANT_S, 0.0)
    felt = np.searchsorted(ends, press * apart + within - shift)  # the phase that a reading shows
    felt = np.clip(felt, first[press], last[press])
    order = np.argsort(felt, kind="stable")
    place = np.empty(len(order), int)
    place[order] = np.arange(len(order))
    course = LocalLines(felt[order], within[order], force[order], readings.sampling_step_s)
    growth = course.at(run, place, within + lag_s) - course.at(felt, place, within)
    _end_softly(growth, course, readings, within, lag_s)
    return growth


def _end_softly(
    growth: np.ndarray, course: LocalLines, readings: Readings, within: np.ndarray, lag_s: float
) -> None:
    """Change the growth (m,) of phases' last readings to that of ramps that begin and end softly.

    Such a ramp's force changes little in its first and last moments, and between the readings none
    shows how soft it is there. The holds do: a late channel still lacks something of them at the
    end of the loading, one that is ahead has lost it at their own end. That lack, over the rate of
    the force, is at most the lag, and here one time for all ramps.
    """
    run, phase = readings.run, readings.phase
    rows = np.arange(len(run))
    rate = course.at(run, rows, within + 1.0) - course.at(run, rows, within)
    last = np.flatnonzero(np.diff(run, append=-1))
    before = last[:-1][readings.press[last[:-1]] == readings.press[last[:-1] + 1]]
    tops = before[(phase[before] == "load") & (phase[before + 1] == "hold")]
    falls = before[(phase[before] == "hold") & (phase[before + 1] == "unload")]
    late = lag_s > 0
    corners = tops if late else falls
    if not len(corners):
        return
    slope = rate[corners] if late else -rate[corners + 1]
    held = corners + 1 if late else corners
    lacks = course.at(run[held], held, within[corners]) - readings.force_n[corners]
    soft_s = float(lacks @ slope) / max(float(slope @ slope), 1e-300)
    soft_s = min(max(soft_s, 0.0), abs(lag_s))
    growth[corners] = soft_s * slope
    ends = last[phase[last] == "unload"]
    growth[ends] = soft_s * rate[ends] if late else 0.0
    if not late:  # it shows what comes next: a rest
        growth[tops] = 0.0
