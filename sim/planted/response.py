"""Hidden effects of the response: what the body's history adds, stepped through time."""

from __future__ import annotations

import numpy as np

from sim.planted.bench import Bench
from sim.planted.effect import HiddenEffect


def follow(driver: np.ndarray, within_s: np.ndarray, time_constant_s: float) -> np.ndarray:
    """Delayed part z of a driver u, both (j, t): tau dz/dt = u - z, z = 0 at first.

    Stepped by the trapezoidal rule on the bench's own grid (about 1 ms).
    """
    z = np.zeros_like(driver)
    half = np.diff(within_s, axis=1) / (2 * time_constant_s)
    gain, both = (1 - half) / (1 + half), half / (1 + half)
    for i in range(1, driver.shape[1]):
        z[:, i] = gain[:, i - 1] * z[:, i - 1]
        z[:, i] += both[:, i - 1] * (driver[:, i] + driver[:, i - 1])
    return z


class Viscoelasticity(HiddenEffect):
    """The whole body creeps with one time constant."""

    name, category = "viscoelasticity", "structured"
    law = "u + g z, tau dz/dt = u - z"
    amplitude, typical, limit = "share", 0.08, 3.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw the time constant, 0.3 to 2.5 s."""
        return {"time_constant_s": float(np.exp(rng.uniform(np.log(0.3), np.log(2.5))))}

    def response(self, bench, travel_m, values):
        """Add the creep."""
        delayed = follow(travel_m, bench.within_s, values["time_constant_s"])
        return travel_m + values["share"] * delayed


class Preconditioning(HiddenEffect):
    """The body softens from press to press, each taking the same part of what is left."""

    name, category = "preconditioning", "structured"
    law = "u (1 + s_k), s_(k+1) = s_k + (share - s_k)/presses"
    amplitude, typical, limit = "share", 0.05, 3.0

    def draw(self, bench: Bench, rng: np.random.Generator) -> dict[str, float]:
        """Draw after how many presses two thirds of the way are gone."""
        return {"presses": float(np.exp(rng.uniform(np.log(5), np.log(25))))}

    def response(self, bench, travel_m, values):
        """Soften press by press."""
        state, grown = 0.0, []
        for _ in range(len(travel_m)):
            grown.append(state)
            state += (values["share"] - state) / values["presses"]
        return travel_m * (1 + np.array(grown)[:, None])


class Hysteresis(HiddenEffect):
    """On its way back the tip lags: the surface stays lower than it was under the same force."""

    name, category = "hysteresis", "structured"
    law = "u + 4 share u (1 - u/u_max) once u falls below the largest it has been in the press"
    amplitude, typical, limit = "share", 0.08, 1.0

    def response(self, bench, travel_m, values):
        """Lag below the running maximum of each press."""
        largest = np.maximum.accumulate(travel_m, axis=1)
        below = np.where(largest > 0, 1 - travel_m / np.where(largest > 0, largest, 1), 0.0)
        return travel_m + 4 * values["share"] * travel_m * below
