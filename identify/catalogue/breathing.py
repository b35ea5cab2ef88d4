"""The body moves up and down on its own."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from identify.body.state import BodyState
from identify.effects.base import Advice, Effect, EffectParameter, Values, WorkedExample
from identify.effects.readings import Readings
from identify.effects.units import length, seconds

_LOWEST_HZ, _HIGHEST_HZ = 0.05, 2.0
_BLOCK = 128  # of frequencies
_OVERSAMPLING = 4  # candidates within the resolution 1 / T of the scan
_RESOLUTION = 1.5  # in 1 / T: no separation from a locked frequency so near
_COHERENT = 0.3  # |mean| of the presses' phases: in step with a frequency
_CHANCE = 2.5  # times 1 / sqrt(presses): reached by random starts at 0.2 % of frequencies


class Breathing(Advice, Effect):
    """One sine over the whole scan."""

    name = "breathing"
    title = "Breathing"
    order = 100
    counted_from = "plane"
    summary = (
        "The body rises and falls on its own, as with breath or pulse, and the robot takes that "
        "for travel. The motion goes on through all presses at one frequency."
    )
    formula = "d = u + sine sin(2 pi f t) + cosine cos(2 pi f t),  t since the scan's first reading"
    latex = (
        r"d = u + \text{sine} \cdot \sin(2\pi f t) + \text{cosine} \cdot \cos(2\pi f t), \quad "
        r"f = \text{frequency}"
    )
    source = "C. N. Riviere, J. Gangloff, M. de Mathelin, Proc. IEEE 94 (2006) 1705-1716"
    gives_away = "the misfit swings with the clock, not with force, place or press"
    cure = (
        "Hold the breath, or trigger presses on it; in any case vary the pauses at random, so "
        "that no frequency can hide behind the rhythm of the presses."
    )
    parameters = (
        EffectParameter("sine_m", "m", "part in phase at the start", 0.0, -0.05, 0.05, 1e-4),
        EffectParameter("cosine_m", "m", "part a quarter ahead", 0.0, -0.05, 0.05, 1e-4),
        EffectParameter("frequency_hz", "Hz", "of the motion", None, 1e-3, 10.0, 0.3),
    )
    needs = ("time",)
    tones = 1  # the highest one has to be resolved
    highest_hz = _HIGHEST_HZ
    examples = (
        WorkedExample(
            "0.1 mm at 0.25 Hz: a quarter of a period a second.",
            {"sine_m": 1e-4, "cosine_m": 0.0, "frequency_hz": 0.25},
            {"time_s": (5.0, 6.0, 7.0, 8.0), "travel_m": 1e-3},
            {"displacement_m": (1e-3, 1.1e-3, 1e-3, 0.9e-3)},
        ),
    )

    def reading(
        self,
        readings: Readings,
        force_n: np.ndarray,
        travel_m: np.ndarray,
        *,
        sine_m: float,
        cosine_m: float,
        frequency_hz: float,
    ) -> np.ndarray:
        """Add the motion."""
        return travel_m + self.moved(readings, frequency_hz, (sine_m, cosine_m))

    def moved(
        self,
        readings: Readings,
        frequency_hz: float,
        waves: Sequence[float],
        drift_hz_per_s: float = 0.0,
        bend_hz_per_s2: float = 0.0,
    ) -> np.ndarray:
        """Motion (m,) of the body, since touch where travel counts from there."""
        course = (frequency_hz, waves, drift_hz_per_s, bend_hz_per_s2)
        moved = motion(readings.elapsed_s, *course)
        if "touch" in (self.counted_from, readings.travel_from):
            touch = readings.touch_time_s - readings.clock_start_s
            moved = moved - motion(touch, *course)[readings.press]
        return moved

    def columns(self, readings: Readings, shapes: Sequence[Values]) -> np.ndarray:
        """Sines and cosines of every tone, since touch where travel counts from there."""
        course = [
            np.array([shape.get(name, 0.0) for shape in shapes])[:, None]
            for name in ("frequency_hz", "drift_hz_per_s", "bend_hz_per_s2")
        ]
        waves = self._waves(readings.elapsed_s, course)
        if "touch" in (self.counted_from, readings.travel_from):
            touch = readings.touch_time_s - readings.clock_start_s
            waves -= self._waves(touch, course)[:, readings.press]
        return waves

    def _waves(self, time_s: np.ndarray, course: Sequence[np.ndarray]) -> np.ndarray:
        """Sines and cosines (g, t, q) of the tones at times (t,), along courses (g, 1)."""
        angle = _angle(time_s, *course)
        # Rounded only after whole turns are taken off: single precision is ten times as fast here
        angle -= 2 * math.pi * np.rint(angle / (2 * math.pi))
        angle = angle.astype(np.float32)
        waves = np.empty((*angle.shape, 2 * self.tones))
        sine, cosine = waves[..., 0], waves[..., 1] = np.sin(angle), np.cos(angle)
        for number in range(1, self.tones):  # by the sums of angles
            before = waves[..., 2 * number - 2], waves[..., 2 * number - 1]
            waves[..., 2 * number] = before[0] * cosine + before[1] * sine
            waves[..., 2 * number + 1] = before[1] * cosine - before[0] * sine
        return waves

    def grid(self, readings: Readings, state: BodyState) -> list[Values]:
        """Frequencies, a quarter of the resolution apart, that the presses do not keep step with.

        A motion that comes round with each press, or at a multiple of its rhythm, looks the same
        in all presses and imitates creep, bias and loops: no scan can tell it from them.
        """
        return self.rhythms(readings)

    def rhythms(self, readings: Readings) -> list[Values]:
        """Return the grid, which the state of the body does not move."""
        frequency, free = free_frequencies(readings, self.tones)
        free &= frequency <= self.highest_hz
        return [{"frequency_hz": float(f)} for f in frequency[free]]

    def doubt(self, values: Values, readings: Readings) -> str | None:
        """Doubt a frequency that has drifted to the rhythm of the presses."""
        frequency, free = free_frequencies(readings, self.tones)
        f = values["frequency_hz"]
        nearest = int(np.argmin(np.abs(frequency - f)))
        if free[nearest]:
            return None
        return f"{f:.3g} Hz keeps step with the presses, whose own course it imitates"

    def bounded(self, readings: Readings, state: BodyState) -> tuple[EffectParameter, ...]:
        """Bound the frequency by the scan's length and sampling; its scale is the resolution."""
        if readings.time_s is None:
            return self.parameters
        low, high = band(readings)
        scale = 0.5 / float(readings.elapsed_s[-1])
        return tuple(
            replace(p, lower=low / 2, upper=high * 1.1, typical=scale)
            if p.name == "frequency_hz"
            else p
            for p in self.parameters
        )

    def untestable(self, readings: Readings) -> str | None:
        """Without time, or if all frequencies are locked to the presses."""
        lacking = super().untestable(readings)
        if lacking is not None:
            return lacking
        if readings.presses < 8 or readings.elapsed_s[-1] < 4 / _HIGHEST_HZ:
            return "the scan is too short to separate a steady motion from the presses"
        if not self.rhythms(readings):
            return "all its frequencies keep step with the presses"
        return None

    def evidence(self, values: Values, readings: Readings) -> str:
        """Say how far and how often the body moves."""
        size = float(np.sqrt(sum(values[p.name] ** 2 for p in self.amplitudes)))
        f = values["frequency_hz"]
        return (
            f"Readings swing up and down by {length(size)} every {seconds(1 / f)} "
            f"({f:.3g} Hz, {60 * f:.3g} a minute) through the whole scan, whatever the force."
        )


