"""Planted laws of the body, stepped through time inside the contact."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from sim.robot.contact_coupling import BodyInTime, PressedBody
from sim.robot.mechanism import Live


class Part:
    """A law that turns the travel of the body below it into another one; itself it changes none."""

    memory = False

    def attach(self, live: Live) -> None:
        """Receive the truth of the running scan."""

    def begin(self, press: int) -> None:
        """Begin a press without history."""

    def travel(self, press: int, force_n: float, below_m: float) -> float:
        """Return the travel with the present history, m."""
        return below_m

    def advance(self, press: int, time_s: float, dt: float, force_n: float, below_m: float) -> None:
        """Go on in time."""


class LawOnBody:
    """A body under one more law; a `PressedBody` in time."""

    in_time = True

    def __init__(self, below: PressedBody, part: Part) -> None:
        self.below, self.part = below, part
        self._in_time = below if isinstance(below, BodyInTime) else None
        self._time, self._press = math.nan, -1

    def displacement(self, press: int, force_n: float) -> float:
        """Depth of the tip under a force with the present history, m."""
        return self.part.travel(press, force_n, self.below.displacement(press, force_n))

    def tangent(self, press: int, force_n: float) -> float:
        """Local stiffness by a difference, N/m; that of the body below at a kink."""
        step = 1e-3 * max(abs(force_n), 0.02)
        low, high = (self.displacement(press, force_n + s) for s in (-step, step))
        below = self.below.tangent(press, force_n)
        softness = (high - low) / (2 * step)
        return 1 / softness if 0.2 < softness * below < 5 else below

    def advance(self, press: int, time_s: float, force_n: float) -> bool:
        """Go on to a time under a force."""
        moved = bool(self._in_time and self._in_time.advance(press, time_s, force_n))
        fresh = press != self._press or not time_s > self._time
        dt = 0.0 if fresh else time_s - self._time
        self._press, self._time = press, time_s
        below = self.below.displacement(press, force_n)
        self.part.advance(press, time_s, dt, force_n, below)
        return moved or self.part.memory


@dataclass
class Law(Part):
    """Travel by force and elastic travel alone."""

    law: Callable[[int, float, float], float]

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return self.law(press, force_n, below_m)


@dataclass
class Creep(Part):
    """Kelvin elements after the body: u + sum_k w_k z_k, tau_k dz_k/dt = u - z_k."""

    weights: np.ndarray
    times_s: np.ndarray
    level: Callable[[int, float], float] = lambda press, u: 1.0
    memory = True

    def begin(self, press):
        """Begin a press anew."""
        self.z = np.zeros_like(self.weights)

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return below_m + self.level(press, below_m) * float(self.weights @ self.z)

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        if dt > 1.0:  # the way to the next press
            return
        self.z += -np.expm1(-dt / self.times_s) * (below_m - self.z)


@dataclass
class RecoveringCreep(Part):
    """Kelvin elements of every place, which go back while the tip presses elsewhere.

    `nearness` (j, j) of each place to each other one.
    """

    weights: np.ndarray
    times_s: np.ndarray
    nearness: np.ndarray
    memory = True

    def __post_init__(self):
        """Begin with an untouched body."""
        self.z = np.zeros((len(self.nearness), len(self.weights)))
        self.now = math.nan

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return below_m + float(self.nearness[press] @ self.z @ self.weights)

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        passed = time_s - self.now
        if passed > 0:
            pulled = np.zeros(len(self.z))
            pulled[press] = below_m if dt else 0.0
            self.z -= np.expm1(-passed / self.times_s) * (pulled[:, None] - self.z)
        self.now = time_s


@dataclass
class Play(Part):
    """(1 - share) u + share mean of plays of several half widths."""

    share: float
    half_m: Callable[[int], np.ndarray]
    memory = True

    def begin(self, press):
        """Begin a press anew."""
        self.half = np.asarray(self.half_m(press))
        self.behind = np.zeros_like(self.half)

    def _now(self, u):
        return np.clip(self.behind, u - self.half, u + self.half)

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return below_m + self.share * (float(self._now(below_m).mean()) - below_m)

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        self.behind = self._now(below_m)


@dataclass
class Loop(Part):
    """Lag on the way back: u + L g(u/L), L the largest travel of the press."""

    shape: Callable[[float], float]
    memory = True

    def begin(self, press):
        """Begin a press anew."""
        self.largest = 0.0

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        if below_m >= self.largest or below_m <= 0:
            return below_m
        return below_m + self.largest * self.shape(below_m / self.largest)

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        self.largest = max(self.largest, below_m)


@dataclass
class Softening(Part):
    """u (1 + s_k) in the k-th press that the body has seen."""

    grown: Callable[[int], float]
    made: int
    loaded: bool = False

    def begin(self, press):
        """Begin a press anew."""
        self.made += self.loaded
        self.loaded = False

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return below_m * (1 + self.grown(self.made))

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        self.loaded = self.loaded or force_n > 0


@dataclass
class Cooling(Part):
    """The body's stiffness goes with the time."""

    factor: Callable[[float], float]
    start_s: float
    now: float = 1.0
    live: Live = field(default_factory=Live)
    memory = True

    def attach(self, live):
        """Receive the truth of the running scan."""
        self.live = live

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return below_m * self.now

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        self.now = self.factor(self.start_s + self.live.since_first(time_s))


@dataclass
class Sticky(Part):
    """While unloading the surface clings: the body bears F + pull(F), the sensor F."""

    pull_n: float
    scale_n: Callable[[int], float]
    memory = True

    def begin(self, press):
        """Begin a press anew."""
        self.largest, self.falling = 0.0, False

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        if not self.falling or force_n <= 0:
            return below_m
        scale, borne = self.scale_n(press), force_n
        for _ in range(30):
            borne = force_n + self.pull_n * math.exp(-max(borne, 0.0) / scale)
        return below_m * borne / force_n

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        self.largest = max(self.largest, force_n)
        # 0.05 down: the hold's ripple is no unloading
        self.falling = self.falling or force_n < 0.95 * self.largest - 1e-3


@dataclass
class Extra(Part):
    """Travel beside the body's own, by a user's function of time and force."""

    travel_m: Callable[[float, float], float]
    time_s: float = 0.0
    memory = True

    def travel(self, press, force_n, below_m):
        """Return the travel with the present history, m."""
        return below_m + float(self.travel_m(self.time_s, force_n))

    def advance(self, press, time_s, dt, force_n, below_m):
        """Go on in time."""
        self.time_s = time_s
