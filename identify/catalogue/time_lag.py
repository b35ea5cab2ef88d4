"""Two channels with different delays: force and displacement do not belong to one instant."""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.smooth import LocalLines
from identify.effects.units import more

_LONGEST = 0.25  # of the median press
_SHOWN_S = 0.003  # of a much shorter lag the holds show noise, by which no pattern may go
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
        return force_n + growth_over(readings, lag_s)

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the lag by a part of a press."""
        most = longest_lag_s(readings, self.parameters[0].upper)
        return (replace(self.parameters[0], lower=-most, upper=most),)

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say which channel is late, and by how much."""
        lag = values["lag_s"]
        return (
            f"The force lies {1e3 * abs(lag):.0f} ms {more(lag, 'behind', 'ahead of')} the "
            "displacement, in loading as in unloading, at every place."
        )


def longest_lag_s(readings: Readings, most_s: float) -> float:
    """Longest lag that is sought, s: a part of a press."""
    return most_s if readings.time_s is None else min(most_s, _LONGEST * readings.press_length_s)


@lru_cache(maxsize=4)
def growth_over(readings: Readings, lag_s: float, filter_s: float = 0.0) -> np.ndarray:
    """Return the growth (m,) of the read force within a lag, from smooth courses of each phase.

    The force has its corner between two phases a lag later than the displacement, mostly between
    two readings: each phase's course goes on to its own corner. A local line through several
    readings passes on hardly any of their noise. It is a line through the readings as they are, not
    the latent force, so that each row depends on its own force alone, and the last growths are
    kept: read-only.

    Parameters
    ----------
    filter_s : part of a late force's lag that is the time constant of a low-pass of first order,
        behind which it comes to each new course exponentially
    """
    press, force, run = readings.press, readings.force_n, readings.run
    within = readings.timed_s - readings.touch_time_s[press]
    first = run[readings.first]
    last = np.append(first[1:], run[-1] + 1) - 1
    apart = 2 * (float(within.max()) + abs(lag_s)) + 1.0  # between presses, on one axis
    ends = np.append(np.flatnonzero(np.diff(run)), len(run) - 1)
    delay_s = lag_s - filter_s
    shift = np.sign(delay_s) * max(abs(delay_s) - _INSTANT_S, 0.0)
    at = press * apart + within
    felt = np.searchsorted(at[ends], at - shift)  # the phase that a reading shows
    felt = np.clip(felt, first[press], last[press])
    order = np.argsort(felt, kind="stable")
    place = np.empty(len(order), int)
    place[order] = np.arange(len(order))

    def lines(values: np.ndarray) -> LocalLines:
        return LocalLines(felt[order], within[order], values[order], readings.sampling_step_s)

    course, coming = lines(force), np.zeros(len(force))
    if filter_s > 0:
        begins = np.append(0.0, within[ends[:-1]])  # of each phase
        begins[first] = -lag_s  # the first touch is that of the read force
        since = np.maximum(within - begins[felt] - delay_s, 0.0)
        for _ in range(2):  # the second time along lines that are free of it
            rate = course.at(felt, place, within + 1.0) - course.at(felt, place, within)
            soft = _soft_corners(course, readings, within, lag_s)[-1] / lag_s
            coming = _to_come(readings, felt, rate, since, filter_s, soft)
            course = lines(force - coming)
    growth = course.at(run, place, within + lag_s) - course.at(felt, place, within) - coming
    _end_softly(growth, course, readings, within, lag_s)
    growth.setflags(write=False)
    return growth


def _to_come(
    readings: Readings,
    felt: np.ndarray,
    rate: np.ndarray,
    since: np.ndarray,
    filter_s: float,
    soft: float,
) -> np.ndarray:
    """Part (m,) of the last corner's turn that a filter has not yet let through.

    A ramp that ends softly turns earlier than its end, and one that begins so later.

    Parameters
    ----------
    felt : (m,) phase that a reading shows
    rate : (m,) of the force along it
    since : (m,) s, from its begin
    soft : share of the lag that the holds show at a ramp's end
    """
    phases = np.arange(readings.run[-1] + 1)
    paces = np.bincount(felt, rate, len(phases))
    paces /= np.maximum(np.bincount(felt, minlength=len(phases)), 1)
    before = np.append(0.0, paces[:-1])
    before[readings.run[readings.first]] = 0.0
    holds = readings.phase[np.searchsorted(readings.run, phases)] == "hold"
    sooner = np.where(holds, soft, 1 / soft)
    left = np.minimum(sooner[felt] * np.exp(-since / filter_s), 1.0)
    return filter_s * (paces - before)[felt] * left


def _soft_corners(
    course: LocalLines, readings: Readings, within: np.ndarray, lag_s: float
) -> tuple[np.ndarray, np.ndarray, float]:
    """Last readings (k,) before corners to a hold, the rate (k,) there, and the lag that they show.

    The holds show it: a late channel still lacks something of them at the end of the loading, one
    that is ahead has lost it at their own end. That lack, over the rate of the force, is at most
    the lag, and here one time for all ramps; less where they begin and end softly.
    """
    run, phase = readings.run, readings.phase
    last = np.flatnonzero(np.diff(run, append=-1))
    before = last[:-1][readings.press[last[:-1]] == readings.press[last[:-1] + 1]]
    now, then = ("load", "hold") if lag_s > 0 else ("hold", "unload")
    corners = before[(phase[before] == now) & (phase[before + 1] == then)]
    if not len(corners):
        return corners, np.zeros(0), abs(lag_s)
    ramp, held = (corners, corners + 1) if lag_s > 0 else (corners + 1, corners)
    slope = np.sign(lag_s) * _rate(course, run, within)[ramp]
    lacks = course.at(run[held], held, within[corners]) - readings.force_n[corners]
    soft_s = float(lacks @ slope) / max(float(slope @ slope), 1e-300)
    soft_s = min(max(soft_s, 0.0), abs(lag_s))
    return corners, slope, abs(lag_s) * (soft_s + _SHOWN_S) / (abs(lag_s) + _SHOWN_S)


def _rate(course: LocalLines, run: np.ndarray, within: np.ndarray) -> np.ndarray:
    rows = np.arange(len(run))
    return course.at(run, rows, within + 1.0) - course.at(run, rows, within)


def _end_softly(
    growth: np.ndarray, course: LocalLines, readings: Readings, within: np.ndarray, lag_s: float
) -> None:
    """Change the growth (m,) of phases' last readings to that of ramps that begin and end softly.

    Such a ramp's force changes little in its first and last moments, and between the readings none
    shows how soft it is there; the holds do (`_soft_corners`).
    """
    corners, slope, soft_s = _soft_corners(course, readings, within, lag_s)
    if not len(corners):
        return
    run, phase, late = readings.run, readings.phase, lag_s > 0
    growth[corners] = soft_s * slope
    last = np.flatnonzero(np.diff(run, append=-1))
    ends = last[phase[last] == "unload"]
    growth[ends] = soft_s * _rate(course, run, within)[ends] if late else 0.0
    if not late:  # it shows what comes next: a rest
        before = last[:-1][readings.press[last[:-1]] == readings.press[last[:-1] + 1]]
        growth[before[(phase[before] == "load") & (phase[before + 1] == "hold")]] = 0.0
