"""Hidden effects of the response: travel with the body's history, stepped through time."""

from __future__ import annotations

from collections.abc import Mapping

import numba
import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gamma

from sim.planted.bench import Bench
from sim.planted.effect import on_response


def follow(
    driver: np.ndarray,
    within_s: np.ndarray,
    time_constant_s: ArrayLike,
    weights: ArrayLike = 1.0,
) -> np.ndarray:
    """Delayed part z of a driver u, both (j, t): tau dz/dt = u - z, z = 0 at first.

    Of several time constants (k,) the sum, each with its weight. Stepped by the trapezoidal rule on
    the bench's own grid (about 1 ms).
    """
    tau = np.atleast_1d(np.asarray(time_constant_s, float))
    weight = np.array(np.broadcast_to(weights, len(tau)), float)
    return _follow(np.ascontiguousarray(driver, float), np.diff(within_s, axis=1), tau, weight)


@numba.njit(cache=True)
def _follow(driver, steps, tau, weight):
    summed = np.zeros_like(driver)
    for j in range(driver.shape[0]):
        for k in range(len(tau)):
            z = 0.0
            for i in range(steps.shape[1]):
                half = steps[j, i] / (2 * tau[k])
                z = ((1 - half) * z + half * (driver[j, i] + driver[j, i + 1])) / (1 + half)
                summed[j, i + 1] += weight[k] * z
    return summed


def _log_uniform(name: str, low: float, high: float):
    """Return a draw of one value, uniform in its logarithm."""
    return lambda bench, rng: {name: float(np.exp(rng.uniform(np.log(low), np.log(high))))}


@on_response("structured", "u + g z, tau dz/dt = u - z", "share", 0.08, limit=3.0,
             draw=_log_uniform("time_constant_s", 0.3, 2.5))  # fmt: skip
def viscoelasticity(bench, travel_m, values):
    """The whole body creeps with one time constant."""
    delayed = follow(travel_m, bench.within_s, values["time_constant_s"])
    return travel_m + values["share"] * delayed


@on_response("structured", "u (1 + s_k), s_(k+1) = s_k + (share - s_k)/presses", "share", 0.05,
             limit=3.0, draw=_log_uniform("presses", 5, 25))  # fmt: skip
def preconditioning(bench, travel_m, values):
    """The body softens from press to press, each time by the same part of the remainder."""
    state, grown = 0.0, []
    for _ in range(len(travel_m)):
        grown.append(state)
        state += (values["share"] - state) / values["presses"]
    return travel_m * (1 + np.array(grown)[:, None])


@on_response("structured",
             "u + 4 share u (1 - u/u_max) once u falls below the largest it has been in the press",
             "share", 0.08, limit=1.0)  # fmt: skip
def hysteresis(bench, travel_m, values):
    """On its way back the tip lags: the surface stays lower than it was under the same force."""
    largest = np.maximum.accumulate(travel_m, axis=1)
    below = np.where(largest > 0, 1 - travel_m / np.where(largest > 0, largest, 1), 0.0)
    return travel_m + 4 * values["share"] * travel_m * below


@on_response("structured", "u + share (z_1 + z_2)/2", "share", 0.1, limit=3.0,
             draw=_log_uniform("time_constant_s", 0.08, 0.16))  # fmt: skip
def two_time_creep(bench, travel_m, values):
    """Creep with two time constants, a factor of thirty apart."""
    short = values["time_constant_s"]
    both = follow(travel_m, bench.within_s, (short, 30 * short))
    return travel_m + values["share"] * both / 2


@on_response("structured", "u + share integral (t - s)^exponent du, as 60 Kelvin elements",
             "share", 0.05, limit=3.0, draw=_log_uniform("exponent", 0.15, 0.45))  # fmt: skip
def power_law_creep(bench, travel_m, values):
    """Creep on all time scales: t^a = a / Gamma(1 - a) integral tau^a (1 - exp(-t/tau)) dln tau."""
    a = values["exponent"]
    taus, step = np.linspace(np.log(1e-4), np.log(1e6), 60, retstep=True)
    crept = follow(travel_m, bench.within_s, np.exp(taus), np.exp(a * taus))
    return travel_m + values["share"] * a / gamma(1 - a) * float(step) * crept


