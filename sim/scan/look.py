"""Look at one step of a press: what the robot's readings say must not go on.

Nothing here uses what only the simulator knows, but for the warnings of the simulation itself.
"""

from __future__ import annotations

import math

import numpy as np

from sim.robot.arm_steps import ArmState, force_by_torque
from sim.robot.compiled import compiled, part

EVERY = 5
"""Steps between two checks of the slower watchdogs."""

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

(
    FINE, NO_NUMBER, FORCE, FORCE_RISES, FORCE_LOST, NO_TOUCH, TRAVEL, REPEATED, NO_ANGLE, APART,
    BEHIND, UNSTABLE, TORQUES_FORCE, DISAGREE, TORQUE, SPEED,
) = range(16)  # fmt: skip
"""What a look at a step finds."""

WATCH = np.dtype(
    [
        (name, float)
        for name in (
            "force_limit_n", "disagreement_n", "travel_limit_m", "seek_limit_m", "share", "rest_n",
            "last_n", "before_n", "before_that_n", "by_torque_n", "apart_n",
            "force_n", "rate_n_per_s", "wanted_n", "stands_m", "behind_rad", "apart_rad",
        )
    ]
    + [(name, np.int64) for name in ("repeats_at", "repeats", "looks", "held")]
)  # fmt: skip
"""State of the watchdogs: limits (a reading may repeat `repeats_at` times, 0 for any), what they
remember of earlier steps, and what they saw in the last one."""


@compiled
def usually_behind(force_limit_n: float) -> float:
    """Return the largest usual difference between a joint's command and its reading, rad."""
    return FOLLOWING_RAD + FOLLOWING_RAD_PER_N * force_limit_n


@part
def look(
    watch: np.ndarray,
    arm: ArmState,
    lever: np.ndarray,
    speed_limit: np.ndarray,
    room: np.ndarray,
    depth_m: float,
    speed_m_per_s: float,
    touched: bool,
    loaded: bool,
    wanted_n: float,
    encoders: bool,
) -> int:
    """Check one step; return what was found.

    Parameters
    ----------
    watch, lever, speed_limit, room : of `Watchdog`
    depth_m, speed_m_per_s : commanded
    touched : the tip is or was in contact
    loaded : the force is controlled
    wanted_n : force that is followed, where the body's stiffness is known by now; else NaN
    encoders : the joints have encoders of their own
    """
    w = watch[0]
    found = _look_at_force(watch, arm, speed_m_per_s, loaded, wanted_n)
    if found:
        return found
    # The table may lie at the limit: the tip has to stand before it
    speed = max(speed_m_per_s, 0.0)
    w.stands_m = depth_m + speed * arm.dt + speed * speed / (2 * BRAKING_M_PER_S2)
    if touched and w.stands_m > w.travel_limit_m:
        return TRAVEL
    if not touched and w.stands_m > w.seek_limit_m:
        return NO_TOUCH
    read = arm.sensor_n[2]
    w.repeats = w.repeats + 1 if read == w.last_n else 0
    w.last_n = read
    if 0 < w.repeats_at <= w.repeats:
        return REPEATED
    if encoders:
        for i in range(len(arm.q_read)):
            if not math.isfinite(arm.q_read[i]):
                return NO_ANGLE
        if w.apart_rad > APART_RAD:
            return APART
        if _is_behind(watch, arm):
            return BEHIND
    w.looks += 1
    if w.looks % EVERY == 0:
        return _look_slowly(watch, arm, lever, speed_limit, room)
    return FINE


@part
def _look_at_force(watch, arm, speed_m_per_s, loaded, wanted_n):
    """Check the force, its rate, and where it is held."""
    w = watch[0]
    force = arm.wrist_n[2]
    w.force_n, w.wanted_n = force, wanted_n
    if not abs(force) <= w.force_limit_n:
        return NO_NUMBER if force != force else FORCE
    w.rate_n_per_s = (force - w.before_that_n) / (2 * arm.dt)
    w.before_that_n, w.before_n = w.before_n, force
    ahead = AHEAD_OF_TOUCH_S
    if loaded:
        ahead = AHEAD_S + max(speed_m_per_s, 0.0) / BRAKING_M_PER_S2
    if force + ahead * w.rate_n_per_s > w.force_limit_n:
        return FORCE_RISES
    off = abs(force - wanted_n)  # NaN where no force is followed: then no comparison holds
    if off < w.disagreement_n / 2:
        w.held = 1
    if w.held and off > w.disagreement_n:
        return FORCE_LOST
    return FINE


@part
def _look_slowly(watch, arm, lever, speed_limit, room):
    w = watch[0]
    for i in range(len(arm.warnings)):
        if arm.warnings[i]:
            return UNSTABLE
    w.by_torque_n = force_by_torque(arm, lever, room) - w.rest_n
    if not abs(w.by_torque_n) <= w.force_limit_n:
        return TORQUES_FORCE
    w.apart_n += w.share * (w.force_n - w.by_torque_n - w.apart_n)
    if abs(w.apart_n) > w.disagreement_n:
        return DISAGREE
    if _is_behind(watch, arm):
        return BEHIND
    for i in range(len(lever)):
        if abs(arm.torque[i]) / arm.limit[i] > 1:
            return TORQUE
    for i in range(len(lever)):
        if abs(arm.v[i]) > speed_limit[i]:
            return SPEED
    return FINE


@part
def _is_behind(watch, arm):
    w = watch[0]
    w.behind_rad = 0.0
    for i in range(len(arm.behind)):
        w.behind_rad = max(w.behind_rad, abs(arm.behind[i]))
    return w.behind_rad > usually_behind(w.force_limit_n)
