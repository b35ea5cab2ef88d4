"""Causes of the catalogue in the instrument, by laws that it does not contain.

The family is the right answer.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect, on_sensor
from sim.planted.instrument import first_largest, largest_n
from sim.planted.response import follow, lag_behind

FORCE_ZERO = ("force_drift", "force_warm_up", "force_wander", "force_jump")
LATE = ("time_lag", "filtered_force")
GAIN = ("sensitivity_drift", "sensitivity_wander")
SATURATION = ("force_saturation", "free_saturation")
TRAVEL_ZERO = ("displacement_drift", "displacement_wander", "displacement_jump")
MOTION = (
    "breathing", "breathing_from_touch", "breathing_harmonics", "breathing_harmonics_from_touch",
    "breathing_drifting",
)  # fmt: skip


def _session(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw nothing but the length of the first session."""
    return {"session_s": float(np.ptp(bench.time_s))}


def _share_of_session(bench: Bench, values: dict[str, float]) -> np.ndarray:
    return (bench.time_s - bench.begin_s) / values["session_s"]


# ---- friction, saturation ------------------------------------------------------------------


@on_sensor("form", "force + friction tanh(way since the turn)", "friction_n", 0.01, limit=0.5,
           kin=("guide_friction",))  # fmt: skip
def form_guide_friction(bench, force_n, travel_m, values):
    """A guide that rubs: its force opposes the way, and turns over a tenth of the travel."""
    most = np.maximum(travel_m.max(axis=1, keepdims=True), 1e-12)
    behind = lag_behind(travel_m, 0.03 * most[:, 0])
    return force_n + values["friction_n"] * (travel_m - behind) / (0.03 * most), travel_m


def softened(force_n: np.ndarray, knee_n: float, loss: float) -> np.ndarray:
    """Reading that loses a share of what exceeds a knee, rounded over a fifth of it."""
    width = 0.2 * knee_n
    over, none = (width * np.logaddexp(0, (f - knee_n) / width) for f in (force_n, 0 * force_n))
    return force_n - loss * (over - none)


@on_sensor("form", "force - loss times its excess over 60 % of the largest", "loss", 0.1,
           limit=0.9, kin=SATURATION, draw=first_largest)  # fmt: skip
def form_yielding_sensor(bench, force_n, travel_m, values):
    """A sensor whose beam meets its stop: straight to a knee, and less steep beyond."""
    return softened(force_n, 0.6 * largest_n(bench, values), values["loss"]), travel_m


@on_sensor("form", "force / (1 + loss (force/largest)^2)", "loss", 0.1, limit=0.9,
           kin=SATURATION, draw=first_largest)  # fmt: skip
def form_loaded_amplifier(bench, force_n, travel_m, values):
    """An amplifier that is loaded by its own output."""
    level = force_n / largest_n(bench, values)
    return force_n / (1 + values["loss"] * level**2), travel_m


@on_sensor("form", "force / (1 + (loss force/largest)^3)^(1/3)", "loss", 0.5, limit=3.0,
           kin=SATURATION, draw=first_largest)  # fmt: skip
def form_full_range_sensor(bench, force_n, travel_m, values):
    """A sensor that is exact for long, and bends over near the end of its range."""
    level = values["loss"] * force_n / largest_n(bench, values)
    return force_n / np.cbrt(1 + np.abs(level) ** 3), travel_m


# ---- drifts ----------------------------------------------------------------------------------


def _logarithm(t: np.ndarray) -> np.ndarray:
    return np.log1p(20 * t) / np.log(21)


def _root(t: np.ndarray) -> np.ndarray:
    return np.sqrt(np.maximum(t, 0))


def _there_and_back(t: np.ndarray) -> np.ndarray:
    return np.e * 3 * t * np.exp(-3 * t)


def _drift_of_force(bench, force_n, travel_m, values, course: Callable):
    return force_n + values["zero_n"] * course(_share_of_session(bench, values)), travel_m


def _drift_of_travel(bench, force_n, travel_m, values, course: Callable):
    return force_n, travel_m + values["zero_m"] * course(_share_of_session(bench, values))


def _drifts() -> list[HiddenEffect]:
    courses = {"logarithmic": _logarithm, "root": _root, "returning": _there_and_back}
    force = [
        HiddenEffect(
            f"form_{name}_force_drift", "form", f"force + zero ({name} course)", "zero_n", 0.02,
            two_sided=True, kin=FORCE_ZERO, draw=_session,
            sensor=partial(_drift_of_force, course=course),
        )
        for name, course in courses.items()
    ]  # fmt: skip
    travel = [
        HiddenEffect(
            f"form_{name}_displacement_drift", "form", f"travel + zero ({name} course)", "zero_m",
            1e-4, two_sided=True, kin=TRAVEL_ZERO, draw=_session,
            sensor=partial(_drift_of_travel, course=course),
        )
        for name, course in courses.items()
    ]  # fmt: skip
    return [*force, *travel]


