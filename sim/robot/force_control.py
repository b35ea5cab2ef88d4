"""Force control of a press: one number, the commanded depth, follows the measured force.

Admittance on top of a position servo. With the wanted force F(t), the filtered measured force f
and the local stiffness K,

    dh/dt = dF/dt / K + (F_filtered - f) / (K T).

While the force is held, the speed at which a creeping body sinks is learnt from the second term's
integral. With the right K the first term alone would do; the second removes the remaining error. F
passes the same filter as f, so that the filter's delay makes no error and no overshoot. K is learnt
while the force rises, as the slope of the filtered force over the servo's depth since touch; the
servo is known (two poles), so its lag is modelled, not guessed.

All changes of speed are bounded. So that the bound never takes hold while the force is followed,
which would make it overshoot, a straight line of force has rounded ends (`line`).

Touch-down is not controlled: a tip that comes with speed v onto stiffness K rings up to
v sqrt(K m), m being the arm's 5 kg. At 1.5 mm/s that is 0.03 N on 60 N/m and 1 N on 100 kN/m:
approach a hard body more slowly, or press it harder.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from sim.robot.simulated_arm import SERVO_RAD_PER_S

FILTER_HZ = 10.0
RETURN_S = 0.15
LEARN_S = 0.03
SINKING_S = 0.4
FASTEST_M_PER_S = 0.1
ACCELERATION_M_PER_S2 = 0.5
STIFFNESS_RANGE = (5.0, 2e5)
ROUNDED = 0.1
"""Least part of a line's duration in each end. Sharper ones would show: the contact has a gram of
mass of its own (`contact_coupling`), and a row of the scan stands at the end of the line."""


@dataclass(frozen=True)
class RoundedLine:
    """From 0 to 1 in `duration_s`; the rate rises evenly for `blend_s` and falls as long."""

    duration_s: float
    blend_s: float

    def at(self, time_s: float) -> tuple[float, float]:
        """Return how far it has come and its rate, 1/s."""
        rate = 1 / (self.duration_s - self.blend_s)
        left = self.duration_s - time_s
        if time_s < self.blend_s:
            grown = time_s / self.blend_s
            return rate * grown * time_s / 2, rate * grown
        if left < self.blend_s:
            grown = left / self.blend_s
            return 1 - rate * grown * left / 2, rate * grown
        return rate * (time_s - self.blend_s / 2), rate


def rounded_line(length_m: float, duration_s: float, acceleration: float) -> RoundedLine:
    """Return the line that takes a way in a time: rounded as far as needed, or else longer.

    Parameters
    ----------
    length_m : of the way
    duration_s : wanted
    acceleration : the most that the way may ask for, m/s^2

    Examples
    --------
    >>> line = rounded_line(0.04, 1.0, 0.25)
    >>> round(line.blend_s, 6), line.at(0.5)[0]
    (0.2, 0.5)
    >>> rounded_line(0.04, 0.5, 0.25).duration_s
    0.8
    """
    duration = max(duration_s, 2 * math.sqrt(length_m / acceleration))
    room = max(duration**2 - 4 * length_m / acceleration, 0.0)
    return RoundedLine(duration, max((duration - math.sqrt(room)) / 2, ROUNDED * duration))


class ForceControl:
    """Commanded depth of the tip along a press direction.

    Parameters
    ----------
    dt : control period, s
    stiffness_n_per_m : first guess of the local stiffness
    force_noise_n : standard deviation of a force sample; smaller changes of force teach nothing

    Attributes
    ----------
    depth_m, speed_m_per_s : command for the servo
    force_n : filtered measured force
    stiffness : present estimate, N/m; it is kept from press to press
    """

    def __init__(self, dt: float, stiffness_n_per_m: float, force_noise_n: float) -> None:
        self._dt = dt
        self._filter = 1 - math.exp(-2 * math.pi * FILTER_HZ * dt)
        self._learn = 1 - math.exp(-dt / LEARN_S)
        noise_left = force_noise_n * math.sqrt(self._filter / (2 - self._filter))
        self._least_rise = max(6 * noise_left, 1e-3)
        self.stiffness = stiffness_n_per_m
        self.rest(0.0)

    def rest(self, depth_m: float) -> None:
        """Stand still at a depth, out of contact."""
        self.depth_m, self.speed_m_per_s = depth_m, 0.0
        self._servo, self._servo_speed, self._servo_filtered = depth_m, 0.0, depth_m
        self.force_n = self._wanted = self._sinking = 0.0
        self._origin = (0.0, depth_m)

    def line(self, change_n: float, duration_s: float) -> RoundedLine:
        """Return a rounded line over a change of force that keeps to half of the acceleration.

        The other half is for an estimate of the stiffness that is too high.
        """
        length = abs(change_n) / self.stiffness
        return rounded_line(length, duration_s, ACCELERATION_M_PER_S2 / 2)

    def feel(self, force_n: float) -> None:
        """Take in a measured force."""
        self.force_n += self._filter * (force_n - self.force_n)

    def move(self, speed_m_per_s: float) -> None:
        """Go on at a speed; the force is not controlled."""
        self._advance(speed_m_per_s)

    def touch(self) -> None:
        """Note that the tip has come into contact: stiffness is learnt from here on."""
        self._wanted, self._sinking = self.force_n, 0.0
        self._origin = (self.force_n, self._servo_filtered)

    def stop(self) -> None:
        """Hold the depth, as after touching."""
        self._advance(0.0)
        self._learn_stiffness()
        self._wanted = self.force_n

    def press(self, wanted_n: float, rate_n_per_s: float, learn: bool) -> None:
        """Follow a wanted force and its rate of change."""
        self._wanted += self._filter * (wanted_n - self._wanted)
        if learn:
            self._learn_stiffness()
        missing = (self._wanted - self.force_n) / RETURN_S
        # A body that creeps sinks on while the force is held
        held = rate_n_per_s == 0
        self._sinking += held * missing * self._dt / (self.stiffness * SINKING_S)
        self._sinking *= held
        speed = (rate_n_per_s + missing) / self.stiffness + self._sinking
        self._advance(max(-FASTEST_M_PER_S, min(FASTEST_M_PER_S, speed)))

    def _advance(self, speed: float) -> None:
        dt, gain = self._dt, SERVO_RAD_PER_S
        change = ACCELERATION_M_PER_S2 * dt
        speed = max(self.speed_m_per_s - change, min(self.speed_m_per_s + change, speed))
        self.depth_m += speed * dt
        self.speed_m_per_s = speed
        pull = gain * gain * (self.depth_m - self._servo) + 2 * gain * (speed - self._servo_speed)
        self._servo_speed += pull * dt
        self._servo += self._servo_speed * dt
        self._servo_filtered += self._filter * (self._servo - self._servo_filtered)

    def _learn_stiffness(self) -> None:
        rise = self.force_n - self._origin[0]
        travel = self._servo_filtered - self._origin[1]
        if rise > self._least_rise and travel > 0:
            slope = max(STIFFNESS_RANGE[0], min(STIFFNESS_RANGE[1], rise / travel))
            self.stiffness += self._learn * (slope - self.stiffness)
