"""Watchdogs: what the robot's own readings say must not go on, during a press and after it.

None of them uses what only the simulator knows, but for the warnings of the simulation itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from sim.motion.settings import ScanSettings
from sim.robot.simulated_arm import SimulatedArm
from sim.scan.outcome import PressFault

KINDS = (
    "tare", "zero", "touch", "travel", "force", "cross_check", "torque", "speed", "following",
    "not_a_number", "repeated", "encoders", "jump", "clock", "simulation", "body",
)  # fmt: skip

EVERY = 5
"""Steps between two checks of the slower watchdogs."""

REPEATED_S = 0.05
"""A noisy reading never stays the same for so long."""

SLOW_HZ = 10.0
"""Corner of the filter on the difference of the two measurements of force."""

BRAKING_M_PER_S2 = 5.0
"""Of the tip after a fault."""

APART_RAD = 5e-4
"""Largest change between the reading at a joint and at its motor since the scan began."""

FOLLOWING_RAD, FOLLOWING_RAD_PER_N = 1e-3, 2e-4
"""Largest difference between a joint's command and its reading, at rest and for each newton of the
limit of force."""

AHEAD_S, AHEAD_OF_TOUCH_S = 0.012, 0.004
"""At its present rate the force must stay below its limit for so long, and until the tip stands:
then it moves back. At touch-down a hard body's force rises as fast and stops."""

