"""The compiled parts of one step of the arm: servo and MuJoCo step, wrist force, joints' force."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from sim.robot.compiled import compiled
from sim.robot.mujoco_library import mj_step
from sim.robot.rigid_chain import Chain, inverse_dynamics, tool_force

SERVO_RAD_PER_S = 60.0
"""Both poles of the joint servo."""

BLOCK = 4096

NOW = np.dtype([("time_s", float), ("contact_n", float), ("drawn", np.int64)])
"""Time since the simulation began, true contact force of the last step, used rows of noise."""

OF_JOINTS = (
    "goal_q", "goal_v", "goal_a", "q", "v", "q_seen", "v_seen", "q_read", "read", "a", "torque",
    "behind", "peak",
)  # fmt: skip


class ArmState(NamedTuple):
    """The arm in motion, as the compiled steps see it; arrays are (n,) if nothing is said.

    Attributes
    ----------
    model, data : addresses of MuJoCo's model and data
    chain, damping : of the robot's own model
    dt : s
    qpos, qvel, ctrl, tip_m, raw_n, touch_n, warnings : MuJoCo's own memory
    to_probe : (3, 3), from the last joint's frame to the probe's axes
    limit, hardest : of torque, and of acceleration where encoders may jump
    goal_q, goal_v, goal_a : what the servo goes to
    q, v : the state now
    q_seen, v_seen, q_read, read, a, torque, behind : of the last step, see `SimulatedArm`; by
        `read` the servo went
    peak : largest torques so far
    raw_noise_n : (BLOCK, 3)
    sensor_n, wrist_n, tare_n : (3,)
    now : (1,) of `NOW`
    """

    model: int
    data: int
    chain: Chain
    dt: float
    damping: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    ctrl: np.ndarray
    tip_m: np.ndarray
    raw_n: np.ndarray
    touch_n: np.ndarray
    warnings: np.ndarray
    to_probe: np.ndarray
    limit: np.ndarray
    hardest: np.ndarray
    goal_q: np.ndarray
    goal_v: np.ndarray
    goal_a: np.ndarray
    q: np.ndarray
    v: np.ndarray
    q_seen: np.ndarray
    v_seen: np.ndarray
    q_read: np.ndarray
    read: np.ndarray
    a: np.ndarray
    torque: np.ndarray
    behind: np.ndarray
    peak: np.ndarray
    raw_noise_n: np.ndarray
    sensor_n: np.ndarray
    wrist_n: np.ndarray
    tare_n: np.ndarray
    now: np.ndarray


@compiled
def servo_step(arm: ArmState, clipped: bool) -> None:
    """Servo by `read` towards the goal and advance MuJoCo by a step; `sensor_n` is the new reading.

    `clipped` : the acceleration is bounded. A plan stays below; a reading that jumps would not.
    """
    gain = SERVO_RAD_PER_S
    for i in range(len(arm.q)):
        arm.behind[i] = arm.goal_q[i] - arm.read[i]
        wanted = arm.goal_a[i] + (gain * gain) * arm.behind[i]
        wanted += (2 * gain) * (arm.goal_v[i] - arm.v[i])
        if clipped and not abs(wanted) <= arm.hardest[i] and wanted == wanted:
            wanted = arm.hardest[i] if wanted > 0 else -arm.hardest[i]
        arm.a[i] = wanted
    inverse_dynamics(arm.chain, arm.read, arm.v, arm.a, arm.torque)
    for i in range(len(arm.q)):
        arm.torque[i] += arm.damping[i] * arm.v[i]
        arm.ctrl[i] = arm.torque[i]
        arm.q_seen[i], arm.v_seen[i] = arm.q[i], arm.v[i]
        size = abs(arm.torque[i])
        if size > arm.peak[i]:
            arm.peak[i] = size
    mj_step(arm.model, arm.data)
    for i in range(len(arm.q)):
        arm.q[i], arm.v[i] = arm.qpos[i], arm.qvel[i]
        arm.a[i] = (arm.v[i] - arm.v_seen[i]) / arm.dt
    now = arm.now[0]
    now.contact_n = arm.touch_n[0]
    for k in range(3):
        arm.sensor_n[k] = arm.raw_n[k] + arm.raw_noise_n[now.drawn, k]
    now.drawn += 1


@compiled
def read_wrist(arm: ArmState) -> None:
    """End the step: the tip's force is the sensor's less the probe's weight and inertia."""
    own = tool_force(arm.chain, arm.v_seen, arm.a)
    for k in range(3):
        part = arm.to_probe[k, 0] * own[0] + arm.to_probe[k, 1] * own[1]
        part += arm.to_probe[k, 2] * own[2]
        arm.wrist_n[k] = arm.sensor_n[k] - part - arm.tare_n[k]
    arm.now[0].time_s += arm.dt


@compiled
def force_by_torque(arm: ArmState, lever: np.ndarray, free: np.ndarray) -> float:
    """See `SimulatedArm.force_by_torque`; `free` is room for (n,) torques."""
    inverse_dynamics(arm.chain, arm.q_seen, arm.v_seen, arm.a, free)
    force = length = 0.0
    for i in range(len(lever)):
        force += lever[i] * (arm.torque[i] - free[i] - arm.damping[i] * arm.v_seen[i])
        length += lever[i] * lever[i]
    return force / length
