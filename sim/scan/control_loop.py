"""The control loop as compiled functions: command, servo, physics, watchdogs, record.

`run` makes steps until something needs Python: a frame is due, the body's law has to be asked
again, a watchdog has found a fault, the motion is done. Where mechanisms or a body in time act
between the parts of a step, Python makes `servo_step` and `finish_step` itself.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from sim.motion.press_path import path_at
from sim.motion.quintic import blend
from sim.robot.arm_steps import BLOCK, ArmState, read_wrist, servo_step
from sim.robot.compiled import compiled, part
from sim.robot.force_control import (
    ACCELERATION_M_PER_S2,
    feel,
    line_at,
    move,
    press,
    stop,
)
from sim.scan.look import EVERY, look
from sim.scan.press_log import Rows, add_row
from sim.scan.result import PHASES

TRANSIT, APPROACH, TOUCH, LOAD, HOLD, UNLOAD, RETRACT = range(len(PHASES))

GIVEN, WAY, SEEK, DWELL, FOLLOW, LEAVE = range(6)
"""Motions: to a configuration that is given; from one to another along a quintic; down until the
force says touch; standing there; following a line of force; out of the body."""

DWELL_S = 0.06
"""Stand still after touching, longer than the lag of servo and filter."""

TOUCH_SAMPLES = 2
"""Samples in a row above the touch force: one alone may be noise."""

UNSTEADY = 4.0
"""Times the touch force that say touch while the tip gathers or loses speed."""

NEAR_M = 1e-5

DONE, FRAME, RENEW, FAULT = 1, 2, 4, 8
"""Why the loop has stopped, bits; a fault is the number of `watchdog.look` times the last one."""

TASK = np.dtype(
    [
        (name, np.int64)
        for name in ("steps", "frame_every", "motion", "phase", "step", "count", "above", "steady")
    ]
    + [
        (name, float)
        for name in (
            "wanted_n", "start_n", "end_n", "duration_s", "blend_s",
            "middle_m", "scale_per_m", "lift_m", "slow_m", "approach_m_per_s", "touch_m_per_s",
            "touch_force_n", "zero_n", "law_from_n", "law_to_n",
        )
    ]
)  # fmt: skip
"""What the loop does: steps since the scan began and between two frames (0 none); motion, phase,
steps of it made and planned; samples above the touch force, steps at one speed; force that is
wanted now, its line; range of the path; settings; zero of the sensor; forces between which the
body's law need not be asked."""


class Loop(NamedTuple):
    """All that the loop works on.

    Attributes
    ----------
    task : (1,) of `TASK`
    arm, control, watch, rows : state of arm, force control and watchdogs; the record
    lever, speed_limit, room : of `Watchdog`
    path : of the press, see `PressPath`
    sideways : (n,) rad/N, lead of the command
    start, goal : (n,) rad, of a way
    slope : (n,) room for dq/dh
    """

    task: np.ndarray
    arm: ArmState
    control: np.ndarray
    watch: np.ndarray
    rows: Rows
    lever: np.ndarray
    speed_limit: np.ndarray
    room: np.ndarray
    path: np.ndarray
    sideways: np.ndarray
    start: np.ndarray
    goal: np.ndarray
    slope: np.ndarray


