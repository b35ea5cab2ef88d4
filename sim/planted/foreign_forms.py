"""Causes of the catalogue by laws that it does not contain: the family is the right answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect, on_contact, on_response, on_sensor
from sim.planted.response import follow, lag_behind, recovering

CREEP = ("viscoelasticity", "two_time_creep", "power_law_creep", "creep_recovery")
LOOP = ("hysteresis", "play", "free_loop", "several_plays")
FORCE_ZERO = ("force_drift", "force_warm_up", "force_wander", "force_jump")
GAIN = ("sensitivity_drift", "sensitivity_wander")
STIFFENING = ("strain_stiffening", "free_stiffening")
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


# ---- creep -----------------------------------------------------------------------------------


@on_response("form", "u + share (z_1 + z_2 + z_3)/3, 0.1, 0.6 and 3.6 s", "share", 0.1, limit=3.0,
             kin=CREEP)  # fmt: skip
def form_three_time_creep(bench, travel_m, values):
    """A gel that creeps on three time scales."""
    parts = follow(travel_m, bench.within_s, (0.1, 0.6, 3.6))
    return travel_m + values["share"] * parts / 3


@on_response("form", "u + share mean of z(tau), ln tau normal about 1 s, spread 1.2", "share", 0.1,
             limit=3.0, kin=CREEP)  # fmt: skip
def form_broad_creep(bench, travel_m, values):
    """A polymer with a broad bell of relaxation times."""
    at = np.linspace(-2.5, 2.5, 15)
    weight = np.exp(-(at**2) / 2)
    parts = follow(travel_m, bench.within_s, np.exp(1.2 * at), weight / weight.sum())
    return travel_m + values["share"] * parts


@on_response("form", "u + share (u F_max/(F_max + F)) z/u: soft parts creep more", "share", 0.15,
             limit=3.0, kin=CREEP)  # fmt: skip
def form_levelling_creep(bench, travel_m, values):
    """Creep that grows less than in proportion to the load."""
    delayed = follow(travel_m, bench.within_s, 0.8)
    level = travel_m / np.maximum(travel_m.max(axis=1, keepdims=True), 1e-12)
    return travel_m + values["share"] * delayed / (1 + 0.5 * level)


@on_response("form", "u + share (z_1 + z_2)/2, 0.5 and 6 s, dents fade over 12 mm", "share", 0.1,
             limit=3.0, kin=CREEP)  # fmt: skip
def form_recovering_creep(bench, travel_m, values):
    """Creep on two time scales whose dents spread otherwise than on a half-space."""
    away = np.linalg.norm(bench.points_m[:, None] - bench.points_m[None], axis=2)
    more = np.zeros_like(travel_m)
    for tau in (0.5, 6.0):
        delayed = follow(travel_m, bench.within_s, tau)
        more += delayed + recovering(bench, delayed[:, -1], np.exp(-away / 0.012), tau)
    return travel_m + values["share"] * more / 2


# ---- loops -----------------------------------------------------------------------------------


@on_response("form", "u + share (mean of plays of 3, 8 and 20 % - u)", "share", 0.2, limit=1.0,
             kin=LOOP)  # fmt: skip
def form_several_plays(bench, travel_m, values):
    """A distribution of plays (Prandtl, Ishlinskii)."""
    most = travel_m.max(axis=1)
    plays = [lag_behind(travel_m, width * most) for width in (0.03, 0.08, 0.2)]
    return travel_m + values["share"] * (np.mean(plays, axis=0) - travel_m)


@on_response("form", "u + share u_max x sqrt(1 - x) on the way back, x = u/u_max", "share", 0.1,
             limit=1.0, kin=LOOP)  # fmt: skip
def form_fat_loop(bench, travel_m, values):
    """A loop that opens steeply at the turn."""
    largest = np.maximum.accumulate(travel_m, axis=1)
    x = np.divide(travel_m, largest, out=np.ones_like(travel_m), where=largest > 0)
    return travel_m + values["share"] * largest * x * np.sqrt(np.clip(1 - x, 0, None))


@on_sensor("form", "force + friction tanh(way since the turn)", "friction_n", 0.01, limit=0.5,
           kin=("guide_friction",))  # fmt: skip
def form_guide_friction(bench, force_n, travel_m, values):
    """A guide that rubs: its force opposes the way, and turns over a tenth of the travel."""
    most = np.maximum(travel_m.max(axis=1, keepdims=True), 1e-12)
    behind = lag_behind(travel_m, 0.03 * most[:, 0])
    return force_n + values["friction_n"] * (travel_m - behind) / (0.03 * most), travel_m


# ---- bent laws -------------------------------------------------------------------------------


def of_toe(x: np.ndarray, toe: float) -> np.ndarray:
    """Depth y of y + toe y^3 = x."""
    root = np.sqrt(3 * toe)
    return 2 / root * np.sinh(np.arcsinh(1.5 * root * x) / 3) if toe else x


def of_locking(x: np.ndarray, share: float) -> np.ndarray:
    """Depth y of y (1 + share y^2)^2 = x, by Newton's steps from above."""
    y = x
    for _ in range(30):
        bent = 1 + share * y**2
        y = y - (y * bent**2 - x) / (bent * (1 + 5 * share * y**2))
    return y


