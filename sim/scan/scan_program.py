"""The scan program: approach, touch, ramp to the set force, hold, unload, retract, next."""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from sim.motion.planned_motion import Motion, PlannedPress
from sim.motion.planner import plan_motion
from sim.motion.press_path import KNOTS, sideways_yield
from sim.motion.scan_plan import ScanPlan
from sim.motion.scene import plan_scene
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import BodyLawError, MatchedContact, PressedBody
from sim.robot.force_control import FASTEST_M_PER_S, ForceControl
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.mechanism import Live, Mechanisms
from sim.robot.simulated_arm import SimulatedArm, servo_step
from sim.scan import control_loop
from sim.scan.control_loop import (
    APPROACH,
    DWELL,
    DWELL_S,
    FAULT,
    FOLLOW,
    FRAME,
    GIVEN,
    HOLD,
    LEAVE,
    LOAD,
    NEAR_M,
    RETRACT,
    SEEK,
    TASK,
    TOUCH,
    TRANSIT,
    UNLOAD,
    WAY,
    Loop,
)
from sim.scan.look import BRAKING_M_PER_S2
from sim.scan.outcome import ATTEMPTS, Fault, PressFault, PressOutcome
from sim.scan.press_log import PressLog, PressRecorder
from sim.scan.press_result import press_result
from sim.scan.result import PHASES, Frame, PressResult
from sim.scan.watchdog import Watchdog, limits_of

FALSE_TOUCHES = 3

TARE_S = 0.1
"""The arm rests at least so long before an approach; the sensor is tared meanwhile."""

FREE_S = 0.1
"""At the end of a press the tip is free for so long at least."""

LONGEST_REST_S, AT_REST_RAD = 3.0, 1e-3
"""After a fault the arm stands until it is where it should be, to this in rad and rad/s."""


