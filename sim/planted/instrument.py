"""Hidden effects of the instrument: the reported readings differ from the true ones."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim.planted.bench import Bench
from sim.planted.contact import levelling
from sim.planted.effect import Draw, any_direction, on_sensor
from sim.planted.response import follow


def first_largest(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw nothing but the largest force of the first session: a sensor stays what it is."""
    return {"largest_n": float(bench.program.force_n.max())}


def largest_n(bench: Bench, values: Mapping[str, float]) -> float:
    """Largest force of the first session; of all presses in truths that did not keep it."""
    return float(values.get("largest_n", bench.program.force_n.max()))


def _of_session(name: str, low: float, high: float) -> Draw:
    """Return a draw of a time as a share of the session."""
    return lambda bench, rng: {name: float(rng.uniform(low, high) * np.ptp(bench.time_s))}


@on_sensor("compliance", "travel + c F", "compliance_m_per_n", 4e-4)
def tool_compliance(bench, force_n, travel_m, values):
    """The tool bends in proportion to the true force, and the bend is taken for travel."""
    return force_n, travel_m + values["compliance_m_per_n"] * bench.force_n


@on_sensor("structured", "force + b", "bias_n", 0.01, two_sided=True)
def force_bias(bench, force_n, travel_m, values):
    """The force channel reads a constant too much."""
    return force_n + values["bias_n"], travel_m


@on_sensor("structured", "force + rate t, t since the first press", "rate_n_per_s", 6e-5,
           two_sided=True)  # fmt: skip
def force_drift(bench, force_n, travel_m, values):
    """The zero of the force channel walks away over the session."""
    return force_n + values["rate_n_per_s"] * (bench.time_s - bench.begin_s), travel_m


@on_sensor("structured", "force (1 + rate t), t since the first press", "rate_per_s", 2e-4,
           limit=0.01, two_sided=True)  # fmt: skip
def sensitivity_drift(bench, force_n, travel_m, values):
    """The force channel gains or loses sensitivity over the session."""
    gain = 1 + values["rate_per_s"] * (bench.time_s - bench.begin_s)
    return force_n * gain, travel_m


@on_sensor("structured", "F_s tanh(F/F_s), F_s = 1/knee", "knee_per_n", 1.0, limit=20.0)
def force_saturation(bench, force_n, travel_m, values):
    """The force channel bends over: it reads less, the larger the force."""
    knee = values["knee_per_n"]
    return (np.tanh(knee * force_n) / knee if knee else force_n), travel_m


@on_sensor("structured", "(1 - loss) F + loss c arctan(F/c), c half of the largest", "loss", 0.1,
           limit=0.9, draw=first_largest)  # fmt: skip
def free_saturation(bench, force_n, travel_m, values):
    """A force channel whose sensitivity falls to a lower one."""
    most = largest_n(bench, values)
    return most * levelling(force_n / most, values["loss"], 0.5), travel_m


@on_sensor("structured", "travel - offset", "offset_m", 1.5e-4, two_sided=True)
def contact_offset(bench, force_n, travel_m, values):
    """First touch was called too late (or too early): all travels lack the same length."""
    return force_n, travel_m - values["offset_m"]


@on_sensor("structured", "travel + slope (cos(angle) (x - x_c) + sin(angle) (y - y_c))", "slope",
           3e-3, draw=any_direction)  # fmt: skip
def surface_tilt(bench, force_n, travel_m, values):
    """The surface stands askew to the plane that the robot assumes: travel counts from it."""
    centred = bench.points_m - np.array(bench.body.size_m[:2]) / 2
    towards = [np.cos(values["angle_rad"]), np.sin(values["angle_rad"])]
    return force_n, travel_m + values["slope"] * (centred @ towards)[:, None]


@on_sensor("structured", "travel + rate t, t since the first press", "rate_m_per_s", 5e-7,
           two_sided=True)  # fmt: skip
def displacement_drift(bench, force_n, travel_m, values):
    """The arm grows over the session, and its growth is taken for travel."""
    return force_n, travel_m + values["rate_m_per_s"] * (bench.time_s - bench.begin_s)


