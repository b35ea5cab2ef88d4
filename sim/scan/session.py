"""A robot that goes on from call to call: presses, paths through the air, sweeps over the body."""

# mujoco and pinocchio are compiled modules without type stubs
# pyright: reportAttributeAccessIssue=false, reportMissingImports=false
from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
from scipy.interpolate import CubicSpline

from models import InputError
from sim.motion.clearance import Clearance
from sim.motion.depth_check import beyond_limits
from sim.motion.planned_motion import Motion, Refusal, refuse
from sim.motion.planner import plan_motion, transit_duration
from sim.motion.scan_plan import ScanPlan
from sim.motion.scene import plan_scene
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody
from sim.robot.inverse_kinematics import TipKinematics
from sim.robot.mechanism import Mechanisms
from sim.scan.continued_program import ContinuedProgram
from sim.scan.outcome import PressOutcome
from sim.scan.path_log import PathLog, PathResult
from sim.scan.result import ScanRun
from sim.scan.scan_program import DWELL_S
from sim.scan.whole_scan import make_presses

STEP_M = 0.002  # of a path, between two solutions of the inverse kinematics
STEEPEST_TURN = 0.5  # part of the joints' speed limits that a path may use
SETTLE_S = 0.6  # after touching, until the force of a sweep is reached
FREE_FORCE_N = 8.0  # of a path without set force: the arm stops


class SweptBody:
    """Linear law of a body along a path: compliances (k,) at shares (k,) of it, interpolated."""

    def __init__(self, shares: np.ndarray, compliance: np.ndarray) -> None:
        self._shares, self._compliance, self.share = shares, compliance, 0.0

    def displacement(self, press: int, force_n: float) -> float:
        """Depth of the tip under a force at the present place, m."""
        return force_n / self.tangent(press, force_n)

    def tangent(self, press: int, force_n: float) -> float:
        """Stiffness at the present place, N/m."""
        del press, force_n
        return 1 / float(np.interp(self.share, self._shares, self._compliance))