class Program:
    """State of a running scan."""

    def __init__(
        self,
        plan: ScanPlan,
        body: PressedBody,
        settings: ScanSettings,
        on_frame: Callable[[Frame], None] | None,
        mechanisms: Mechanisms,
        motion: Motion | None = None,
    ) -> None:
        self.plan, self.settings, self.on_frame = plan, settings, on_frame
        laboratory = plan_scene(plan, settings)
        planned = motion or plan_motion(plan, laboratory, settings)
        self.presses = planned.presses if motion else planned.require_all()
        wrist_seed, encoder_seed, _ = settings.streams()
        self.encoder_rng = np.random.default_rng(encoder_seed)
        self.pauses_s = settings.pauses(len(plan))
        self.kinematics = TipKinematics(laboratory.arm)
        self.mechanisms, self.body = mechanisms, mechanisms.pressed(body)
        self.body_pose, self.live = mechanisms.body_pose, Live()
        mechanisms.attach(self.live)
        self.speed_limit = laboratory.speed_limit
        self.rig = SimulatedArm(
            laboratory, settings.force_noise_n, np.random.default_rng(wrist_seed), mechanisms
        )
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
        for name in ("lift_m", "slow_m", "approach_m_per_s", "touch_m_per_s", "touch_force_n"):
            self.task[name] = getattr(settings, name)
        every = max(1, round(1 / (settings.frames_per_s * self.dt)))
        self.task["frame_every"] = every if on_frame else 0
        self._path = np.zeros((KNOTS, 2 * self.joints))
        self._sideways, self._start, self._goal, self._slope = np.zeros((4, self.joints))

    @property
    def time_s(self) -> float:
        """Clock of the robot, s."""
        return self.task["steps"][0] * self.dt

    @property
    def phase(self) -> int:
        """Number of the phase in `PHASES`."""
        return int(self.task["phase"][0])

    def pass_by(self, number: int, planned: PlannedPress) -> None:
        """Go to the approach pose of a press that is not made: the way to the next begins there."""
        self._aim(number, planned)
        self.recorder.begin()
        self._transit(planned.waypoints)

    def press(self, number: int, planned: PlannedPress) -> tuple[PressOutcome, PressResult | None]:
        """Make one press, from the approach pose of the one before, again if that is asked for."""
        force, faults, peak = self.plan.force_of(number), [], 0.0
        name = int(self.plan.ids[number])
        stiffness = self.control.stiffness
        for attempt in range(ATTEMPTS if self.settings.on_fault == "retry" else 1):
            try:
                self._attempt(number, planned, again=attempt > 0)
                result = self._reduced(number, planned, again=attempt > 0)
            except (PressFault, BodyLawError) as fault:
                kind = fault.kind if isinstance(fault, PressFault) else "body"
                phase, when = PHASES[self.phase], self.time_s
                faults.append(Fault(kind, str(fault), phase, when))
                self._retreat(planned)
                self.control.stiffness = stiffness  # what a fault has taught is wrong
                peak = max(peak, self._peak_n)
                continue
            lowered = self.plan.lowered[number] if self.plan.lowered else ""
            if not result.judged.kept:
                self.control.stiffness = stiffness
            told = [*result.judged.shortfalls(), *([lowered] if lowered else [])]
            outcome = PressOutcome(
                name,
                "retried" if faults else "made",
                force,
                tuple(faults),
                result.judged,
                "; ".join(told) or (faults[-1].reason if faults else ""),
                max(peak, self._peak_n),
                bool(lowered),
            )
            return outcome, result
        begun = faults[-1].phase != PHASES[TRANSIT]
        return (
            PressOutcome(
                name,
                "aborted" if begun else "skipped",
                force,
                tuple(faults),
                reason=f"{faults[-1].kind} ({faults[-1].phase}): {faults[-1].reason}",
                peak_force_n=peak,
            ),
            None,
        )

    @property
    def _peak_n(self) -> float:
        """Largest true force of the last attempt."""
        return float(np.nanmax(self.recorder["true_force_n"], initial=0.0))

    def _attempt(self, number: int, planned: PlannedPress, again: bool) -> None:
        self._aim(number, planned)
        settings, control, force = self.settings, self.control, self.plan.force_of(number)
        ramp_s, hold_s, unload_s, pause_s = self._times(number)
        self.task["wanted_n"] = 0.0
        self.recorder.begin()
        self._renew_live(number, planned)
        self.mechanisms.begin(number, self.time_s)
        if self.rig.unstable:
            self.rig.recover(self.posture)
        if not again:
            self._transit(planned.waypoints)
        self._tare(max(pause_s, TARE_S))
        self._sideways[:] = sideways_yield(self.kinematics, planned.path, planned.direction)
        self.contact.start(number, planned.point_m, planned.direction, force)
        control.rest(-settings.lift_m)
        self._touch()
        self._ramp(LOAD, control.force_n, force, ramp_s)
        self._ramp(HOLD, force, force, hold_s)
        self._ramp(UNLOAD, force, settings.residual * force, unload_s)
        self.task["wanted_n"] = 0.0
        self._run(LEAVE, RETRACT)
        self.contact.release()
        by_torque = self.recorder["by_torque_n"]
        looked = np.isfinite(by_torque)
        self.watchdog.check_forces(self.recorder["wrist_n"][looked, 2], by_torque[looked])
        free = self.recorder["wrist_n"][-round(FREE_S / self.dt) :, 2]
        self.zero_after_n = self.watchdog.zero_moved(free - self.zero_n, force)

    def _aim(self, number: int, planned: PlannedPress) -> None:
        self.number, self.planned, path = number, planned, planned.path
        self._path[:] = path.coefficients
        self.task["middle_m"], self.task["scale_per_m"] = path.middle_m, path.scale_per_m

    def _renew_live(self, number: int, planned: PlannedPress) -> None:
        live, pose = self.live, self.kinematics.pose
        live.press, live.touched = number, False
        live.depth_of = lambda q: float((pose(q)[0] - planned.point_m) @ planned.direction)
        live.slope_of = lambda depth: planned.path.at(depth)[1]

    def _times(self, number: int) -> tuple[float, float, float, float]:
        """Durations of ramp, hold, unloading and the rest before, s."""
        program, settings = self.plan.program, self.settings
        if program is None:
            pause = self.pauses_s[number]
            return settings.ramp_s, settings.hold_s, settings.unload_s, float(pause)
        columns = (program.ramp_s, program.hold_s, program.unload_s, program.pause_s)
        ramp, hold, unload, pause = (float(column[number]) for column in columns)
        return ramp, hold, unload, pause

    def _reduced(self, number: int, planned: PlannedPress, again: bool) -> PressResult:
        """Return the result of the press just made."""
        columns = self.recorder.columns()
        true_s, clock = columns["time_s"], self.mechanisms.clock
        log = PressLog(
            press=number,
            fem_calls=self.contact.calls,
            clock_s=np.array([clock(t) for t in true_s]) if self.mechanisms.has_clock else true_s,
            touch_depth_m=self.touch_depth_m,
            tare_n=float(self.rig.tare_n[2]),
            zero_after_n=self.zero_after_n,
            outcome="retried" if again else "made",
            **columns,
        )
        return press_result(
            log,
            self.plan,
            planned,
            self.settings,
            self.kinematics,
            self.body,
            self.encoder_rng,
            self.mechanisms,
        )

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

    def _transit(self, waypoints: tuple[tuple[np.ndarray, float], ...]) -> None:
        """Quintic joint motion through the waypoints, standing still at each."""
        for goal, duration in waypoints:
            self._start[:], self._goal[:] = self.posture, goal
            self.task["duration_s"] = duration
            self._run(WAY, TRANSIT, max(1, round(duration / self.dt)))
            self.posture = goal

    def _tare(self, duration: float) -> None:
        """Stand still; take the force that is read meanwhile off the later readings."""
        self._transit(((self.posture, duration),))
        last = self.recorder["wrist_n"][-round(TARE_S / self.dt) :]
        planned = self.planned
        lever = planned.direction @ self.kinematics.jacobian(planned.touch)
        self.watchdog.begin(
            limits_of(self.settings, self.plan.force_of(self.number), self.planned.path.end_m,
                      self.speed_limit),
            lever,
        )  # fmt: skip
        mean = self.watchdog.refuse_tare(last)
        tared = self.mechanisms.tare == "press" or (
            self.mechanisms.tare == "scan" and self.number == 0
        )
        if tared:
            self.rig.tare(mean)
            self.recorder["wrist_n"][:] -= mean  # first touch is found from these readings too
        # A sensor that is not tared here still has its zero, to find touch by
        self.zero_n = 0.0 if tared else float(mean[2])
        self.task["zero_n"] = self.zero_n
        self.live.first_approach_s = min(self.live.first_approach_s, self.time_s)

    def _touch(self) -> None:
        """Go down until the measured force says touch, and stand; go on if that was none."""
        for _ in range(FALSE_TOUCHES):
            self.task["above"] = self.task["steady"] = 0
            self._run(SEEK, APPROACH)
            self.touch_depth_m = self.control.depth_m
            self.control.touch()
            self._run(DWELL, TOUCH, round(DWELL_S / self.dt))
            left = self.control.force_n - self.zero_n
            if left >= 0.3 * self.settings.touch_force_n:
                return
        raise PressFault(
            "touch",
            f"{FALSE_TOUCHES} times the force fell after first touch, now to {left:.3g} N at "
            f"{1e3 * self.touch_depth_m:.3g} mm from the planned surface: nothing was touched",
        )

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
            task["law_from_n"], task["law_to_n"] = contact.band_n
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
        turns = data.xquat[self.links]
        force = np.where(np.isfinite(self.rig.wrist_n), self.rig.wrist_n, 0.0)
        return Frame(
            time_s=self.time_s - self.dt,
            press=self.number,
            phase=phase,
            positions_m=data.xpos[self.links],
            quaternions=turns,
            tip_m=tip,
            tip_quaternion=turns[-1],
            force_vector_n=data.site_xmat[self.tip].reshape(3, 3) @ force,
            force_n=float(force[2]),
            wanted_n=float(self.recorder["wanted_n"][-1]),
            displacement_m=float((tip - planned.point_m) @ planned.direction),
        )
