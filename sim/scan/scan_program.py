"""The scan program: approach, touch, ramp to the set force, hold, unload, retract, next."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from sim.motion.planned_motion import Motion, PlannedPress
from sim.motion.planner import plan_motion
from sim.motion.press_path import sideways_yield
from sim.motion.scan_plan import ScanPlan
from sim.motion.scene import plan_scene
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import BodyLawError, PressedBody
from sim.robot.mechanism import Mechanisms
from sim.scan.arm_motions import ArmMotions
from sim.scan.control_loop import (
    APPROACH,
    DWELL,
    DWELL_S,
    HOLD,
    LEAVE,
    LOAD,
    RETRACT,
    SEEK,
    TOUCH,
    TRANSIT,
    UNLOAD,
)
from sim.scan.outcome import ATTEMPTS, Fault, PressFault, PressOutcome
from sim.scan.press_log import PressLog
from sim.scan.press_result import press_result
from sim.scan.result import PHASES, Frame, PressResult
from sim.scan.watchdog import limits_of

FALSE_TOUCHES = 3

TARE_S = 0.1
"""The arm rests at least so long before an approach; the sensor is tared meanwhile."""

FREE_S = 0.1
"""At the end of a press the tip is free for so long at least."""


class Program(ArmMotions):
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
        self.plan = plan
        laboratory = plan_scene(plan, settings)
        planned = motion or plan_motion(plan, laboratory, settings)
        self.presses = planned.presses if motion else planned.require_all()
        self.encoder_rng = np.random.default_rng(settings.streams()[1])
        self.pauses_s = settings.pauses(len(plan))
        super().__init__(laboratory, body, settings, on_frame, mechanisms)

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
            hold = settings.hold_of(self.plan.force_of(number))
            return settings.ramp_s, hold, settings.unload_s, float(pause)
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