RATE_STEPS = 2
"""Steps over which the rate is taken."""

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
    """

    def __init__(self, rig: SimulatedArm, settings: ScanSettings) -> None:
        self._rig, self._noise = rig, settings.force_noise_n
        self._allowed = max(settings.force_noise_n, LEAST_NOISE_N)
        self._repeats_at = round(REPEATED_S / rig.dt)
        self._share = 1 - np.exp(-2 * np.pi * SLOW_HZ * EVERY * rig.dt)
        self._last, self._repeats, self._count, self._apart = np.nan, 0, 0, 0.0
        self._by_torque, self._before = 0.0, [0.0] * RATE_STEPS

    def begin(self, limits: Limits, lever: np.ndarray) -> None:
        """Begin a press; the arm stands still and nothing is touched.

        Parameters
        ----------
        lever : (n,) m, the tip's Jacobian along the press direction
        """
        self.limits, self._lever = limits, lever
        self._repeats, self._apart, self._count = 0, 0.0, 0
        self._forces: list[tuple[float, float]] = []
        self._before, self._held = [0.0] * RATE_STEPS, False
        self._rest = self._rig.force_by_torque(lever)

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

    def look(
        self,
        depth_m: float,
        speed_m_per_s: float,
        touched: bool,
        loaded: bool,
        wanted_n: float | None = None,
    ) -> None:
        """Check one step; raise the fault that was found.

        Parameters
        ----------
        depth_m, speed_m_per_s : commanded
        touched : the tip is or was in contact
        loaded : the force is controlled
        wanted_n : force that is followed, where the body's stiffness is known by now
        """
        rig, limits = self._rig, self.limits
        force = self._look_at_force(speed_m_per_s, loaded, wanted_n)
        # The table may lie at the limit: the tip has to stand before it
        speed = max(speed_m_per_s, 0.0)
        stands_m = depth_m + speed * rig.dt + speed**2 / (2 * BRAKING_M_PER_S2)
        if stands_m > (limits.travel_m if touched else limits.seek_m):
            if not touched:
                raise PressFault(
                    "touch",
                    f"no touch within {1e3 * limits.seek_m:.3g} mm below the planned surface; "
                    "check the body's place and the force sensor",
                )
            raise PressFault(
                "travel",
                f"the tip comes {1e3 * stands_m:.3g} mm deep at {force:.3g} N, the limit is "
                f"{1e3 * limits.travel_m:.3g} mm; press with less force or set a larger depth_m",
            )
        read = float(rig.sensor_n[2])
        self._repeats = self._repeats + 1 if read == self._last else 0
        self._last = read
        if self._repeats >= self._repeats_at and self._noise:
            raise PressFault(
                "repeated", f"the force sensor has repeated {read:.4g} N for {REPEATED_S:g} s"
            )
        if rig.q_read is not rig.q_seen:
            if not np.isfinite(rig.q_read).all():
                raise PressFault("encoders", "an encoder gives no number")
            if rig.apart_rad > APART_RAD:
                raise PressFault(
                    "encoders",
                    f"a joint's reading has moved by {rig.apart_rad:.3g} rad from that at its "
                    f"motor, at most {APART_RAD:g} rad are usual",
                )
            self._look_behind()
        self._count += 1
        if self._count % EVERY == 0:
            self._look_slowly(force, loaded)

    def _look_at_force(self, speed_m_per_s: float, loaded: bool, wanted_n: float | None) -> float:
        """Check the force, its rate, and where it is held; return it, N."""
        rig, limits = self._rig, self.limits
        force = float(rig.wrist_n[2])
        if not abs(force) <= limits.force_n:
            if force != force:
                raise PressFault("not_a_number", "the force sensor gives no number")
            raise PressFault(
                "force", f"the force reads {force:.3g} N, the limit is {limits.force_n:.3g} N"
            )
        rate = (force - self._before.pop(0)) / (RATE_STEPS * rig.dt)
        self._before.append(force)
        ahead = AHEAD_S if loaded else AHEAD_OF_TOUCH_S
        ahead += loaded * max(speed_m_per_s, 0.0) / BRAKING_M_PER_S2
        if force + ahead * rate > limits.force_n:
            raise PressFault(
                "force",
                f"the force reads {force:.3g} N and rises by {rate:.3g} N/s towards the limit of "
                f"{limits.force_n:.3g} N",
            )
        off = 0.0 if wanted_n is None else abs(force - wanted_n)
        self._held |= wanted_n is not None and off < limits.disagreement_n / 2
        if self._held and off > limits.disagreement_n:
            raise PressFault(
                "force",
                f"the force reads {force:.3g} N where {wanted_n:.3g} N is held: the body has "
                "moved, the tip has slipped, or the sensor is at fault",
            )
        return force

    def _look_slowly(self, force: float, loaded: bool) -> None:
        rig, limits = self._rig, self.limits
        if rig.unstable:
            raise PressFault("simulation", "the simulation became unstable (MuJoCo's warning)")
        self._by_torque = rig.force_by_torque(self._lever) - self._rest
        if not abs(self._by_torque) <= limits.force_n:
            raise PressFault(
                "force",
                f"the joints' torques show {self._by_torque:.3g} N, the limit is "
                f"{limits.force_n:.3g} N; the force sensor reads {force:.3g} N",
            )
        self._apart += self._share * (force - self._by_torque - self._apart)
        if abs(self._apart) > limits.disagreement_n:
            raise PressFault(
                "cross_check",
                f"the force sensor reads {self._apart:+.3g} N beside the force that the joints' "
                f"torques show, at most {limits.disagreement_n:.3g} N are usual",
            )
        if loaded:
            self._forces.append((force, self._by_torque))
        self._look_behind()
        if rig.torque_share > 1:
            raise PressFault("torque", "a joint's torque is at its limit")
        if (np.abs(rig.v) > limits.speed).any():
            joint = int((np.abs(rig.v) / limits.speed).argmax())
            raise PressFault(
                "speed",
                f"joint {joint + 1} turns at {abs(rig.v[joint]):.3g} rad/s, its limit is "
                f"{limits.speed[joint]:.3g}",
            )

    def _look_behind(self) -> None:
        rig, limits = self._rig, self.limits
        usual = FOLLOWING_RAD + FOLLOWING_RAD_PER_N * limits.force_n
        if rig.behind_rad > usual:
            raise PressFault(
                "following",
                f"a joint reads {rig.behind_rad:.3g} rad beside its command, at most "
                f"{usual:.3g} rad are usual",
            )

    def check_forces(self) -> None:
        """Compare the two measurements of force over the whole press.

        The sensor's force is a + b T + c dT/dt + d d2T/dt2 with T from the joints' torques: b is
        its gain, -c its lag, and a single reading beside that line is no force on the arm.
        """
        force, torque = np.array(self._forces).T
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
