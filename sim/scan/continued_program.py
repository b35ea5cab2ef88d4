"""A scan program that goes on where an earlier one ended, and also moves along paths."""

from __future__ import annotations

import numpy as np

from sim.motion.planned_motion import Motion, PlannedPress
from sim.motion.press_path import sideways_yield
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import MatchedContact, PressedBody
from sim.robot.mechanism import Mechanisms
from sim.scan.scan_program import HOLD, TARE_S, TRANSIT, Program
from sim.scan.watchdog import Watchdog


class ContinuedProgram(Program):
    """A program with arm, clock, stiffness and noise of an earlier one, where there is one."""

    def __init__(
        self,
        plan: ScanPlan,
        body: PressedBody,
        settings: ScanSettings,
        mechanisms: Mechanisms,
        motion: Motion,
        after: Program | None,
    ) -> None:
        super().__init__(plan, body, settings, None, mechanisms, motion)
        if after is None:
            return
        self.rig, self.control, self.encoder_rng = after.rig, after.control, after.encoder_rng
        self.task["steps"], self.posture = after.task["steps"], after.posture
        self.rig.live = self.live
        self.watchdog = Watchdog(self.rig, self.settings)
        self.contact = MatchedContact(self.rig.laboratory, self.rig.data, self.body)

    def step(self, q: np.ndarray, v: np.ndarray) -> None:
        """Move freely for one time step towards a configuration and its rate."""
        self._step(TRANSIT, q, v)
        self.posture = q

    def arrive(self, planned: PlannedPress) -> None:
        """Go to a planned press and touch."""
        self._aim(0, planned)
        self.task["wanted_n"] = 0.0
        self.recorder.begin()
        self._transit(planned.waypoints)
        self._tare(TARE_S)
        self._sideways[:] = sideways_yield(self.kinematics, planned.path, planned.direction)
        self.contact.start(0, planned.point_m, planned.direction, self.plan.force_of(0))
        self.control.rest(-self.settings.lift_m)
        self._touch()

    def slide(self, q: np.ndarray, v: np.ndarray, wanted_n: float, rate_n_per_s: float) -> None:
        """Make one step in contact, and follow a wanted force."""
        self.control.press(wanted_n, rate_n_per_s)
        self._step(HOLD, q - self.control.force_n * self._sideways, v)
        self.posture = q
        self.control.feel(self.rig.wrist_n[2])
        self.contact.follow(self.rig.contact_n, self.time_s)