class Session:
    """Arm, clock and noise that last from call to call.

    Parameters
    ----------
    settings : times, speeds, noise and sampling
    plan : whose body, place and tip the session has; its presses are not made
    mechanisms : that act in the loop, unknown to the robot
    """

    def __init__(
        self, settings: ScanSettings, plan: ScanPlan, mechanisms: Mechanisms | None = None
    ) -> None:
        self.settings, self._plan = settings, plan
        self._mechanisms = mechanisms or Mechanisms()
        self.laboratory = plan_scene(plan, settings)
        self._kinematics = TipKinematics(self.laboratory.arm)
        self._clearance = Clearance(self.laboratory, plan.body, plan.body_in_world)
        self._program: ContinuedProgram | None = None

    @property
    def time_s(self) -> float:
        """Clock of the robot, s."""
        return self._program.time_s if self._program else 0.0

    @property
    def posture(self) -> np.ndarray:
        """Configuration of the arm, (n,) rad."""
        return self._program.posture if self._program else self.laboratory.home

    def reach(self, plan: ScanPlan) -> Motion:
        """Plan presses from where the arm is."""
        return plan_motion(plan, self.laboratory, self.settings, start=self.posture)

    def press(
        self,
        plan: ScanPlan,
        body: PressedBody,
        motion: Motion,
        beyond: Sequence[Refusal] = (),
        on_outcome: Callable[[PressOutcome], None] | None = None,
    ) -> ScanRun:
        """Make the planned presses without those that are beyond limits."""
        started = time.perf_counter()
        self._program = self._next(plan, body, motion)
        return make_presses(self._program, motion.refused, beyond, None, on_outcome, started)

    def _next(self, plan: ScanPlan, body: PressedBody, motion: Motion) -> ContinuedProgram:
        return ContinuedProgram(plan, body, self.settings, self._mechanisms, motion, self._program)

    def follow(self, points_m: np.ndarray, axes: np.ndarray, speed_m_per_s: float) -> PathResult:
        """Move the tip through poses in straight lines; the body does not resist, the table does.

        Parameters
        ----------
        points_m, axes : (k, 3) tip's centre m and unit axis, body frame
        speed_m_per_s : of the tip

        Raises
        ------
        InputError
            A pose that the arm does not reach; it is named.
        """
        program = self._idle()
        log = self._log(program)
        points, directions = self._world(points_m, axes)
        start = program.posture
        tip, turn = self._kinematics.pose(start)
        log.event("start", f"{len(points)} poses")
        stations = np.vstack([tip, points])
        along = np.vstack([turn[:, 2], directions])
        way, knots = _knots(stations, along)
        solved = self._solve(*knots, start)
        duration = self._duration(way, solved, speed_m_per_s)
        spline = CubicSpline(way / way[-1] * duration, solved, bc_type="clamped")
        touched = False
        for i in range(1, max(1, math.ceil(duration / program.dt)) + 1):
            when = min(i * program.dt, duration)
            program.step(spline(when), spline(when, 1))
            force = log.add(0.0)
            if force > self.settings.touch_force_n and not touched:
                touched = True
                log.event("touch", f"the tip meets something with {force:.3g} N")
            if force > (self.settings.force_limit_n or FREE_FORCE_N):
                log.event("force", f"stopped at {force:.3g} N")
                self._back(program, spline, when, log)
                break
        else:
            log.event("end", "the last pose is reached")
        return log.result()

    def sweep(
        self,
        points_m: np.ndarray,
        directions: np.ndarray,
        compliance: np.ndarray,
        force_n: float,
        speed_m_per_s: float,
    ) -> PathResult:
        """Slide the tip over the body with a constant force, without friction.

        Parameters
        ----------
        points_m, directions : (k, 3) on the surface m, and unit into the body; body frame
        compliance : (k,) m/N, of the body there
        force_n : set force
        speed_m_per_s : along the surface
        """
        shares = np.r_[0.0, np.cumsum(np.linalg.norm(np.diff(points_m, axis=0), axis=1))]
        length, shares = float(shares[-1]), shares / shares[-1]
        body = SweptBody(shares, compliance)
        first = self._one_press(points_m[:1], directions[:1], force_n)
        motion = self.reach(first)
        (planned,) = motion.require_all()
        refuse(beyond_limits(first, body, self.settings), len(first), skip=False)
        program = self._program = self._next(first, body, motion)
        log = self._log(program)
        log.event("start", f"sweep over {1e3 * length:.3g} mm with {force_n:g} N")
        program.arrive(planned)
        log.event("touch", f"at {1e3 * program.control.depth_m:.2f} mm")
        world, along = self._world(points_m, directions)
        place, aim = CubicSpline(shares, world), CubicSpline(shares, along)
        duration = length / speed_m_per_s
        total = math.ceil((SETTLE_S + duration + DWELL_S) / program.dt)
        q, rising = program.posture, force_n / SETTLE_S
        began = program.control.force_n
        for i in range(1, total + 1):
            t = i * program.dt
            share = float(np.clip((t - SETTLE_S) / duration, 0, 1))
            wanted = min(began + rising * t, force_n)
            rate = rising if wanted < force_n else 0.0
            body.share = share
            direction = aim(share)
            direction = direction / np.linalg.norm(direction)
            program.contact.carry(place(share), direction)
            goal = place(share) + program.control.depth_m * direction
            reached = self._kinematics.reach(goal, direction, q, tolerance=1e-8)
            if not reached.converged:
                log.event("end", f"out of reach at {100 * share:.0f} % of the way")
                break
            speed, q = (reached.q - q) / program.dt, reached.q
            program.slide(q, speed, wanted, rate)
            log.add(wanted)
        else:
            log.event("end", "the last point is reached")
        self._lift_off(program, q)
        return log.result()

    def _one_press(self, point_m: np.ndarray, direction: np.ndarray, force_n: float) -> ScanPlan:
        """Plan of one press, (1, 3) each, with the session's body, place and tip."""
        known = self._plan
        return ScanPlan(
            point_m,
            direction,
            force_n,
            known.tip_radius_m,
            known.body_size_m,
            known.body_in_world,
            surface=known.surface,
            tips=(known.tip_of(0),),
        )

    def _lift_off(self, program: ContinuedProgram, q: np.ndarray) -> None:
        """Take the tip off the body along its axis."""
        tip, turn = self._kinematics.pose(q)
        program.contact.release()
        back = self._kinematics.reach(tip - 2 * self.settings.lift_m * turn[:, 2], turn[:, 2], q)
        for s in np.linspace(0, 1, math.ceil(0.5 / program.dt)):
            program.step(q + (3 * s**2 - 2 * s**3) * (back.q - q), np.zeros_like(q))
        program.control.rest(-self.settings.lift_m)

    def _back(
        self, program: ContinuedProgram, spline: CubicSpline, when: float, log: PathLog
    ) -> None:
        """Go back along a path until nothing is touched, at most 1 s of it."""
        for i in range(round(1.0 / program.dt)):
            at = max(when - i * program.dt, 0.0)
            program.step(spline(at), -spline(at, 1))
            if log.add(0.0) < self.settings.touch_force_n / 2 and i * program.dt > DWELL_S:
                break

    def _idle(self) -> ContinuedProgram:
        """Return the program in which the arm moves; without presses if there was none yet."""
        if self._program is None:
            nothing = SweptBody(np.array([0.0, 1.0]), np.ones(2))
            self._program = ContinuedProgram(
                self._plan, nothing, self.settings, self._mechanisms, Motion(()), None
            )
        return self._program

    def _log(self, program: ContinuedProgram) -> PathLog:
        return PathLog(program, self._clearance, self._plan.body_in_world)

    def _world(self, points: np.ndarray, axes: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        place = self._plan.body_in_world
        return place.points_to_world(points), place.vectors_to_world(axes)

    def _solve(self, points: np.ndarray, axes: np.ndarray, start: np.ndarray) -> np.ndarray:
        solved = [start]
        for point, axis in zip(points[1:], axes[1:], strict=True):
            reached = self._kinematics.reach(point, axis, solved[-1])
            if not reached.converged:
                body = (point - self._plan.body_in_world.position_m) @ (
                    self._plan.body_in_world.rotation
                )
                place = np.round(1e3 * (body + self._plan.origin_m), 1).tolist()
                raise InputError(
                    f"the pose at {place} mm is out of "
                    f"reach by {1e3 * reached.error:.1f} mm or mrad; move it nearer or "
                    "turn its axis"
                )
            solved.append(reached.q)
        return np.array(solved)

    def _duration(self, way: np.ndarray, solved: np.ndarray, speed: float) -> float:
        by_joints = sum(np.abs(b - a).max() for a, b in pairwise(solved)) / (
            STEEPEST_TURN * float(self.laboratory.speed_limit.min())
        )
        least = transit_duration(self.laboratory, solved[0], solved[-1])
        return float(max(way[-1] / speed, by_joints, least))


def _knots(
    points: np.ndarray, axes: np.ndarray
) -> tuple[np.ndarray, tuple[np.ndarray, np.ndarray]]:
    """Way to each knot of a polyline (m) and the knots with axes between those of its corners."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    turns = np.linalg.norm(np.diff(axes, axis=0), axis=1) * 0.1  # a turn takes time too
    steps = np.maximum(np.maximum(steps, turns), 1e-6)
    corners = np.r_[0.0, np.cumsum(steps)]
    inner = [
        np.linspace(a, b, max(2, math.ceil((b - a) / STEP_M) + 1))[1:] for a, b in pairwise(corners)
    ]
    way = np.r_[0.0, np.concatenate(inner)]
    place = np.column_stack([np.interp(way, corners, points[:, i]) for i in range(3)])
    aim = np.column_stack([np.interp(way, corners, axes[:, i]) for i in range(3)])
    return way, (place, aim / np.linalg.norm(aim, axis=1, keepdims=True))
