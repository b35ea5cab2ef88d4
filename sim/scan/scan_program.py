"""The scan program: approach, touch, ramp to the set force, hold, unload, retract, next."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import numpy as np

from models import LINKS, InputError
from sim.motion.planner import PlannedPress, plan_motion, refuse_too_deep
from sim.motion.press_path import sideways_yield
from sim.motion.quintic import quintic
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import MatchedContact, PressedBody
from sim.robot.force_control import ACCELERATION_M_PER_S2, FASTEST_M_PER_S, ForceControl
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.laboratory import build_laboratory
from sim.robot.simulated_arm import SimulatedArm
from sim.scan.press_log import PressLog, press_result
from sim.scan.result import PHASES, Frame, PressResult, ScanRun

TRANSIT, APPROACH, TOUCH, LOAD, HOLD, UNLOAD, RETRACT = range(len(PHASES))
DWELL_S = 0.06
"""Stand still after touching, longer than the lag of servo and filter."""

TOUCH_SAMPLES = 2
"""Samples in a row above the touch force: one alone may be noise."""

NEAR_M = 1e-5
COLUMNS = 17


def run_scan(
    plan: ScanPlan,
    soft_body: PressedBody,
    settings: ScanSettings | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    on_press: Callable[[PressResult], None] | None = None,
) -> ScanRun:
    """Plan and make all presses of a scan.

    Parameters
    ----------
    plan : where, in which direction and how hard to press
    soft_body : answers the contact forces; its press j is the plan's press j
    settings : times, speeds, noise, sampling
    on_frame : called at `settings.frames_per_s` of simulated time
    on_press : called after each press with its result. A scan that is broken off (also by
        KeyboardInterrupt, which is passed on) has delivered all presses finished so far.

    Raises
    ------
    InputError
        Before the arm moves: a press that cannot be made, or would go too deep (see
        `sim.motion.planner`). During the scan: a body so far away, or so much softer than it said,
        that the planned depth does not do.
    """
    settings = settings or ScanSettings()
    started = time.perf_counter()
    program = _Program(plan, soft_body, settings, on_frame)
    results = []
    for number, planned in enumerate(program.presses):
        program.press(number, planned)
        result = press_result(
            program.log(number),
            plan,
            planned,
            settings,
            program.kinematics,
            soft_body,
            program.encoder_rng,
        )
        results.append(result)
        if on_press:
            on_press(result)
    return ScanRun(
        tuple(results), program.time_s, time.perf_counter() - started, program.rig.peak_torque
    )


class _Program:
    """State of the running scan."""

    def __init__(
        self,
        plan: ScanPlan,
        body: PressedBody,
        settings: ScanSettings,
        on_frame: Callable[[Frame], None] | None,
    ) -> None:
        self.plan, self.settings, self.on_frame = plan, settings, on_frame
        weakest = min(plan.force_of(press) for press in range(len(plan)))
        if settings.touch_force_n > 0.5 * weakest:
            raise InputError(
                f"The touch force of {settings.touch_force_n:g} N is more than half of the set "
                f"force of {weakest:g} N; press harder or lower touch_force_n."
            )
        refuse_too_deep(plan, body, settings)
        laboratory = build_laboratory(
            plan.tip_radius_m, plan.body_size_m, plan.body_in_world, settings.timestep_s
        )
        # Never through the body, whatever the controller does
        thickest = max(plan.thickness_m(press) for press in range(len(plan)))
        self.depth_limit = min(settings.largest_depth(plan.force_n), thickest)
        self.presses = plan_motion(
            plan,
            laboratory,
            settings.lift_m,
            self.depth_limit,
            FASTEST_M_PER_S,
            ACCELERATION_M_PER_S2,
        )
        wrist_seed, encoder_seed, _ = settings.streams()
        self.encoder_rng = np.random.default_rng(encoder_seed)
        self.pauses_s = settings.pauses(len(plan))
        self.kinematics = TipKinematics(laboratory.arm)
        self.rig = SimulatedArm(
            laboratory, settings.force_noise_n, np.random.default_rng(wrist_seed)
        )
        self.contact = MatchedContact(self.rig.model, self.rig.data, body)
        self.control = ForceControl(self.rig.dt, settings.stiffness_n_per_m, settings.force_noise_n)
        self.links = [self.rig.model.body(name).id for name in LINKS]
        self.dt = self.rig.dt
        self.steps, self.every = 0, max(1, round(1 / (settings.frames_per_s * self.dt)))
        self.posture = laboratory.home
        self.wanted = 0.0
        self._rows, self._used = np.empty((8192, COLUMNS)), 0

    @property
    def time_s(self) -> float:
        return self.steps * self.dt

    def press(self, number: int, planned: PlannedPress) -> None:
        """Make one press, from the approach pose of the one before."""
        self.number, self.planned = number, planned
        settings, control, force = self.settings, self.control, self.plan.force_of(number)
        ramp_s, hold_s, unload_s, pause_s = self._times(number)
        self._used, self.wanted = 0, 0.0
        self._transit(planned.waypoints)
        self._pause(pause_s)
        self.sideways = sideways_yield(self.kinematics, planned.path, planned.direction)
        self.contact.start(number, planned.point_m, planned.direction, force)
        control.rest(-settings.lift_m)
        self._approach()
        for _ in range(round(DWELL_S / self.dt)):
            control.stop()
            self._tick(TOUCH)
        self._ramp(LOAD, control.force_n, force, ramp_s)
        self._ramp(HOLD, force, force, hold_s)
        self._ramp(UNLOAD, force, settings.residual * force, unload_s)
        self.wanted = 0.0
        while (left := control.depth_m + settings.lift_m) > NEAR_M:
            speed = max(0.9 * math.sqrt(2 * ACCELERATION_M_PER_S2 * left), settings.touch_m_per_s)
            control.move(-min(settings.approach_m_per_s, speed))
            self._tick(RETRACT)
        self.contact.release()

    def _times(self, number: int) -> tuple[float, float, float, float]:
        """Durations of ramp, hold, unloading and the rest before, s."""
        program, settings = self.plan.program, self.settings
        if program is None:
            pause = self.pauses_s[number]
            return settings.ramp_s, settings.hold_s, settings.unload_s, float(pause)
        columns = (program.ramp_s, program.hold_s, program.unload_s, program.pause_s)
        ramp, hold, unload, pause = (float(column[number]) for column in columns)
        return ramp, hold, unload, pause

    def log(self, number: int) -> PressLog:
        """Return the samples of the press just made."""
        rows = self._rows[: self._used].copy()
        return PressLog(
            number,
            self.contact.calls,
            rows[:, 0],
            rows[:, 1].astype(np.int8),
            rows[:, 2],
            rows[:, 3],
            rows[:, 4:7],
            rows[:, 7:10],
            rows[:, 10:17],
        )

    def _transit(self, waypoints: tuple[tuple[np.ndarray, float], ...]) -> None:
        """Quintic joint motion through the waypoints, standing still at each."""
        for goal, duration in waypoints:
            start, count = self.posture, max(1, round(duration / self.dt))
            for i in range(1, count + 1):
                self._step(TRANSIT, *quintic(start, goal, i / count, duration))
            self.posture = goal

    def _pause(self, duration: float) -> None:
        for _ in range(round(duration / self.dt)):
            self._step(TRANSIT, self.posture, np.zeros(7))

    def _approach(self) -> None:
        """Go down until the measured force says touch."""
        settings, control = self.settings, self.control
        braking = settings.approach_m_per_s**2 / (2 * ACCELERATION_M_PER_S2)
        above = 0
        while above < TOUCH_SAMPLES:
            fast = control.depth_m < -settings.slow_m - braking
            control.move(settings.approach_m_per_s if fast else settings.touch_m_per_s)
            self._tick(APPROACH)
            above = above + 1 if self.rig.wrist_n[2] >= settings.touch_force_n else 0
        control.touch()

    def _ramp(self, phase: int, start_n: float, end_n: float, duration: float) -> None:
        """Follow a straight line of force over time, its ends rounded."""
        line = self.control.line(end_n - start_n, duration)
        count = max(1, round(line.duration_s / self.dt))
        for i in range(1, count + 1):
            share, rate = line.at(line.duration_s * i / count)
            self.wanted = start_n + (end_n - start_n) * share
            self.control.press(self.wanted, (end_n - start_n) * rate, learn=phase == LOAD)
            self._tick(phase)

    def _tick(self, phase: int) -> None:
        """One step at the commanded depth; measured force and body follow."""
        control = self.control
        if control.depth_m > self.depth_limit:
            raise InputError(
                f"Press {self.number}: the tip has gone {control.depth_m * 1e3:.1f} mm deep at "
                f"{control.force_n:.3f} N "
                f"and the plan provides for {self.depth_limit * 1e3:.1f} mm, at most what the "
                "body is thick. Set a smaller force, or a larger depth_m if it is less than that."
            )
        q, slope = self.planned.path.at(control.depth_m)
        q = q - control.force_n * self.sideways
        self._step(phase, q, slope * control.speed_m_per_s)
        control.feel(self.rig.wrist_n[2])
        self.contact.follow(self.rig.contact_n)
        self.posture = q

    def _step(self, phase: int, q: np.ndarray, v: np.ndarray, a: np.ndarray | float = 0.0) -> None:
        rig = self.rig
        rig.step(q, v, a)
        if self._used == len(self._rows):
            self._rows = np.vstack([self._rows, np.empty_like(self._rows)])
        row = self._rows[self._used]
        row[:4] = (self.steps * self.dt, phase, self.wanted, rig.contact_n)
        row[4:7] = rig.wrist_n
        row[7:10] = rig.tip_m
        row[10:17] = rig.q_seen
        self._used += 1
        if self.on_frame and self.steps % self.every == 0:
            self.on_frame(self._frame(PHASES[phase]))
        self.steps += 1

    def _frame(self, phase: str) -> Frame:
        data, planned = self.rig.data, self.planned
        rotation = data.site("tcp").xmat.reshape(3, 3)
        tip = self.rig.tip_m.copy()
        return Frame(
            time_s=self.time_s,
            press=self.number,
            phase=phase,
            positions_m=data.xpos[self.links].copy(),
            quaternions=data.xquat[self.links].copy(),
            tip_m=tip,
            tip_quaternion=data.xquat[self.links[-1]].copy(),
            force_vector_n=rotation @ self.rig.wrist_n,
            force_n=float(self.rig.wrist_n[2]),
            wanted_n=self.wanted,
            displacement_m=float((tip - planned.point_m) @ planned.direction),
        )
