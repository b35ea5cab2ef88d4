"""Causes of the catalogue in the body, by laws that it does not contain.

The family is the right answer.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import on_contact, on_response
from sim.planted.jumps import border
from sim.planted.response import follow, lag_behind, recovering

CREEP = ("viscoelasticity", "two_time_creep", "power_law_creep", "creep_recovery")
SOFTENING = ("preconditioning", "preconditioning_nearby", "free_preconditioning")
LOOP = ("hysteresis", "play", "free_loop", "several_plays")
GAIN = ("sensitivity_drift", "sensitivity_wander")
STIFFENING = ("strain_stiffening", "free_stiffening")


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


@on_response("form", "u + share z clip(1/2 + (s - edge)/(4 width), 0, 1)", "share", 0.15,
             limit=3.0, draw=border, kin=("side_creep",))  # fmt: skip
def form_creep_on_one_side(bench, travel_m, values):
    """Creep that begins at a line over the surface and grows evenly from there."""
    delayed = follow(travel_m, bench.within_s, 0.8)
    return travel_m + values["share"] * rising(bench, values)[:, None] * delayed


def rising(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Share (j,) of a side that begins and ends in kinks, at each press."""
    angle = values["angle_rad"]
    along = bench.points_m @ (np.cos(angle), np.sin(angle))
    return np.clip(0.5 + (along - values["edge_m"]) / (4 * values["width_m"]), 0, 1)


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


@on_response("form", "u + share u_max x (1 - x)^2 on the way back, x = u/u_max", "share", 0.3,
             limit=1.0, kin=LOOP)  # fmt: skip
def form_late_loop(bench, travel_m, values):
    """A loop that is widest when the tip is nearly back."""
    largest = np.maximum.accumulate(travel_m, axis=1)
    x = np.divide(travel_m, largest, out=np.ones_like(travel_m), where=largest > 0)
    return travel_m + values["share"] * largest * x * (1 - x) ** 2


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


def of_square(x: np.ndarray, square: float) -> np.ndarray:
    """Depth y of y + square y^2 = x."""
    return 2 * x / (1 + np.sqrt(1 + 4 * square * x))


@on_contact("form", "u/a = y + square y^2, y = d/a", "square", 0.3, limit=60.0, kin=STIFFENING)
def form_square_stiffening(bench, travel_m, values):
    """A pad that stiffens in proportion to its depth."""
    tip = bench.program.radius_m[:, None]
    return tip * of_square(travel_m / tip, values["square"])


@on_contact("form", "u/a = y (1 + locking y^2)^2, y = d/a", "locking", 0.2, limit=60.0,
            kin=STIFFENING)  # fmt: skip
def form_locking_stiffening(bench, travel_m, values):
    """Chains that are nearly stretched out: the stiffness runs away with depth."""
    tip = bench.program.radius_m[:, None]
    return tip * of_locking(travel_m / tip, values["locking"])


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
             kin=SOFTENING)  # fmt: skip
def form_slow_preconditioning(bench, travel_m, values):
    """Softening that never quite ends: a power of the number of the press."""
    order = np.arange(len(travel_m))[:, None]
    return travel_m * (1 + values["share"] * (1 - 1 / np.sqrt(1 + order / 4)))


@on_response("form", "u (1 + share min(k/12, 1))", "share", 0.08, limit=3.0, kin=SOFTENING)
def form_ending_preconditioning(bench, travel_m, values):
    """Softening by the same step a press, for twelve presses."""
    order = np.arange(len(travel_m))[:, None]
    return travel_m * (1 + values["share"] * np.minimum(order / 12, 1))


@on_response("form", "u (1 + share (1 - (exp(-k/3) + exp(-k/20))/2))", "share", 0.08, limit=3.0,
             kin=SOFTENING)  # fmt: skip
def form_two_rate_preconditioning(bench, travel_m, values):
    """Two structures in the body that give way, one soon and one slowly."""
    order = np.arange(len(travel_m))[:, None]
    return travel_m * (1 + values["share"] * (1 - (np.exp(-order / 3) + np.exp(-order / 20)) / 2))


FORMS_OF_THE_BODY = (
    form_three_time_creep,
    form_broad_creep,
    form_levelling_creep,
    form_recovering_creep,
    form_creep_on_one_side,
    form_several_plays,
    form_fat_loop,
    form_late_loop,
    form_toe_stiffening,
    form_locking_stiffening,
    form_square_stiffening,
    form_cooling,
    form_slow_preconditioning,
    form_ending_preconditioning,
    form_two_rate_preconditioning,
)
