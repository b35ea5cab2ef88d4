"""Planted errors of sensor, encoders and place of the surface, stepped through time."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from sim.planted.bench import Bench
from sim.robot.mechanism import Live, Mechanism, Tare

ALONG = 2
"""Component of the sensor's wrench along the probe."""


@dataclass(frozen=True)
class PlantScene:
    """The scan in which a mechanism acts.

    Attributes
    ----------
    bench : the presses as the bench would make them, on the body as it is so far
    centre_m : (2,) of the body's top, body frame
    directions : (j, 3) unit, of the presses, world frame
    start_s : time of the body's clock at which this scan begins
    presses_before : that were made on the body before
    """

    bench: Bench
    directions: np.ndarray
    start_s: float = 0.0
    presses_before: int = 0

    @property
    def radius_m(self) -> np.ndarray:
        """Of the tip of each press, (j,)."""
        return self.bench.program.radius_m

    def deepest_m(self, press: int) -> float:
        """Elastic travel of a press under its set force."""
        return float(self.bench.compliance()[press] * self.bench.program.force_n[press])


@dataclass
class Reading:
    """Reading of the sensor by contact force and time since the first approach."""

    read: Callable[[float, float], float]
    start_s: float
    live: Live = field(default_factory=Live)

    def attach(self, live: Live) -> None:
        """Receive the truth of the running scan."""
        self.live = live

    def sensor(self, time_s: float, wrench: np.ndarray) -> np.ndarray:
        """Return the sensor's reading."""
        true = self.live.contact_n
        since = self.start_s + self.live.since_first(time_s)
        changed = wrench.copy()
        changed[ALONG] += self.read(since, true) - true
        return changed


def on_sensor(
    name: str,
    scene: PlantScene,
    read: Callable[[float, float], float],
    tare: Tare = "scan",
) -> Mechanism:
    """Return a sensor that reads `read(time, true force)`, tared once a scan or otherwise.

    Where the zero of the force is not renewed, travel counts from the planned surface: a first
    touch that is found from the same force would move with its zero, and hide it.
    """
    made = Reading(read, scene.start_s)
    zero = "touch" if tare == "press" else "plane"
    return Mechanism(name, attach=made.attach, sensor=made.sensor, tare=tare, zero=zero)


@dataclass
class Late:
    """A channel that comes late; its first value lasts until then."""

    lag_s: float
    seen: list[tuple[float, Any]] = field(default_factory=list)

    def read(self, time_s: float, value: Any) -> Any:
        """Return the value of a while ago."""
        self.seen.append((time_s, value))
        at = time_s - self.lag_s
        while len(self.seen) > 2 and self.seen[1][0] <= at:
            self.seen.pop(0)
        (t0, v0), (t1, v1) = self.seen[0], self.seen[min(1, len(self.seen) - 1)]
        share = min(max((at - t0) / (t1 - t0), 0.0), 1.0) if t1 > t0 else 0.0
        return v0 + share * (v1 - v0)


@dataclass
class LowPass:
    """First order, in the sensor's amplifier."""

    tau_s: float
    time_s: float = 0.0
    force_n: float = 0.0
    unfiltered_n: float = 0.0

    def read(self, time_s: float, force_n: float) -> float:
        """Return the filtered force; between two readings the force is their mean."""
        if not self.tau_s:
            return force_n
        gained = -math.expm1(-(time_s - self.time_s) / self.tau_s)
        between_n, self.unfiltered_n = (self.unfiltered_n + force_n) / 2, force_n
        self.time_s, self.force_n = time_s, self.force_n + gained * (between_n - self.force_n)
        return self.force_n


@dataclass
class Averaging:
    """Mean over a window, in the sensor's converter."""

    window_s: float
    time_s: float | None = None
    force_n: float = 0.0
    summed: float = 0.0

    def __post_init__(self) -> None:
        self.before = Late(self.window_s)

    def read(self, time_s: float, force_n: float) -> float:
        """Return the mean force of the window that ends now."""
        if self.time_s is not None:
            self.summed += (time_s - self.time_s) * (self.force_n + force_n) / 2
        self.time_s, self.force_n = time_s, force_n
        before = self.before.read(time_s, self.summed)
        return (self.summed - before) / self.window_s if self.window_s else force_n


@dataclass
class GuideFriction:
    """A guide between sensor and tip: its friction opposes the way, and turns over a part of it."""

    scene: PlantScene
    friction_n: float
    turn_share: float
    live: Live = field(default_factory=Live)
    behind_m: float = 0.0

    def attach(self, live: Live) -> None:
        """Receive the truth of the running scan."""
        self.live = live

    def begin(self, press: int, time_s: float) -> None:
        """Begin a press anew."""
        self.behind_m = 0.0

    def sensor(self, time_s: float, wrench: np.ndarray) -> np.ndarray:
        """Return the sensor's reading."""
        press = self.live.press
        width = self.turn_share * self.scene.deepest_m(press)
        u = self.live.contact_n * float(self.scene.bench.compliance()[press])
        self.behind_m = min(max(self.behind_m, u - width), u + width)
        changed = wrench.copy()
        changed[ALONG] += self.friction_n * (u - self.behind_m) / width
        return changed


def on_surface(
    name: str,
    scene: PlantScene,
    sinks_m: Callable[[float, int], float],
    from_touch: bool = False,
) -> Mechanism:
    """A surface that goes into the press direction; travel counts from the planned surface."""
    live = Live()

    def attach(of_scan: Live) -> None:
        """Receive the truth of the running scan."""
        nonlocal live
        live = of_scan

    def pose(time_s: float, press: int) -> np.ndarray:
        since = scene.start_s + live.since_first(time_s)
        return sinks_m(since, press) * scene.directions[press]

    zero = "touch" if from_touch else "plane"
    return Mechanism(name, attach=attach, body_pose=pose, zero=zero)


@dataclass
class CoarseEncoder:
    """Travel in whole steps: the joints' reading jumps along the tip's path."""

    step_m: float
    live: Live = field(default_factory=Live)

    def attach(self, live: Live) -> None:
        """Receive the truth of the running scan."""
        self.live = live

    def encoders(self, time_s: float, q: np.ndarray) -> np.ndarray:
        """Return the joints' reading."""
        if not self.step_m or not self.live.touched:
            return q
        depth = self.live.depth_of(q)
        rounded = self.step_m * round(depth / self.step_m)
        return q + (rounded - depth) * self.live.slope_of(depth)


@dataclass
class Backlash:
    """Play of the joints: after a turn the reading goes back by its width before the tip does."""

    way_m: float
    live: Live = field(default_factory=Live)
    largest_m: float = 0.0

    def attach(self, live: Live) -> None:
        """Receive the truth of the running scan."""
        self.live = live

    def begin(self, press: int, time_s: float) -> None:
        """Begin a press anew."""
        self.largest_m = 0.0

    def encoders(self, time_s: float, q: np.ndarray) -> np.ndarray:
        """Return the joints' reading."""
        if not self.live.touched:
            return q
        depth = self.live.depth_of(q)
        self.largest_m = max(self.largest_m, depth)
        return q - min(self.largest_m - depth, self.way_m) * self.live.slope_of(depth)