@compiled
def begin_step(loop: Loop) -> bool:
    """Set the servo's goal of the next step; false if the motion is done."""
    t, c, arm = loop.task[0], loop.control[0], loop.arm
    if t.motion == SEEK:
        if t.above >= TOUCH_SAMPLES:
            return False
        braking = t.approach_m_per_s * t.approach_m_per_s / (2 * ACCELERATION_M_PER_S2)
        fast, before = c.depth_m < -t.slow_m - braking, c.speed_m_per_s
        move(loop.control, t.approach_m_per_s if fast else t.touch_m_per_s)
        t.steady = t.steady + 1 if c.speed_m_per_s == before else 0
    elif t.motion == LEAVE:
        left = c.depth_m + t.lift_m
        if left <= NEAR_M:
            return False
        speed = max(0.9 * math.sqrt(2 * ACCELERATION_M_PER_S2 * left), t.touch_m_per_s)
        move(loop.control, -min(t.approach_m_per_s, speed))
    else:
        if t.step == t.count:
            return False
        t.step += 1
        if t.motion == WAY:
            way, rate, gain = blend(t.step / t.count, t.duration_s)
            for i in range(len(loop.goal)):
                change = loop.goal[i] - loop.start[i]
                arm.goal_q[i] = loop.start[i] + way * change
                arm.goal_v[i], arm.goal_a[i] = rate * change, gain * change
            return True
        if t.motion == GIVEN:
            return True
        if t.motion == DWELL:
            stop(loop.control)
        else:
            share, rate = line_at(t.duration_s, t.blend_s, t.duration_s * t.step / t.count)
            t.wanted_n = t.start_n + (t.end_n - t.start_n) * share
            press(loop.control, t.wanted_n, (t.end_n - t.start_n) * rate, t.phase == LOAD)
    path_at(loop.path, (c.depth_m - t.middle_m) * t.scale_per_m, arm.goal_q, loop.slope)
    for i in range(len(loop.slope)):
        arm.goal_q[i] -= c.force_n * loop.sideways[i]
        arm.goal_v[i], arm.goal_a[i] = loop.slope[i] * c.speed_m_per_s, 0.0
    return True


@part
def end_step(loop: Loop, encoders: bool) -> int:
    """Record the step that the arm has made, and look at it; return why to stop, or 0."""
    t, c, w, arm = loop.task[0], loop.control[0], loop.watch[0], loop.arm
    add_row(loop.rows, t.steps * arm.dt, t.phase, t.wanted_n, arm)
    why = FRAME if t.frame_every and t.steps % t.frame_every == 0 else 0
    t.steps += 1
    if t.motion <= WAY:
        return why
    loaded = LOAD <= t.phase <= UNLOAD
    held = t.wanted_n if HOLD <= t.phase <= UNLOAD else np.nan
    found = look(
        loop.watch, arm, loop.lever, loop.speed_limit, loop.room, c.depth_m, c.speed_m_per_s,
        t.phase >= LOAD, loaded, held, encoders,
    )  # fmt: skip
    if found:
        return why | FAULT * found
    if w.looks % EVERY == 0:
        loop.rows.by_torque_n[loop.rows.used[0] - 1] = w.by_torque_n
    feel(loop.control, arm.wrist_n[2])
    if not t.law_from_n <= arm.now[0].contact_n <= t.law_to_n:
        why |= RENEW
    if t.motion == SEEK:
        # An unknown mass on the sensor shows as a force while the arm gathers or loses speed
        enough = 1.0 if t.steady * arm.dt > DWELL_S else UNSTEADY
        touching = arm.wrist_n[2] - t.zero_n >= enough * t.touch_force_n
        t.above = t.above + 1 if touching else 0
    return why


@compiled
def finish_step(loop: Loop, encoders: bool) -> int:
    """End a step after the sensor was read, and begin the next; return why to stop, or 0."""
    read_wrist(loop.arm)
    why = end_step(loop, encoders)
    if why < FAULT and not begin_step(loop):
        why |= DONE
    return why


@compiled
def run(loop: Loop, encoders: bool) -> int:
    """Make steps, the first of them begun, until there is a reason to stop.

    It is 0 where noise or room for rows is used up. `encoders` is false: what mechanisms read is
    nothing that is made here. (A constant would have the parts compiled a second time for it.)
    """
    arm = loop.arm
    while arm.now[0].drawn < BLOCK and loop.rows.used[0] < len(loop.rows.time_s):
        for i in range(len(arm.q)):
            arm.q_read[i] = arm.read[i] = arm.q[i]
        servo_step(arm, encoders)
        why = finish_step(loop, encoders)
        if why:
            return why
    return 0
