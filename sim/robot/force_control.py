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

import numpy as np

from sim.robot.arm_steps import SERVO_RAD_PER_S
from sim.robot.compiled import compiled, part

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
        return line_at(self.duration_s, self.blend_s, time_s)


@compiled
def line_at(duration_s: float, blend_s: float, time_s: float) -> tuple[float, float]:
    """See `RoundedLine`."""
    rate = 1 / (duration_s - blend_s)
    left = duration_s - time_s
    if time_s < blend_s:
        grown = time_s / blend_s
        return rate * grown * time_s / 2, rate * grown
    if left < blend_s:
        grown = left / blend_s
        return 1 - rate * grown * left / 2, rate * grown
    return rate * (time_s - blend_s / 2), rate


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


CONTROL = np.dtype(
    [
        (name, float)
        for name in (
            "depth_m", "speed_m_per_s", "force_n", "stiffness", "wanted_n", "sinking_m_per_s",
            "servo_m", "servo_m_per_s", "servo_filtered_m", "origin_n", "origin_m",
            "dt", "filter", "learn", "least_rise_n",
        )
    ]
)  # fmt: skip
"""State of the force control: command, filtered force, estimate of the stiffness, followed force,
speed of a creeping body, model of the servo, where the tip touched; and its constants."""


class ForceControl:
    """Commanded depth of the tip along a press direction.

    Parameters
    ----------
    dt : control period, s
    stiffness_n_per_m : first guess of the local stiffness
    force_noise_n : standard deviation of a force sample; smaller changes of force teach nothing

    Attributes
    ----------
    state : (1,) of `CONTROL`
    """

    def __init__(self, dt: float, stiffness_n_per_m: float, force_noise_n: float) -> None:
        self.state = np.zeros(1, CONTROL)
        share = 1 - math.exp(-2 * math.pi * FILTER_HZ * dt)
        noise_left = force_noise_n * math.sqrt(share / (2 - share))
        self.state["dt"], self.state["filter"] = dt, share
        self.state["learn"] = 1 - math.exp(-dt / LEARN_S)
        self.state["least_rise_n"] = max(6 * noise_left, 1e-3)
        self.stiffness = stiffness_n_per_m

    @property
    def depth_m(self) -> float:
        """Commanded depth."""
        return float(self.state["depth_m"][0])

    @property
    def speed_m_per_s(self) -> float:
        """Commanded speed."""
        return float(self.state["speed_m_per_s"][0])

    @property
    def force_n(self) -> float:
        """Filtered measured force."""
        return float(self.state["force_n"][0])

    @property
    def stiffness(self) -> float:
        """Present estimate, N/m; it is kept from press to press."""
        return float(self.state["stiffness"][0])

    @stiffness.setter
    def stiffness(self, value: float) -> None:
        self.state["stiffness"] = value

    def rest(self, depth_m: float) -> None:
        """Stand still at a depth, out of contact."""
        kept = ("stiffness", "dt", "filter", "learn", "least_rise_n")
        for name in CONTROL.names or ():
            if name not in kept:
                self.state[name] = 0.0
        for name in ("depth_m", "servo_m", "servo_filtered_m", "origin_m"):
            self.state[name] = depth_m

    def line(self, change_n: float, duration_s: float) -> RoundedLine:
        """Return a rounded line over a change of force that keeps to half of the acceleration.

        The other half is for an estimate of the stiffness that is too high.
        """
        length = abs(change_n) / self.stiffness
        return rounded_line(length, duration_s, ACCELERATION_M_PER_S2 / 2)

    def feel(self, force_n: float) -> None:
        """Take in a measured force."""
        feel(self.state, force_n)

    def press(self, wanted_n: float, rate_n_per_s: float) -> None:
        """Follow a wanted force and its rate of change."""
        press(self.state, wanted_n, rate_n_per_s, False)

    def touch(self) -> None:
        """Note that the tip has come into contact: stiffness is learnt from here on."""
        state = self.state
        state["wanted_n"] = state["origin_n"] = state["force_n"]
        state["origin_m"], state["sinking_m_per_s"] = state["servo_filtered_m"], 0.0


@compiled
def feel(state: np.ndarray, force_n: float) -> None:
    """Take in a measured force; `state` is (1,) of `CONTROL`, here and below."""
    c = state[0]
    c.force_n += c.filter * (force_n - c.force_n)


@part
def move(state: np.ndarray, speed: float) -> None:
    """Go on at a speed, as far as the acceleration allows; the force is not controlled."""
    c = state[0]
    dt, gain = c.dt, SERVO_RAD_PER_S
    change = ACCELERATION_M_PER_S2 * dt
    speed = max(c.speed_m_per_s - change, min(c.speed_m_per_s + change, speed))
    c.depth_m += speed * dt
    c.speed_m_per_s = speed
    pull = gain * gain * (c.depth_m - c.servo_m) + 2 * gain * (speed - c.servo_m_per_s)
    c.servo_m_per_s += pull * dt
    c.servo_m += c.servo_m_per_s * dt
    c.servo_filtered_m += c.filter * (c.servo_m - c.servo_filtered_m)


@part
def stop(state: np.ndarray) -> None:
    """Hold the depth, as after touching."""
    move(state, 0.0)
    _learn_stiffness(state)
    state[0].wanted_n = state[0].force_n


@compiled
def press(state: np.ndarray, wanted_n: float, rate_n_per_s: float, learn: bool) -> None:
    """Follow a wanted force and its rate of change."""
    c = state[0]
    c.wanted_n += c.filter * (wanted_n - c.wanted_n)
    if learn:
        _learn_stiffness(state)
    missing = (c.wanted_n - c.force_n) / RETURN_S
    if rate_n_per_s == 0:  # a body that creeps sinks on while the force is held
        c.sinking_m_per_s += missing * c.dt / (c.stiffness * SINKING_S)
    else:
        c.sinking_m_per_s = 0.0
    speed = (rate_n_per_s + missing) / c.stiffness + c.sinking_m_per_s
    move(state, max(-FASTEST_M_PER_S, min(FASTEST_M_PER_S, speed)))


@part
def _learn_stiffness(state: np.ndarray) -> None:
    c = state[0]
    rise = c.force_n - c.origin_n
    travel = c.servo_filtered_m - c.origin_m
    if rise > c.least_rise_n and travel > 0:
        slope = max(STIFFNESS_RANGE[0], min(STIFFNESS_RANGE[1], rise / travel))
        c.stiffness += c.learn * (slope - c.stiffness)