@on_contact("form", "u/a = y + toe y^3, y = d/a", "toe", 0.5, limit=200.0, kin=STIFFENING)
def form_toe_stiffening(bench, travel_m, values):
    """Fibres that are straightened first: hardly stiffer at the touch, and then ever more."""
    tip = bench.program.radius_m[:, None]
    return tip * of_toe(travel_m / tip, values["toe"])


@on_contact("form", "u/a = y (1 + locking y^2)^2, y = d/a", "locking", 0.2, limit=60.0,
            kin=STIFFENING)  # fmt: skip
def form_locking_stiffening(bench, travel_m, values):
    """Chains that are nearly stretched out: the stiffness runs away with depth."""
    tip = bench.program.radius_m[:, None]
    return tip * of_locking(travel_m / tip, values["locking"])


def softened(force_n: np.ndarray, knee_n: float, loss: float) -> np.ndarray:
    """Reading that loses a share of what exceeds a knee, rounded over a fifth of it."""
    width = 0.2 * knee_n
    over, none = (width * np.logaddexp(0, (f - knee_n) / width) for f in (force_n, 0 * force_n))
    return force_n - loss * (over - none)


@on_sensor("form", "force - loss times its excess over 60 % of the largest", "loss", 0.1,
           limit=0.9, kin=SATURATION)  # fmt: skip
def form_yielding_sensor(bench, force_n, travel_m, values):
    """A sensor whose beam meets its stop: straight to a knee, and less steep beyond."""
    return softened(force_n, 0.6 * float(bench.program.force_n.max()), values["loss"]), travel_m


@on_sensor("form", "force / (1 + loss (force/largest)^2)", "loss", 0.1, limit=0.9,
           kin=SATURATION)  # fmt: skip
def form_loaded_amplifier(bench, force_n, travel_m, values):
    """An amplifier that is loaded by its own output."""
    level = force_n / float(bench.program.force_n.max())
    return force_n / (1 + values["loss"] * level**2), travel_m


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


# ---- others ----------------------------------------------------------------------------------


@on_contact(
    "form",
    "u (1 - share sin^2(pi t/T) ), T the first session",
    "share",
    0.05,
    limit=0.6,
    kin=GAIN,
    # further presses do not move the session's end
    draw=lambda bench, rng: {"session_s": float(bench.time_s[-1, -1])},
)
def form_cooling(bench, travel_m, values):
    """The body cools while it is pressed, and stiffens: down, and up again as the room warms."""
    t = bench.time_s / values["session_s"]
    return travel_m * (1 - values["share"] * np.sin(np.pi * t) ** 2)


@on_response("form", "u (1 + share (1 - 1/sqrt(1 + k/4)))", "share", 0.08, limit=3.0,
             kin=("preconditioning", "preconditioning_nearby"))  # fmt: skip
def form_slow_preconditioning(bench, travel_m, values):
    """Softening that never quite ends: a power of the number of the press."""
    order = np.arange(len(travel_m))[:, None]
    return travel_m * (1 + values["share"] * (1 - 1 / np.sqrt(1 + order / 4)))


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


@on_sensor("form", "force through a low-pass of first order", "delay_s", 0.04, limit=0.5,
           kin=("time_lag",))  # fmt: skip
def form_filtered_force(bench, force_n, travel_m, values):
    """A filter in the sensor's amplifier."""
    tau = values["delay_s"]
    return (follow(force_n, bench.within_s, tau) if tau else force_n), travel_m


FOREIGN_FORMS = (
    form_three_time_creep,
    form_broad_creep,
    form_levelling_creep,
    form_recovering_creep,
    form_several_plays,
    form_fat_loop,
    form_guide_friction,
    form_toe_stiffening,
    form_locking_stiffening,
    form_yielding_sensor,
    form_loaded_amplifier,
    *_drifts(),
    form_cooling,
    form_slow_preconditioning,
    form_pointed_breathing,
    form_calming_breathing,
    form_filtered_force,
)
