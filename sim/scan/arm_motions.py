"""The arm's motions under its control loop: through joint poses, along a force, out of the body."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sim.motion.planned_motion import PlannedPress
from sim.motion.press_path import KNOTS
from sim.motion.settings import ScanSettings
from sim.robot.arm_steps import servo_step
from sim.robot.contact_coupling import MatchedContact, PressedBody
from sim.robot.force_control import FASTEST_M_PER_S, ForceControl
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.laboratory import Laboratory
from sim.robot.mechanism import Live, Mechanisms
from sim.robot.simulated_arm import SimulatedArm
from sim.scan import control_loop
from sim.scan.control_loop import (
    FAULT,
    FOLLOW,
    FRAME,
    GIVEN,
    NEAR_M,
    RETRACT,
    TASK,
    TOUCH,
    TRANSIT,
    UNLOAD,
    WAY,
    Loop,
)
from sim.scan.look import BRAKING_M_PER_S2
from sim.scan.press_log import PressRecorder
from sim.scan.result import PHASES, Frame
from sim.scan.watchdog import Watchdog

LONGEST_REST_S, AT_REST_RAD = 3.0, 1e-3
"""After a fault the arm stands until it is where it should be, to this in rad and rad/s."""


class ArmMotions:
    """State of the arm, of its control loop and of what is recorded of them.

    Parameters
    ----------
    laboratory : the scene
    body : what is pressed
    settings : of the scan
    on_frame : called with each frame to show, or None
    mechanisms : of the robot, beyond the ideal one
    """

    def __init__(
        self,
        laboratory: Laboratory,
        body: PressedBody,
        settings: ScanSettings,
        on_frame: Callable[[Frame], None] | None,
        mechanisms: Mechanisms,
    ) -> None:
        self.settings, self.on_frame = settings, on_frame
        self.kinematics = TipKinematics(laboratory.arm)
        self.mechanisms, self.body = mechanisms, mechanisms.pressed(body)
        self.body_pose, self.live = mechanisms.body_pose, Live()
        mechanisms.attach(self.live)
        self.speed_limit = laboratory.speed_limit
        wrist_rng = np.random.default_rng(settings.streams()[0])
        self.rig = SimulatedArm(laboratory, settings.force_noise_n, wrist_rng, mechanisms)
        self.rig.by_motors = mechanisms.servo_by_motors
        self.rig.live = self.live
        self.watchdog = Watchdog(self.rig, settings)
        self.contact = MatchedContact(laboratory, self.rig.data, self.body)
        self.control = ForceControl(self.rig.dt, settings.stiffness_n_per_m, settings.force_noise_n)
        self.links = [self.rig.model.body(name).id for name in laboratory.links]
        self.tip = self.rig.model.site("tcp").id
        self.dt = self.rig.dt
        self.posture = laboratory.home
        self.joints = len(laboratory.home)
        self.recorder = PressRecorder(self.joints)
        self.task = np.zeros(1, TASK)
        self._steps = self.task["steps"]  # views: looking a field up takes longer than reading it
        self._law_from_n, self._law_to_n = self.task["law_from_n"], self.task["law_to_n"]
        for name in ("lift_m", "slow_m", "approach_m_per_s", "touch_m_per_s", "touch_force_n"):
            self.task[name] = getattr(settings, name)
        every = max(1, round(1 / (settings.frames_per_s * self.dt)))
        self.task["frame_every"] = every if on_frame else 0
        self._path = np.zeros((KNOTS, 2 * self.joints))
        self._sideways, self._start, self._goal, self._slope = np.zeros((4, self.joints))

    @property
    def time_s(self) -> float:
        """Clock of the robot, s."""
        return self._steps[0] * self.dt

    @property
    def phase(self) -> int:
        """Number of the phase in `PHASES`."""
        return int(self.task["phase"][0])

    def _aim(self, number: int, planned: PlannedPress) -> None:
        self.number, self.planned, path = number, planned, planned.path
        self._path[:] = path.coefficients
        self.task["middle_m"], self.task["scale_per_m"] = path.middle_m, path.scale_per_m

    def _transit(self, waypoints: tuple[tuple[np.ndarray, float], ...]) -> None:
        """Quintic joint motion through the waypoints, standing still at each."""
        for goal, duration in waypoints:
            self._start[:], self._goal[:] = self.posture, goal
            self.task["duration_s"] = duration
            self._run(WAY, TRANSIT, max(1, round(duration / self.dt)))
            self.posture = goal

    def _retreat(self, planned: PlannedPress) -> None:
        """Take the tip out of the body after a fault, along its path, whatever the sensors say."""
        rig, control, settings = self.rig, self.control, self.settings
        rig.by_motors = True
        if rig.unstable or not np.isfinite(rig.q).all() or not np.isfinite(rig.v).all():
            rig.recover(planned.approach)  # the simulation is at fault, not the robot
            control.rest(-settings.lift_m)
        elif self.phase != TRANSIT:
            depth, speed = control.depth_m, control.speed_m_per_s
            while depth + settings.lift_m > NEAR_M or speed > 0:
                left = max(depth + settings.lift_m, 0.0)
                wanted = -min(FASTEST_M_PER_S, 0.9 * math.sqrt(left) + 1e-3)
                change = BRAKING_M_PER_S2 * self.dt
                before, speed = speed, max(speed - change, min(speed + change, wanted))
                depth += speed * self.dt
                q, slope = planned.path.at(depth)
                self._step(RETRACT, q, slope * speed, slope * (speed - before) / self.dt)
                self.posture = q
        self.contact.release()
        standing = np.zeros(self.joints)
        for _ in range(round(LONGEST_REST_S / self.dt)):
            self._step(RETRACT, planned.approach, standing)
            if rig.behind_rad < AT_REST_RAD and np.abs(rig.v).max() < AT_REST_RAD:
                break
        rig.by_motors = self.mechanisms.servo_by_motors
        self.task["phase"] = TRANSIT
        self.posture = planned.approach

    def _ramp(self, phase: int, start_n: float, end_n: float, duration: float) -> None:
        """Follow a straight line of force over time, its ends rounded."""
        line, task = self.control.line(end_n - start_n, duration), self.task
        task["start_n"], task["end_n"] = start_n, end_n
        task["duration_s"], task["blend_s"] = line.duration_s, line.blend_s
        self._run(FOLLOW, phase, max(1, round(line.duration_s / self.dt)))

    def _step(self, phase: int, q: np.ndarray, v: np.ndarray, a: np.ndarray | float = 0.0) -> None:
        """Make one step towards a configuration, its rate and acceleration."""
        arm = self.rig.state
        arm.goal_q[:], arm.goal_v[:], arm.goal_a[:] = q, v, a
        self._run(GIVEN, phase, 1)

    def _run(self, motion: int, phase: int, count: int = 0) -> None:
        """Make the steps of one motion; those that touch follow the body's law and are watched."""
        task, rig, contact = self.task, self.rig, self.contact
        task["motion"], task["phase"], task["step"], task["count"] = motion, phase, 0, count
        touching = motion > WAY
        by_hand = rig.hooked or (touching and (contact.in_time or self.body_pose))
        self.live.touched = TOUCH <= phase <= UNLOAD
        loop = self._loop()
        why = 0 if control_loop.begin_step(loop) else control_loop.DONE
        while not why & control_loop.DONE:
            rig.renew_noise()
            if self.recorder.make_room():
                loop = loop._replace(rows=self.recorder.rows)
            self._law_from_n[0], self._law_to_n[0] = contact.band_n
            why = self._step_by_hand(loop, touching) if by_hand else control_loop.run(loop, False)
            if why & FRAME and self.on_frame:
                self.on_frame(self._frame(PHASES[phase]))
            if not touching:
                continue
            self.posture = rig.state.goal_q.copy()
            if why >= FAULT:
                raise self.watchdog.fault(why // FAULT)
            contact.follow(rig.contact_n, self.time_s)

    def _step_by_hand(self, loop: Loop, touching: bool) -> int:
        """Make a step between whose parts mechanisms act; see `control_loop.run`."""
        rig = self.rig
        if touching and self.body_pose:
            self.contact.shift(self.body_pose(self.time_s, self.number))
        rig.look_at_joints()
        servo_step(rig.state, rig.has_encoders)
        rig.look_at_sensor()
        if rig.has_encoders:
            self.watchdog.state["apart_rad"] = rig.apart_rad
        return control_loop.finish_step(loop, rig.has_encoders)

    def _loop(self) -> Loop:
        watchdog = self.watchdog
        return Loop(
            self.task,
            self.rig.state,
            self.control.state,
            watchdog.state,
            self.recorder.rows,
            watchdog.lever,
            watchdog.speed_limit,
            watchdog.room,
            self._path,
            self._sideways,
            self._start,
            self._goal,
            self._slope,
        )

    def _frame(self, phase: str) -> Frame:
        data, planned, tip = self.rig.data, self.planned, self.rig.tip_m.copy()
        force = np.where(np.isfinite(self.rig.wrist_n), self.rig.wrist_n, 0.0)
        return Frame(
            time_s=self.time_s - self.dt,
            press=self.number,
            phase=phase,
            positions_m=data.xpos[self.links],
            quaternions=data.xquat[self.links],
            tip_m=tip,
            force_vector_n=data.site_xmat[self.tip].reshape(3, 3) @ force,
            force_n=float(force[2]),
            wanted_n=float(self.recorder["wanted_n"][-1]),
            displacement_m=float((tip - planned.point_m) @ planned.direction),
        )
