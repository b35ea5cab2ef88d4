"""Watchdogs: what the robot's own readings say must not go on, during a press and after it.

None of them uses what only the simulator knows, but for the warnings of the simulation itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.motion.settings import ScanSettings
from sim.robot.simulated_arm import SimulatedArm
from sim.scan.look import (
    APART,
    APART_RAD,
    BEHIND,
    DISAGREE,
    EVERY,
    FORCE,
    FORCE_LOST,
    FORCE_RISES,
    NO_ANGLE,
    NO_NUMBER,
    NO_TOUCH,
    REPEATED,
    SPEED,
    TORQUE,
    TORQUES_FORCE,
    TRAVEL,
    UNSTABLE,
    WATCH,
    usually_behind,
)
from sim.scan.outcome import PressFault

KINDS = (
    "tare", "zero", "touch", "travel", "force", "cross_check", "torque", "speed", "following",
    "not_a_number", "repeated", "encoders", "jump", "clock", "simulation", "body",
)  # fmt: skip

REPEATED_S = 0.05
"""A noisy reading never stays the same for so long."""

SLOW_HZ = 10.0
"""Corner of the filter on the difference of the two measurements of force."""

LAG_S = 0.1
GAIN = 0.25
"""Largest lag and relative gain of the force sensor against the joints' torques. Smaller ones are
an error of the instrument, which the analysis has to find."""

NOISE_STEPS = 7.0
"""Changes from sample to sample beyond so many standard deviations are no noise: one in 4e11."""

LEAST_NOISE_N = 2e-3
"""Of a force reading that is trusted: a mechanism may stir more than a sensor without noise."""

TARE_LIMIT_N = 5.0
"""A larger reading at rest is a wrong payload or a contact."""

SPREAD = 3.0
"""Readings at rest may scatter so many times as much as the sensor's data sheet says."""


@dataclass(frozen=True)
class Limits:
    """Limits of one press.

    Attributes
    ----------
    force_n : of the measured force, and of that which the joints' torques show
    disagreement_n : of these two from each other
    travel_m : of the tip beyond the planned surface, braking included
    seek_m : of the tip beyond the planned surface before it has touched
    speed : of the joints, (n,) rad/s
    """

    force_n: float
    disagreement_n: float
    travel_m: float
    seek_m: float
    speed: np.ndarray


def limits_of(
    settings: ScanSettings, set_force_n: float, travel_m: float, speed: np.ndarray
) -> Limits:
    """Return the limits for a press with a set force.

    Parameters
    ----------
    travel_m : depth that the plan provides for
    speed : the joints' own limits, (n,) rad/s
    """
    force = settings.force_limit_n or 2 * set_force_n + 0.5
    return Limits(force, 0.1 + 0.25 * set_force_n, travel_m, min(travel_m, 0.02), speed)