def _off_the_rhythm(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw phase and a frequency off the rhythm of the presses."""
    rhythm = 1 / max(float(np.median(np.diff(bench.program.start_s, append=np.inf))), 1e-9)
    while True:
        frequency = float(rng.uniform(0.13, 0.6))
        if abs(frequency / rhythm - round(frequency / rhythm)) * rhythm > 0.015:
            break
    return {"frequency_hz": frequency, "phase_rad": float(rng.uniform(0, 2 * np.pi))}


@on_sensor("structured", "travel + a sin(2 pi f t + phase)", "amplitude_m", 1.2e-4,
           draw=_off_the_rhythm)  # fmt: skip
def breathing(bench, force_n, travel_m, values):
    """The body heaves as one, whatever is pressed."""
    angle = 2 * np.pi * values["frequency_hz"] * bench.time_s + values["phase_rad"]
    return force_n, travel_m + values["amplitude_m"] * np.sin(angle)


@on_sensor("structured", "force(t - lag)", "lag_s", 0.04, limit=0.5, two_sided=True)
def time_lag(bench, force_n, travel_m, values):
    """The force channel is reported late, or early, within each press."""
    earlier = bench.within_s - values["lag_s"]
    rows = zip(earlier, bench.within_s, force_n, strict=True)
    late = [np.interp(wanted, known, force, left=0.0) for wanted, known, force in rows]
    return np.array(late), travel_m


@on_sensor("structured", "force through a low-pass of first order", "delay_s", 0.04, limit=0.5)
def filtered_force(bench, force_n, travel_m, values):
    """A filter in the sensor's amplifier."""
    tau = values["delay_s"]
    return (follow(force_n, bench.within_s, tau) if tau else force_n), travel_m


@on_sensor("structured", "force + zero (1 - exp(-t/time_constant))", "zero_n", 0.02,
           two_sided=True, draw=_of_session("time_constant_s", 0.1, 0.4))  # fmt: skip
def force_warm_up(bench, force_n, travel_m, values):
    """The zero of the force channel settles as the sensor warms up."""
    since = (bench.time_s - bench.begin_s) / values["time_constant_s"]
    return force_n + values["zero_n"] * (1 - np.exp(-since)), travel_m


def _wander(bench: Bench, values: dict[str, float]) -> np.ndarray:
    """Smooth course of the session, (j, t): two slow cosines, 0 at the start, of order one."""
    t = (bench.time_s - bench.begin_s) / values["session_s"]
    turns = np.array([0.8, 1.5])
    phases = np.array([values[f"phase_{i}_rad"] for i in range(len(turns))])
    waves = np.cos(np.pi * turns * t[..., None] + phases) - np.cos(phases)
    return waves.sum(axis=-1) / 2


def _course(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    phases = {f"phase_{i}_rad": float(rng.uniform(0, 2 * np.pi)) for i in range(2)}
    return {"session_s": float(bench.time_s[-1, -1]), **phases}


@on_sensor("structured", "force + zero (two slow cosines)", "zero_n", 0.02, two_sided=True,
           draw=_course)  # fmt: skip
def force_wander(bench, force_n, travel_m, values):
    """The zero of the force channel goes to and fro over the session."""
    return force_n + values["zero_n"] * _wander(bench, values), travel_m


@on_sensor("structured", "force (1 + gain (two slow cosines))", "gain", 0.04, limit=0.4,
           two_sided=True, draw=_course)  # fmt: skip
def sensitivity_wander(bench, force_n, travel_m, values):
    """The sensor's sensitivity goes to and fro over the session."""
    return force_n * (1 + values["gain"] * _wander(bench, values)), travel_m


@on_sensor("structured", "travel + zero (two slow cosines)", "zero_m", 1e-4, two_sided=True,
           draw=_course)  # fmt: skip
def displacement_wander(bench, force_n, travel_m, values):
    """The arm bends to and fro over the session as the room warms and cools."""
    return force_n, travel_m + values["zero_m"] * _wander(bench, values)


@on_sensor("structured", "travel + a (sin(2 pi f t + phase) - the same at the press's start)",
           "amplitude_m", 1.2e-4, draw=_off_the_rhythm)  # fmt: skip
def breathing_from_touch(bench, force_n, travel_m, values):
    """The body heaves as one, and each press counts from where it met the surface."""
    angle = 2 * np.pi * values["frequency_hz"] * bench.time_s + values["phase_rad"]
    motion = np.sin(angle)
    return force_n, travel_m + values["amplitude_m"] * (motion - motion[:, :1])


def two_tones(time_s: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """A tone of amplitude 1 and a third of it at twice the frequency."""
    angle = 2 * np.pi * values["frequency_hz"] * time_s + values["phase_rad"]
    return np.sin(angle) + np.cos(2 * angle + values["phase_2_rad"]) / 3


def _of_a_breath(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    drawn = _off_the_rhythm(bench, rng)
    while drawn["frequency_hz"] > 0.55:
        drawn = _off_the_rhythm(bench, rng)
    return {**drawn, "phase_2_rad": float(rng.uniform(0, 2 * np.pi))}


@on_sensor("structured", "travel + a (sin + cos of twice the angle/3)", "amplitude_m", 1e-4,
           draw=_of_a_breath)  # fmt: skip
def breathing_harmonics(bench, force_n, travel_m, values):
    """The body heaves along a wave that is no sine."""
    return force_n, travel_m + values["amplitude_m"] * two_tones(bench.time_s, values)


@on_sensor("structured", "the same, less its value at the press's start", "amplitude_m", 1.2e-4,
           draw=_of_a_breath)  # fmt: skip
def breathing_harmonics_from_touch(bench, force_n, travel_m, values):
    """The body heaves along such a wave, and each press counts from where it met the surface."""
    moved = two_tones(bench.time_s, values)
    return force_n, travel_m + values["amplitude_m"] * (moved - moved[:, :1])


def changing_tone(time_s: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """A tone of amplitude 1 that gains the same number of hertz each second."""
    turns = values["frequency_hz"] * time_s + values["drift_hz_per_s"] * time_s**2 / 2
    return np.sin(2 * np.pi * turns + values["phase_rad"])


def _of_a_changing_breath(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    drawn = _of_a_breath(bench, rng)
    del drawn["phase_2_rad"]
    change = float(rng.choice([-1, 1]) * rng.uniform(0.04, 0.2)) * drawn["frequency_hz"]
    return {**drawn, "drift_hz_per_s": change / float(np.ptp(bench.time_s))}


@on_sensor("structured", "travel + a sin(2 pi (f t + drift t^2/2) + phase)", "amplitude_m", 1e-4,
           draw=_of_a_changing_breath)  # fmt: skip
def breathing_drifting(bench, force_n, travel_m, values):
    """The body heaves ever faster, or ever slower."""
    return force_n, travel_m + values["amplitude_m"] * changing_tone(bench.time_s, values)
