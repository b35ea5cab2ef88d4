"""Hidden jumps, friction and loops of the rig, and creep of a part of the body."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import on_response, on_sensor
from sim.planted.response import follow


def _in_a_pause(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw the number of the first press after a jump, in the middle of the session."""
    count = len(bench.program)
    return {"press": float(rng.integers(max(count // 5, 1), max(4 * count // 5, 2)))}


@on_sensor("structured", "force + zero from one press on", "zero_n", 0.02, two_sided=True,
           draw=_in_a_pause)  # fmt: skip
def force_jump(bench, force_n, travel_m, values):
    """The force channel was zeroed anew, or knocked, between two presses."""
    after = np.arange(len(force_n)) >= values["press"]
    return force_n + values["zero_n"] * after[:, None], travel_m


@on_sensor("structured", "travel + height from one press on", "height_m", 1e-4, two_sided=True,
           draw=_in_a_pause)  # fmt: skip
def displacement_jump(bench, force_n, travel_m, values):
    """The table was knocked between two presses: all travels after it lack the same length."""
    after = np.arange(len(force_n)) >= values["press"]
    return force_n, travel_m + values["height_m"] * after[:, None]


def _turned(travel_m: np.ndarray) -> np.ndarray:
    """Whether the tip has turned back, (j, t): below its largest travel by a thousandth."""
    largest = np.maximum.accumulate(travel_m, axis=1)
    return travel_m < 0.999 * largest


@on_sensor("structured", "force + friction on the way in, - friction on the way back",
           "friction_n", 0.01, limit=0.5)  # fmt: skip
def guide_friction(bench, force_n, travel_m, values):
    """A guide between sensor and tip rubs, with a sign that turns with the way."""
    sign = np.where(_turned(travel_m), -1.0, 1.0)
    return force_n + values["friction_n"] * sign, travel_m


@on_sensor("structured", "travel - way on the way back", "way_m", 1e-4, limit=2e-3)
def backlash(bench, force_n, travel_m, values):
    """The robot's joints have play, which is used up where the tip turns."""
    return force_n, travel_m - values["way_m"] * _turned(travel_m)


@on_response("structured", "u + share u_max x^2 (1 - x) 27/4 on the way back, x = u/u_max",
             "share", 0.08, limit=1.0)  # fmt: skip
def free_loop(bench, travel_m, values):
    """A loop that is widest at two thirds of the way."""
    largest = np.maximum.accumulate(travel_m, axis=1)
    x = np.divide(travel_m, largest, out=np.ones_like(travel_m), where=largest > 0)
    return travel_m + values["share"] * largest * x**2 * (1 - x) * 27 / 4


def _place(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    x, y = rng.uniform(0.3, 0.7, 2) * np.array(bench.body.size_m[:2])
    return {
        "x_m": float(x),
        "y_m": float(y),
        "radius_m": float(rng.uniform(0.012, 0.02)),
        "time_constant_s": float(rng.uniform(0.4, 1.2)),
    }


@on_response("structured", "u + share exp(-r^2/(2 radius^2)) z, tau dz/dt = u - z", "share", 0.2,
             limit=3.0, draw=_place)  # fmt: skip
def local_creep(bench, travel_m, values):
    """A spot of the body creeps, the rest is elastic."""
    away = np.sum((bench.points_m - (values["x_m"], values["y_m"])) ** 2, axis=1)
    near = np.exp(-away / (2 * values["radius_m"] ** 2))
    delayed = follow(travel_m, bench.within_s, values["time_constant_s"])
    return travel_m + values["share"] * near[:, None] * delayed


def border(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    """Draw a line over the middle of the body that divides it."""
    angle = float(rng.uniform(0, 2 * np.pi))
    middle = rng.uniform(0.4, 0.6, 2) * np.array(bench.body.size_m[:2])
    return {
        "angle_rad": angle,
        "edge_m": float(middle @ (np.cos(angle), np.sin(angle))),
        "width_m": float(rng.uniform(0.001, 0.01)),
        "time_constant_s": float(rng.uniform(0.4, 1.2)),
    }


@on_response("structured", "u + share z / (1 + exp(-(s - edge)/width)), tau dz/dt = u - z", "share",
             0.15, limit=3.0, draw=border)  # fmt: skip
def side_creep(bench, travel_m, values):
    """One side of the body creeps, the other is elastic."""
    delayed = follow(travel_m, bench.within_s, values["time_constant_s"])
    return travel_m + values["share"] * on_side(bench, values)[:, None] * delayed


def on_side(bench: Bench, values: Mapping[str, float]) -> np.ndarray:
    """Share (j,) of a border's far side at each press."""
    angle = values["angle_rad"]
    along = bench.points_m @ (np.cos(angle), np.sin(angle))
    return 1 / (1 + np.exp(-(along - values["edge_m"]) / values["width_m"]))
