"""Twenty-one kinds of fault that befall a single press, each where it acts.

Size and moment are drawn anew for each press from the seed, so that a scan with the same seed has
the same faults. What no reading of a robot could show is not among them: a gain of the force sensor
that is off by less than half, a body that moves as slowly as one that creeps. Nor is what no
watchdog could prevent: a blow that drives the tip into the body or the body into the tip.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Collection
from typing import Any

import numpy as np

from sim.planted.arm_and_body_faults import ARM_AND_BODY_FAULTS
from sim.planted.fault_state import Fault
from sim.planted.instrument_in_loop import ALONG
from sim.robot.mechanism import Mechanism


class _Sensor(Fault, ABC):
    def sensor(self, time_s: float, wrench: np.ndarray) -> np.ndarray:
        return self.read(time_s - self.start_s, wrench) if self.active(time_s) else wrench

    @abstractmethod
    def read(self, since_s: float, wrench: np.ndarray) -> np.ndarray:
        """Return the wrench that is read, a time after the fault began."""


class _SensorFrozen(_Sensor):
    def prepare(self) -> None:
        self.last: np.ndarray | None = None

    def read(self, since_s, wrench):
        if self.last is None:
            self.last = wrench
        return self.last


class _SensorDropout(_Sensor):
    """Reads exactly nothing for 10 to 300 ms."""

    def prepare(self) -> None:
        self.length_s = self.uniform(0.01, 0.3)

    def read(self, since_s, wrench):
        return 0.0 * wrench if since_s < self.length_s else wrench


class _SensorNotANumber(_Sensor):
    def read(self, since_s, wrench):
        return np.full(6, np.nan)


class _SensorSpike(_Sensor):
    """One sample is off by 0.2 to 20 N."""

    def prepare(self) -> None:
        self.size_n, self.done = self.uniform(0.2, 20.0, signed=True), False

    def read(self, since_s, wrench):
        if self.done:
            return wrench
        self.done = True
        return _plus(wrench, self.size_n)


class _SensorStep(_Sensor):
    """The zero jumps by 0.1 to 3 N."""

    def prepare(self) -> None:
        self.size_n = self.uniform(0.1, 3.0, signed=True)

    def read(self, since_s, wrench):
        return _plus(wrench, self.size_n)


class _SensorBump(_Sensor):
    """A cable pulls with 0.06 to 0.3 N for 20 to 100 ms."""

    def prepare(self) -> None:
        self.size_n, self.length_s = self.uniform(0.06, 0.3), self.uniform(0.02, 0.1)

    def read(self, since_s, wrench):
        return _plus(wrench, self.size_n) if since_s < self.length_s else wrench


class _SensorGain(_Sensor):
    """The gain about the unloaded reading becomes a tenth to a half, or two to five times."""

    def prepare(self) -> None:
        self.gain = self.uniform(0.1, 0.5) if self.draw.random() < 0.5 else self.uniform(2.0, 5.0)
        self.rest: np.ndarray | None = None

    def sensor(self, time_s, wrench):
        if self.rest is None:
            self.rest = wrench
        return super().sensor(time_s, wrench)

    def read(self, since_s, wrench):
        assert self.rest is not None  # the first sample of an attempt set it
        return self.rest + self.gain * (wrench - self.rest)


class _SensorNoise(_Sensor):
    """Noise of 0.05 to 0.5 N."""

    def prepare(self) -> None:
        self.size_n = self.uniform(0.05, 0.5)

    def read(self, since_s, wrench):
        return _plus(wrench, self.size_n * float(self.draw.standard_normal()))


class _SensorLate(Fault):
    """The force comes 0.2 to 0.5 s late, from the begin of the attempt."""

    def prepare(self) -> None:
        self.start_s = -np.inf
        self.lag_s, self.seen = self.uniform(0.2, 0.5), []

    def sensor(self, time_s, wrench):
        if not self.on:
            return wrench
        self.seen.append((time_s, wrench))
        while len(self.seen) > 1 and self.seen[1][0] <= time_s - self.lag_s:
            self.seen.pop(0)
        return self.seen[0][1]


class _SensorClipped(_Sensor):
    """The amplifier ends at 0.05 to 0.25 N beyond the unloaded reading."""

    def prepare(self) -> None:
        self.most_n, self.rest_n = self.uniform(0.05, 0.25), np.nan
        self.start_s = -np.inf

    def read(self, since_s, wrench):
        if self.rest_n != self.rest_n:
            self.rest_n = float(wrench[ALONG])
        clipped = wrench.copy()
        clipped[ALONG] = min(clipped[ALONG], self.rest_n + self.most_n)
        return clipped


class _Encoder(Fault, ABC):
    def prepare(self) -> None:
        self.joint, self.size_rad = int(self.draw.integers(6)), self.uniform(0.006, 0.05, True)
        self.last_rad = np.nan

    def encoders(self, time_s: float, q: np.ndarray) -> np.ndarray:
        if self.active(time_s):
            q = q.copy()
            q[self.joint] = self.read(float(q[self.joint]))
        return q

    @abstractmethod
    def read(self, angle_rad: float) -> float:
        """Return the angle that is read."""


class _EncoderJump(_Encoder):
    """One joint reads 6 to 50 mrad off."""

    def read(self, angle_rad):
        return angle_rad + self.size_rad


class _EncoderNotANumber(_Encoder):
    def read(self, angle_rad):
        return np.nan


class _EncoderFrozen(_Encoder):
    def read(self, angle_rad):
        if self.last_rad != self.last_rad:
            self.last_rad = angle_rad
        return self.last_rad


class _ClockJump(Fault):
    """The written clock jumps by up to 2 s, to and fro, or stands still."""

    def prepare(self) -> None:
        self.stands, self.by_s = self.draw.random() < 0.3, self.uniform(0.05, 2.0, signed=True)

    def clock(self, time_s: float) -> float:
        if not self.active(time_s):
            return time_s
        return self.start_s if self.stands else time_s + self.by_s


def _plus(wrench: np.ndarray, force_n: float) -> np.ndarray:
    changed = wrench.copy()
    changed[ALONG] += force_n
    return changed


HOOKS = ("sensor", "encoders", "joint_torque", "body_pose", "body", "clock", "scene")

FAULTS: dict[str, type[Fault]] = {
    "sensor_frozen": _SensorFrozen,
    "sensor_dropout": _SensorDropout,
    "sensor_not_a_number": _SensorNotANumber,
    "sensor_spike": _SensorSpike,
    "sensor_step": _SensorStep,
    "sensor_gain": _SensorGain,
    "sensor_noise": _SensorNoise,
    "sensor_late": _SensorLate,
    "sensor_clipped": _SensorClipped,
    "encoder_jump": _EncoderJump,
    "encoder_not_a_number": _EncoderNotANumber,
    "encoder_frozen": _EncoderFrozen,
    **ARM_AND_BODY_FAULTS,
    "clock_jump": _ClockJump,
    "sensor_bump": _SensorBump,
}


def fault(
    name: str, seed: int, presses: Collection[int] | None = None, attempts: int = 10**6
) -> Mechanism:
    """Return a fault as a mechanism.

    Parameters
    ----------
    name : one of `FAULTS`
    seed : of sizes and moments
    presses : that it befalls, None for all
    attempts : of each press that it befalls; later ones are free of it

    Examples
    --------
    >>> fault("sensor_frozen", seed=1, presses={3}).name
    'sensor_frozen'
    """
    made = FAULTS[name](seed, presses, attempts)
    hooks: dict[str, Any] = {hook: getattr(made, hook, None) for hook in HOOKS}
    return Mechanism(name, begin=made.begin, **hooks)