class Watchdog:
    """Follows the readings of one press, step by step.

    Parameters
    ----------
    rig : the arm
    settings : noise and limits

    Attributes
    ----------
    state : (1,) of `WATCH`
    lever, speed_limit, room : (n,) m, the tip's Jacobian along the press direction; rad/s; room for
        torques
    """

    def __init__(self, rig: SimulatedArm, settings: ScanSettings) -> None:
        self._rig, self._noise = rig, settings.force_noise_n
        self._allowed = max(settings.force_noise_n, LEAST_NOISE_N)
        self.state = np.zeros(1, WATCH)
        self.lever, self.speed_limit, self.room = np.zeros((3, len(rig.q)))
        self.state["repeats_at"] = round(REPEATED_S / rig.dt) if self._noise else 0
        self.state["share"] = 1 - np.exp(-2 * np.pi * SLOW_HZ * EVERY * rig.dt)
        self.state["last_n"] = np.nan

    def begin(self, limits: Limits, lever: np.ndarray) -> None:
        """Begin a press; the arm stands still and nothing is touched.

        Parameters
        ----------
        lever : (n,) m, the tip's Jacobian along the press direction
        """
        self.limits = limits
        self.lever[:], self.speed_limit[:] = lever, limits.speed
        state = self.state
        state["force_limit_n"], state["disagreement_n"] = limits.force_n, limits.disagreement_n
        state["travel_limit_m"], state["seek_limit_m"] = limits.travel_m, limits.seek_m
        for name in ("repeats", "looks", "held", "apart_n", "before_n", "before_that_n"):
            state[name] = 0
        state["rest_n"] = self._rig.force_by_torque(lever)

    def refuse_tare(self, readings: np.ndarray) -> np.ndarray:
        """Check the readings (t, 3) N at rest before an approach; return what is to be tared.

        A mean within its own standard error is left: taring by it would add its noise to every
        reading of the press.
        """
        if self._rig.unstable:
            raise PressFault("simulation", "the simulation became unstable (MuJoCo's warning)")
        if not np.isfinite(readings).all():
            raise PressFault("not_a_number", "the force sensor gives no number at rest")
        mean, spread = readings.mean(axis=0), readings.std(axis=0)
        if self._noise and (spread < 0.05 * self._noise).any():
            raise PressFault(
                "repeated", "the force sensor repeats one value at rest; check its connection"
            )
        if self._noise and (spread > SPREAD * self._noise + 1e-3).any():
            raise PressFault(
                "tare",
                f"the force scatters by {spread.max():.3g} N at rest, {self._noise:.3g} N is "
                "usual; nothing must touch the tip before a press",
            )
        if np.abs(mean).max() > TARE_LIMIT_N:
            raise PressFault(
                "tare",
                f"the force reads {mean[np.abs(mean).argmax()]:.3g} N at rest, at most "
                f"{TARE_LIMIT_N:g} N is tared; check the payload and that nothing touches the tip",
            )
        error = self._noise / np.sqrt(len(readings))
        return np.where(np.abs(mean) > 4 * error, mean, 0.0)

    def fault(self, found: int) -> PressFault:
        """Return the fault that a look has found, in words."""
        kind, words = self._speed() if found == SPEED else self._words(found)
        return PressFault(kind, words)

    def _speed(self) -> tuple[str, str]:
        """Return kind and words of a joint that turns too fast."""
        speed, limit = self._rig.v, self.limits.speed
        joint = int((np.abs(speed) / limit).argmax())
        return (
            "speed",
            f"joint {joint + 1} turns at {abs(speed[joint]):.3g} rad/s, its limit is "
            f"{limit[joint]:.3g}",
        )

    def _words(self, found: int) -> tuple[str, str]:
        """Return kind and words of any other fault."""
        seen, limits = self.state[0], self.limits
        force, limit = seen["force_n"], f"the limit is {limits.force_n:.3g} N"
        return {
            NO_NUMBER: ("not_a_number", "the force sensor gives no number"),
            FORCE: ("force", f"the force reads {force:.3g} N, {limit}"),
            FORCE_RISES: (
                "force",
                f"the force reads {force:.3g} N and rises by {seen['rate_n_per_s']:.3g} N/s "
                f"towards the limit of {limits.force_n:.3g} N",
            ),
            FORCE_LOST: (
                "force",
                f"the force reads {force:.3g} N where {seen['wanted_n']:.3g} N is held: the body "
                "has moved, the tip has slipped, or the sensor is at fault",
            ),
            NO_TOUCH: (
                "touch",
                f"no touch within {1e3 * limits.seek_m:.3g} mm below the planned surface; "
                "check the body's place and the force sensor",
            ),
            TRAVEL: (
                "travel",
                f"the tip comes {1e3 * seen['stands_m']:.3g} mm deep at {force:.3g} N, the limit "
                f"is {1e3 * limits.travel_m:.3g} mm; press with less force or set a larger depth_m",
            ),
            REPEATED: (
                "repeated",
                f"the force sensor has repeated {seen['last_n']:.4g} N for {REPEATED_S:g} s",
            ),
            NO_ANGLE: ("encoders", "an encoder gives no number"),
            APART: (
                "encoders",
                f"a joint's reading has moved by {seen['apart_rad']:.3g} rad from that at its "
                f"motor, at most {APART_RAD:g} rad are usual",
            ),
            BEHIND: (
                "following",
                f"a joint reads {seen['behind_rad']:.3g} rad beside its command, at most "
                f"{usually_behind(limits.force_n):.3g} rad are usual",
            ),
            UNSTABLE: ("simulation", "the simulation became unstable (MuJoCo's warning)"),
            TORQUES_FORCE: (
                "force",
                f"the joints' torques show {seen['by_torque_n']:.3g} N, {limit}; the force sensor "
                f"reads {force:.3g} N",
            ),
            DISAGREE: (
                "cross_check",
                f"the force sensor reads {seen['apart_n']:+.3g} N beside the force that the "
                f"joints' torques show, at most {limits.disagreement_n:.3g} N are usual",
            ),
            TORQUE: ("torque", "a joint's torque is at its limit"),
        }[found]

    def check_forces(self, force: np.ndarray, torque: np.ndarray) -> None:
        """Compare the two measurements of force (k,) N, EVERY steps apart, approach to retraction.

        The sensor's force is a + b T + c dT/dt + d d2T/dt2 with T from the joints' torques: b is
        its gain, -c its lag, and a single reading beside that line is no force on the arm.
        """
        rate = np.gradient(torque, EVERY * self._rig.dt)
        change = np.gradient(rate, EVERY * self._rig.dt)
        columns = np.column_stack([np.ones_like(torque), torque, rate, change])
        found, *_ = np.linalg.lstsq(columns, force, rcond=None)
        gain, minus_lag = found[1:3]
        if abs(minus_lag) > LAG_S or abs(gain - 1) > GAIN:
            raise PressFault(
                "cross_check",
                f"against the joints' torques the force sensor has a gain of {gain:.2f} and a lag "
                f"of {-minus_lag:.2f} s; at most {GAIN:g} off and {LAG_S:g} s are usual",
            )
        beside = np.convolve(force - columns @ found, np.full(3, 1 / 3), "same")
        allowed = NOISE_STEPS * self._allowed / np.sqrt(3) + 0.02 * np.abs(torque).max()
        if np.abs(beside).max() > allowed:
            raise PressFault(
                "cross_check",
                f"for a moment the force sensor read {np.abs(beside).max():.3g} N beside the force "
                f"that the joints' torques show, at most {allowed:.3g} N are noise",
            )

    def zero_moved(self, readings: np.ndarray, set_force_n: float) -> float:
        """Return the force (t,) N along the probe when the tip is free again, 0 if it is noise."""
        mean = float(readings.mean())
        if abs(mean) > 5 * self._noise / np.sqrt(len(readings)) + 0.2 * set_force_n:
            raise PressFault(
                "zero", f"the force reads {mean:.3g} N after the press: its zero has moved"
            )
        return mean if abs(mean) > 5 * self._noise / np.sqrt(len(readings)) else 0.0