def _recovers(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    tip = float(np.median(bench.program.radius_m))
    return {
        "time_constant_s": float(np.exp(rng.uniform(np.log(2.0), np.log(10.0)))),
        "reach_m": tip * float(rng.uniform(0.6, 1.2)),
    }


def half_space_nearness(points_m: np.ndarray, reach_m: float) -> np.ndarray:
    """Sinking (j, j) of each place beside a flat punch at each other one, over the punch's."""
    away = np.linalg.norm(points_m[:, None] - points_m[None], axis=2)
    return np.where(away > reach_m, np.arcsin(reach_m / np.maximum(away, reach_m)) * 2 / np.pi, 1.0)


def recovering(
    bench: Bench, dent_m: np.ndarray, nearness: np.ndarray, time_constant_s: float
) -> np.ndarray:
    """Depth (j, t) that earlier presses have left at each place, since its first touch.

    Press after press, each dent going back from its depth at the press's end, `dent_m` (j,).
    """
    left = np.zeros_like(bench.time_s)
    for j in range(1, len(left)):
        for k in range(j):
            since = bench.time_s[j] - bench.time_s[k, -1]
            course = dent_m[k] * np.exp(-since / time_constant_s)
            left[j] += nearness[j, k] * (course - course[0])
    return left


@on_response("structured", "u + share (z + rest of earlier dents nearby, since touch)", "share",
             0.1, limit=3.0, draw=_recovers)  # fmt: skip
def creep_recovery(bench, travel_m, values):
    """The body creeps, and goes back only slowly after each press."""
    tau = values["time_constant_s"]
    delayed = follow(travel_m, bench.within_s, tau)
    nearness = half_space_nearness(bench.points_m, values["reach_m"])
    return travel_m + values["share"] * (delayed + recovering(bench, delayed[:, -1], nearness, tau))


def lag_behind(travel_m: np.ndarray, half_m: np.ndarray) -> np.ndarray:
    """Play (j, t) of a travel: follows it at a distance of `half_m` (j,) once that is used up."""
    return _lag_behind(np.ascontiguousarray(travel_m, float), half_m)


@numba.njit(cache=True)
def _lag_behind(travel_m, half_m):
    behind = np.zeros_like(travel_m)
    for j in range(travel_m.shape[0]):
        for i in range(1, travel_m.shape[1]):
            low, high = travel_m[j, i] - half_m[j], travel_m[j, i] + half_m[j]
            behind[j, i] = min(max(behind[j, i - 1], low), high)
    return behind


@on_response("structured", "u + share (mean of plays of 2, 6, 15 and 40 % - u)", "share", 0.2,
             limit=1.0)  # fmt: skip
def several_plays(bench, travel_m, values):
    """Parts of the body follow after ways of different length."""
    most = travel_m.max(axis=1)
    plays = [lag_behind(travel_m, width * most) for width in (0.02, 0.06, 0.15, 0.4)]
    return travel_m + values["share"] * (np.mean(plays, axis=0) - travel_m)


def _softens_nearby(bench: Bench, rng: np.random.Generator) -> dict[str, float]:
    return {"presses": float(rng.uniform(0.5, 2)), "reach_m": float(rng.uniform(0.006, 0.02))}


def softened_nearby(points_m: np.ndarray, values: Mapping[str, float]) -> np.ndarray:
    """Softening (j,) of each place when it is pressed.

    Each earlier press took a part of the rest, the larger, the nearer it was.
    """
    grown, rest = [], np.ones(len(points_m))
    for j, point in enumerate(points_m):
        grown.append(values["share"] * (1 - rest[j]))
        away = np.sum((points_m - point) ** 2, axis=1)
        nearness = np.exp(-away / (2 * values["reach_m"] ** 2))
        rest *= np.exp(-nearness / values["presses"])
    return np.array(grown)


@on_response("structured", "u (1 + share (1 - product over earlier presses of exp(-near/presses)))",
             "share", 0.05, limit=3.0, draw=_softens_nearby)  # fmt: skip
def preconditioning_nearby(bench, travel_m, values):
    """The body softens where it is pressed, and near it."""
    return travel_m * (1 + softened_nearby(bench.points_m, values))[:, None]


@on_response("structured", "u (1 + share k/(k + 8)), k = 0, 1, ... the press's number", "share",
             0.05, limit=3.0)  # fmt: skip
def free_preconditioning(bench, travel_m, values):
    """Softening that begins at once and dies away slowly, as by a bond broken now and then."""
    return travel_m * (1 + values["share"] * hyperbola(np.arange(len(travel_m))))[:, None]


def hyperbola(order):
    """Return the share of all softening after so many presses."""
    return order / (order + 8.0)


@on_response("structured", "(1 - share) u + share play(u)", "share", 0.2, limit=1.0,
             draw=_log_uniform("width", 0.04, 0.2))  # fmt: skip
def play(bench, travel_m, values):
    """A part of the body follows only after some way, in both senses."""
    half = values["width"] * travel_m.max(axis=1)
    return travel_m + values["share"] * (lag_behind(travel_m, half) - travel_m)