def motion(
    time_s: np.ndarray,
    frequency_hz: float,
    waves: Sequence[float],
    drift_hz_per_s: float = 0.0,
    bend_hz_per_s2: float = 0.0,
) -> np.ndarray:
    """Motion of the body at times since the scan's clock began, m.

    `waves` are sine and cosine of the frequency, of twice it, and so on.
    """
    angle = _angle(time_s, frequency_hz, drift_hz_per_s, bend_hz_per_s2)
    total = np.zeros_like(angle)
    for number, size in enumerate(waves):
        if size:
            total += size * (np.cos if number % 2 else np.sin)((1 + number // 2) * angle)
    return total


def _angle(
    time_s: np.ndarray,
    frequency_hz: float | np.ndarray,
    drift_hz_per_s: float | np.ndarray,
    bend_hz_per_s2: float | np.ndarray,
) -> np.ndarray:
    mean_hz = frequency_hz + time_s * (drift_hz_per_s / 2 + time_s * bend_hz_per_s2 / 6)
    return 2 * math.pi * mean_hz * time_s


def band(readings: Readings) -> tuple[float, float]:
    """Lowest and highest frequency that the scan can show: two periods, two readings a period."""
    time = float(readings.elapsed_s[-1])
    high = min(_HIGHEST_HZ, 0.5 / readings.sampling_step_s)
    return min(max(_LOWEST_HZ, 2 / time), high / 2), high


def free_frequencies(readings: Readings, tones: int) -> tuple[np.ndarray, np.ndarray]:
    """Return frequencies in Hz, and which of them lie far enough from any that is locked.

    Locked: the presses start at nearly one angle of the motion, or of one of its `tones`, which
    are whole multiples of its frequency: a sine at half the presses' rhythm is free.
    """
    oversampling = tones * _OVERSAMPLING
    time = float(readings.elapsed_s[-1])
    low, high = band(readings)
    frequency = np.arange(low, high, 1 / (oversampling * time))
    start = readings.elapsed_s[readings.first]
    limit = max(_COHERENT, _CHANCE / math.sqrt(readings.presses))
    near = np.zeros(len(frequency), bool)
    for tone in range(1, tones + 1):
        locked = _coherence(frequency, tone * start) >= limit
        reach = round(_RESOLUTION * oversampling / tone)
        near |= np.convolve(locked, np.ones(2 * reach + 1), mode="same") > 0
    return frequency, ~near


def _coherence(frequency_hz: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """Return how far a motion has one angle at some times, 0 to 1, for evenly spaced frequencies.

    A frequency is the first one of its block and a step further: two tables in place of one.
    """
    step = frequency_hz[1] - frequency_hz[0] if len(frequency_hz) > 1 else 0.0
    blocks = np.exp(2j * math.pi * frequency_hz[::_BLOCK, None] * time_s)
    within = np.exp(2j * math.pi * step * np.arange(_BLOCK)[:, None] * time_s)
    return np.abs(blocks @ within.T).ravel()[: len(frequency_hz)] / len(time_s)
