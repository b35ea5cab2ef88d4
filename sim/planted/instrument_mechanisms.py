"""The planted effects of the sensor and of the place of the surface as mechanisms of the loop."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from sim.planted.bench import Bench
from sim.planted.contact import levelling
from sim.planted.foreign_readings import calming, resting, softened
from sim.planted.instrument import changing_tone, largest_n, two_tones
from sim.planted.instrument_in_loop import (
    Averaging,
    Backlash,
    CoarseEncoder,
    GuideFriction,
    Late,
    LowPass,
    PlantScene,
    on_sensor,
)
from sim.planted.surfaces import bow, bump, mound, rim, terrain, wave
from sim.robot.mechanism import Mechanism

Values = Mapping[str, float]
Reading = Callable[[float, float], float]
Course = Callable[[float, int], float]
TURN_SHARES = {"form_guide_friction": 0.03, "guide_friction": 0.005}
"""Of the deepest travel, over which the friction of a guide turns."""


def _sine(scene: PlantScene, v: Values) -> Course:
    return lambda t, press: (
        v["amplitude_m"] * math.sin(2 * math.pi * v["frequency_hz"] * t + v["phase_rad"])
    )


def _pointed(scene: PlantScene, v: Values) -> Course:
    sine = _sine(scene, {**v, "amplitude_m": 1.0})
    return lambda t, press: v["amplitude_m"] * (sine(t, press) + sine(t, press) ** 3 / 2)


def _heaving(wave: Callable[[np.ndarray, Values], np.ndarray], s: PlantScene, v: Values) -> Course:
    return lambda t, press: v["amplitude_m"] * float(wave(np.asarray(t), v))


def _slow_cosines(v: Values) -> Callable[[float], float]:
    turns = ((0.8, v["phase_0_rad"]), (1.5, v["phase_1_rad"]))
    return lambda t: (
        sum(
            math.cos(math.pi * turn * t / v["session_s"] + phase) - math.cos(phase)
            for turn, phase in turns
        )
        / 2
    )


def _wandering(scene: PlantScene, v: Values) -> Reading:
    course = _slow_cosines(v)
    return lambda t, f: f + v["zero_n"] * course(t)


def _gaining(scene: PlantScene, v: Values) -> Reading:
    course = _slow_cosines(v)
    return lambda t, f: f * (1 + v["gain"] * course(t))


def _swaying(scene: PlantScene, v: Values) -> Course:
    course = _slow_cosines(v)
    return lambda t, press: v["zero_m"] * course(t)


def _tilt(scene: PlantScene, v: Values) -> Course:
    towards = np.array([math.cos(v["angle_rad"]), math.sin(v["angle_rad"])])
    centred = scene.bench.points_m - np.array(scene.bench.body.size_m[:2]) / 2
    sinks = v["slope"] * (centred @ towards)
    return lambda t, press: float(sinks[press])


def _uneven(height: Callable[[Bench, Values], np.ndarray], scene: PlantScene, v: Values) -> Course:
    sinks = v["height_m"] * height(scene.bench, v)
    return lambda t, press: float(sinks[press])


def _late(name: str, scene: PlantScene, v: Values) -> Mechanism:
    late = Late(abs(v["lag_s"]))
    if v["lag_s"] >= 0:
        return on_sensor(name, scene, late.read, "press")
    # Force that comes early is travel that comes late
    return Mechanism(name, encoders=late.read, servo_by_motors=True)


def _warm_up(scene: PlantScene, v: Values) -> Reading:
    return lambda t, f: f - v["zero_n"] * math.expm1(-max(t, 0.0) / v["time_constant_s"])


def _offset(name: str, scene: PlantScene, v: Values) -> Mechanism:
    return Mechanism(name, zero_shift_m=v["offset_m"])


def _bias(name: str, scene: PlantScene, v: Values) -> Mechanism:
    return on_sensor(name, scene, lambda t, f: f + v["bias_n"], "never")


def _guide(name: str, scene: PlantScene, v: Values) -> Mechanism:
    made = GuideFriction(scene, v["friction_n"], TURN_SHARES[name])
    return Mechanism(name, begin=made.begin, attach=made.attach, sensor=made.sensor)


def _force_jump(name: str, scene: PlantScene, v: Values) -> Mechanism:
    after = False

    def begin(press: int, time_s: float) -> None:
        nonlocal after
        after = scene.presses_before + press >= v["press"]

    read = on_sensor(name, scene, lambda t, f: f + v["zero_n"] * after)
    return replace(read, begin=begin)


def _backlash(name: str, scene: PlantScene, v: Values) -> Mechanism:
    made = Backlash(v["way_m"])
    return Mechanism(
        name, made.begin, attach=made.attach, encoders=made.encoders, servo_by_motors=True
    )


def _worn_encoder(name: str, scene: PlantScene, v: Values) -> Mechanism:
    made = CoarseEncoder(v["step_m"])
    return Mechanism(name, attach=made.attach, encoders=made.encoders, servo_by_motors=True)


def _knee(scene: PlantScene, v: Values) -> Reading:
    knee = v["knee_per_n"]
    return lambda t, f: math.tanh(knee * f) / knee if knee else f


def _yielding(scene: PlantScene, v: Values) -> Reading:
    knee = 0.6 * largest_n(scene.bench, v)
    return lambda t, f: float(softened(np.array(f), knee, v["loss"]))


def _levelling(scene: PlantScene, v: Values) -> Reading:
    most = largest_n(scene.bench, v)
    return lambda t, f: most * float(levelling(np.array(f / most), v["loss"], 0.5))


def _loaded(scene: PlantScene, v: Values) -> Reading:
    most = largest_n(scene.bench, v)
    return lambda t, f: f / (1 + v["loss"] * (f / most) ** 2)


def _full_range(scene: PlantScene, v: Values) -> Reading:
    share = v["loss"] / largest_n(scene.bench, v)
    return lambda t, f: f / math.cbrt(1 + abs(share * f) ** 3)


def _filtered(name: str, scene: PlantScene, v: Values) -> Mechanism:
    return on_sensor(name, scene, LowPass(v["delay_s"]).read, "press")


def _twice_filtered(name: str, scene: PlantScene, v: Values) -> Mechanism:
    first, second = (LowPass(v["delay_s"] / 2) for _ in range(2))
    return on_sensor(name, scene, lambda t, f: second.read(t, first.read(t, f)), "press")


def _averaged(name: str, scene: PlantScene, v: Values) -> Mechanism:
    return on_sensor(name, scene, Averaging(2 * v["delay_s"]).read, "press")


_COURSES: Mapping[str, Callable[[float], float]] = {
    "logarithmic": lambda t: math.log1p(20 * max(t, 0)) / math.log(21),
    "root": lambda t: math.sqrt(max(t, 0)),
    "returning": lambda t: 3 * math.e * t * math.exp(-3 * t),
}


def _force_course(course: Callable[[float], float], scene: PlantScene, v: Values) -> Reading:
    return lambda t, f: f + v["zero_n"] * course(t / v["session_s"])


def _gain_course(course: Callable[[float], float], scene: PlantScene, v: Values) -> Reading:
    return lambda t, f: f * (1 + v["gain"] * course(t / v["session_s"]))


def _surface_course(course: Callable[[float], float], scene: PlantScene, v: Values) -> Course:
    return lambda t, press: v["zero_m"] * course(t / v["session_s"])


READINGS: Mapping[str, Callable[[PlantScene, Values], Reading]] = {
    "force_drift": lambda s, v: lambda t, f: f + v["rate_n_per_s"] * t,
    "force_warm_up": _warm_up,
    "force_wander": _wandering,
    "sensitivity_drift": lambda s, v: lambda t, f: f * (1 + v["rate_per_s"] * t),
    "sensitivity_wander": _gaining,
    "force_saturation": _knee,
    "free_saturation": _levelling,
    "form_yielding_sensor": _yielding,
    "form_loaded_amplifier": _loaded,
    "form_full_range_sensor": _full_range,
    "form_fading_gain": partial(_gain_course, lambda t: -math.expm1(-3 * max(t, 0))),
    "form_returning_gain": partial(_gain_course, _COURSES["returning"]),
    **{f"form_{n}_force_drift": partial(_force_course, course) for n, course in _COURSES.items()},
}
"""Force (N) that a sensor, tared once a scan, reads at a time (s) under a true force (N)."""

SINKING: Mapping[str, Callable[[PlantScene, Values], Course]] = {
    "surface_tilt": _tilt,
    "curved_surface": partial(_uneven, bow),
    "uneven_surface": partial(_uneven, terrain),
    "surface_bump": partial(_uneven, mound),
    "form_hill_of_the_surface": partial(_uneven, bump),
    "form_wavy_surface": partial(_uneven, wave),
    "form_raised_rim": partial(_uneven, rim),
    "displacement_drift": lambda s, v: lambda t, press: v["rate_m_per_s"] * t,
    "displacement_wander": _swaying,
    "breathing": _sine,
    "breathing_from_touch": _sine,
    "breathing_harmonics": partial(_heaving, two_tones),
    "breathing_harmonics_from_touch": partial(_heaving, two_tones),
    "breathing_drifting": partial(_heaving, changing_tone),
    "form_calming_breathing": partial(_heaving, calming),
    "form_pointed_breathing": _pointed,
    "form_resting_breathing": partial(_heaving, resting),
    "displacement_jump": lambda s, v: (
        lambda t, press: v["height_m"] * (s.presses_before + press >= v["press"])
    ),
    **{
        f"form_{n}_displacement_drift": partial(_surface_course, course)
        for n, course in _COURSES.items()
    },
}
"""Way (m) that the surface goes in the press direction by a time (s), at a press."""

OTHERS: Mapping[str, Callable[[str, PlantScene, Values], Mechanism]] = {
    "force_bias": _bias,
    "time_lag": _late,
    "filtered_force": _filtered,
    "form_twice_filtered_force": _twice_filtered,
    "form_averaged_force": _averaged,
    "form_guide_friction": _guide,
    "guide_friction": _guide,
    "force_jump": _force_jump,
    "contact_offset": _offset,
    "outside_coarse_encoder": _worn_encoder,
    "backlash": _backlash,
}
"""Whole mechanisms, by name: a channel that is late, a guide, encoders, another tare."""