def fading(t: np.ndarray) -> np.ndarray:
    """Course from 0 towards 1, over a third of the session (t = 1)."""
    return -np.expm1(-3 * np.maximum(t, 0))


def _gain(bench, force_n, travel_m, values, course: Callable):
    return force_n * (1 + values["gain"] * course(_share_of_session(bench, values))), travel_m


form_fading_gain, form_returning_gain = (
    HiddenEffect(
        f"form_{name}_gain", "form", f"force (1 + gain ({name} course))", "gain", 0.05, limit=0.6,
        two_sided=True, kin=GAIN, draw=_session, sensor=partial(_gain, course=course),
    )
    for name, course in {"fading": fading, "returning": _there_and_back}.items()
)  # fmt: skip


# ---- motion and lag ---------------------------------------------------------------------------


@on_sensor("form", "travel + a (sin + sin^3/2)(2 pi f t + phase)", "amplitude_m", 1e-4, kin=MOTION,
           draw=lambda bench, rng: {"frequency_hz": float(rng.uniform(0.21, 0.29)),
                                    "phase_rad": float(rng.uniform(0, 6.28))})  # fmt: skip
def form_pointed_breathing(bench, force_n, travel_m, values):
    """A breath with a point: harmonics beside the tone."""
    angle = 2 * np.pi * values["frequency_hz"] * bench.time_s + values["phase_rad"]
    wave = np.sin(angle)
    return force_n, travel_m + values["amplitude_m"] * (wave + wave**3 / 2)


def calming(time_s: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """A tone of amplitude 1 whose frequency falls to 1 - fall of the first and settles there."""
    settles, first = values["settles_s"], values["frequency_hz"]
    faster = settles * (1 - np.exp(-time_s / settles))
    turns = first * ((1 - values["fall"]) * time_s + values["fall"] * faster)
    return np.sin(2 * np.pi * turns + values["phase_rad"])


def _calms(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    return {
        "frequency_hz": float(rng.uniform(0.21, 0.29)), "phase_rad": float(rng.uniform(0, 6.28)),
        "fall": float(rng.uniform(0.05, 0.15)), "settles_s": 0.7 * float(np.ptp(bench.time_s)),
    }  # fmt: skip


@on_sensor("form", "travel + a sin(2 pi int f dt), f falls and settles", "amplitude_m", 1e-4,
           kin=MOTION, draw=_calms)  # fmt: skip
def form_calming_breathing(bench, force_n, travel_m, values):
    """A breath that calms down over the scan."""
    return force_n, travel_m + values["amplitude_m"] * calming(bench.time_s, values)


def resting(time_s: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """Upper half of a tone of amplitude 1, less its mean; the lower half is a rest."""
    angle = 2 * np.pi * values["frequency_hz"] * time_s + values["phase_rad"]
    return np.maximum(np.sin(angle), 0) - 1 / np.pi


@on_sensor("form", "travel + a (max(sin, 0)(2 pi f t + phase) - 1/pi)", "amplitude_m",
           2e-4, kin=MOTION,
           draw=lambda bench, rng: {"frequency_hz": float(rng.uniform(0.21, 0.29)),
                                    "phase_rad": float(rng.uniform(0, 6.28))})  # fmt: skip
def form_resting_breathing(bench, force_n, travel_m, values):
    """A breath that rests for half of its time."""
    return force_n, travel_m + values["amplitude_m"] * resting(bench.time_s, values)


@on_sensor("form", "force through two low-passes of first order", "delay_s", 0.04, limit=0.5,
           kin=LATE)  # fmt: skip
def form_twice_filtered_force(bench, force_n, travel_m, values):
    """A filter in the sensor and one in the amplifier, of half the delay each."""
    tau = values["delay_s"] / 2
    once = follow(force_n, bench.within_s, tau) if tau else force_n
    return (follow(once, bench.within_s, tau) if tau else force_n), travel_m


@on_sensor("form", "mean of the force over the last 2 delay", "delay_s", 0.04, limit=0.5,
           kin=LATE)  # fmt: skip
def form_averaged_force(bench, force_n, travel_m, values):
    """A converter that averages the samples of a window."""
    window = 2 * values["delay_s"]
    if not window:
        return force_n, travel_m
    steps = np.diff(bench.within_s, axis=1) * (force_n[:, 1:] + force_n[:, :-1]) / 2
    total = np.pad(np.cumsum(steps, axis=1), ((0, 0), (1, 0)))
    rows = zip(bench.within_s, total, strict=True)
    before = np.array([np.interp(t - window, t, summed) for t, summed in rows])
    return (total - before) / window, travel_m


FORMS_OF_THE_INSTRUMENT = (
    form_guide_friction,
    form_yielding_sensor,
    form_loaded_amplifier,
    form_full_range_sensor,
    *_drifts(),
    form_fading_gain,
    form_returning_gain,
    form_pointed_breathing,
    form_calming_breathing,
    form_resting_breathing,
    form_twice_filtered_force,
    form_averaged_force,
)
