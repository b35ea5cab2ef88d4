"""A scripted motion of the tip through free space, and how well the arm follows it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from models.errors import InputError
from sim.motion.planner import transit_duration
from sim.motion.quintic import blend
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.laboratory import Laboratory
from sim.robot.simulated_arm import SimulatedArm


@dataclass(frozen=True)
class TipPose:
    """A pose to be reached at the end of a duration.

    Attributes
    ----------
    point_m : (3,) m, centre of the tip, world frame
    axis : (3,) unit, direction in which the probe points
    duration_s : of the motion there from the pose before
    """

    point_m: tuple[float, float, float]
    axis: tuple[float, float, float] = (0.0, 0.0, -1.0)
    duration_s: float = 1.0


@dataclass(frozen=True)
class Tracking:
    """What the arm did.

    Attributes
    ----------
    time_s : (t,)
    wanted_m, tip_m : (t, 3) m, wanted and true centre of the tip
    largest_error_m : of their distance
    largest_force_n : largest contact force that the wrist sensor reports, nothing being touched
    """

    time_s: np.ndarray
    wanted_m: np.ndarray
    tip_m: np.ndarray
    largest_error_m: float
    largest_force_n: float


def run_script(script: Sequence[TipPose], laboratory: Laboratory) -> Tracking:
    """Move the arm from its home configuration through scripted poses; no body is there.

    Raises
    ------
    InputError
        A pose that the arm cannot reach, or not within its duration.
    """
    kinematics = TipKinematics(laboratory.arm)
    rig = SimulatedArm(laboratory, 0.0, np.random.default_rng(0))
    rig.data.mocap_pos[0] = (0.0, 0.0, -1.0)
    start = laboratory.home
    wanted, tips, force = [], [], 0.0
    for i, pose in enumerate(script):
        point, axis = np.asarray(pose.point_m), np.asarray(pose.axis)
        reached = kinematics.reach(point, axis, start, posture=laboratory.home)
        needed = transit_duration(laboratory, start, reached.q)
        if not reached.converged or needed > pose.duration_s:
            why = f"needs {needed:.2f} s" if reached.converged else "is out of reach"
            raise InputError(
                f"Pose {i} of the script at {pose.point_m} m {why}; its duration is "
                f"{pose.duration_s:g} s. Move the pose nearer or give it more time."
            )
        count = round(pose.duration_s / rig.dt)
        for k in range(1, count + 1):
            q, v, a = quintic(start, reached.q, k / count, pose.duration_s)
            rig.step(q, v, a)
            tips.append(rig.tip_m.copy())
            wanted.append(kinematics.pose(q)[0])
            force = max(force, float(np.abs(rig.wrist_n).max()))
        start = reached.q
    error = np.linalg.norm(np.array(wanted) - np.array(tips), axis=1)
    time_s = np.arange(1, len(tips) + 1) * rig.dt
    return Tracking(time_s, np.array(wanted), np.array(tips), float(error.max()), force)


def quintic(
    start: np.ndarray, end: np.ndarray, s: float, duration_s: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Position (n,), velocity and acceleration at the part s, 0 to 1, of a motion."""
    change = end - start
    position, velocity, acceleration = blend(s, duration_s)
    return start + position * change, velocity * change, acceleration * change
