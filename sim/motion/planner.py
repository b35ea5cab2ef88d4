"""Plan the whole scan before the arm moves: reach, limits, speed, clearance.

A press is tried from several configurations of the arm, the one of the press before first, and the
way to it straight or by poses drawn back. What cannot be pressed is said for all presses at once.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from sim.motion.clearance import Clearance
from sim.motion.planned_motion import Motion, PlannedPress, Refusal
from sim.motion.press_path import PressPath, press_path
from sim.motion.quintic import PEAK_ACCELERATION, PEAK_SPEED
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.motion.tip import Tip
from sim.robot.force_control import ACCELERATION_M_PER_S2, FASTEST_M_PER_S
from sim.robot.inverse_kinematics import Reached, TipKinematics
from sim.robot.laboratory import Laboratory

LIMIT_FRACTION = 0.5
"""Part of the joints' limits of speed and acceleration that a planned motion may use."""

CLEARANCE_M = 0.003
TRANSIT_CLEARANCE_M = 0.001
NEAR_M = 0.01  # distances on the way that are of interest
SAME_RAD = 1e-3  # configurations that differ by less are one
DRAW_BACK_M = 0.06
RESTARTS = 25  # random starts of the inverse kinematics, where the usual ones do not do
DRAWN_ITERATIONS = 40
MOST_POSTURES = 6  # configurations that are tried for one press


def plan_motion(
    plan: ScanPlan,
    laboratory: Laboratory,
    settings: ScanSettings | None = None,
    fastest_m_per_s: float = FASTEST_M_PER_S,
    hardest_m_per_s2: float = ACCELERATION_M_PER_S2,
    start: np.ndarray | None = None,
) -> Motion:
    """Find configurations and paths for all presses; no body is needed for that.

    Parameters
    ----------
    plan : where, in which direction and how hard to press
    laboratory : with the arm
    settings : lift, largest depth and friction
    fastest_m_per_s, hardest_m_per_s2 : largest speed and acceleration of the tip along the press
        direction
    start : (n,) rad, configuration from which the arm sets out; None is home
    """
    settings = settings or ScanSettings()
    planner = _Planner(plan, laboratory, settings, fastest_m_per_s, hardest_m_per_s2)
    planner.start = laboratory.home if start is None else start
    refused: list[Refusal] = []
    made: list[PlannedPress] = []
    for number in range(len(plan)):
        try:
            made.append(planner.press(number, made))
        except _CannotPress as reason:
            refused.append(Refusal.of(plan, number, str(reason)))
    return Motion(tuple(made), tuple(refused))


def transit_duration(laboratory: Laboratory, start: np.ndarray, end: np.ndarray) -> float:
    """Seconds of a quintic joint motion that keeps to `LIMIT_FRACTION` of the joints' limits."""
    change = np.abs(end - start) / LIMIT_FRACTION
    by_speed = PEAK_SPEED * change / laboratory.speed_limit
    by_acceleration = np.sqrt(PEAK_ACCELERATION * change / laboratory.acceleration_limit)
    return max(0.3, float(by_speed.max()), float(by_acceleration.max()))


class _CannotPress(Exception):
    """Why a press cannot be made."""


class _Planner:
    def __init__(
        self,
        plan: ScanPlan,
        laboratory: Laboratory,
        settings: ScanSettings,
        fastest: float,
        hardest: float,
    ) -> None:
        self.plan, self.laboratory, self.settings = plan, laboratory, settings
        self.points = plan.body_in_world.points_to_world(plan.points_m)
        self.directions = plan.body_in_world.vectors_to_world(plan.directions)
        self.kinematics = TipKinematics(laboratory.arm)
        self.clearance = Clearance(laboratory, plan.body, plan.body_in_world)
        self.tilts, self.start = plan.tilts_rad(), laboratory.home
        self.tip: Tip | None = None  # that the arm carries after the presses planned so far
        # Largest turn of each joint for a metre of depth
        self.most_turn = LIMIT_FRACTION * np.minimum(
            laboratory.speed_limit / fastest, laboratory.acceleration_limit / hardest
        )

    def press(self, number: int, before: list[PlannedPress]) -> PlannedPress:
        """Plan a press after those before, or raise `_CannotPress`."""
        point, direction = self.points[number], self.directions[number]
        self._check_friction(number)
        force, settings = self.plan.force_of(number), self.settings
        depth = min(settings.largest_depth(force), self.plan.thickness_m(number))
        first: _CannotPress | None = None
        for touch in self._touches(point, direction, before[-1].touch if before else None):
            try:
                return self._from(touch, number, point, direction, depth, before)
            except _CannotPress as reason:
                first = first or reason
        assert first is not None  # no configuration at all raises itself
        raise first

    def _from(
        self,
        touch: np.ndarray,
        number: int,
        point: np.ndarray,
        direction: np.ndarray,
        depth: float,
        before: list[PlannedPress],
    ) -> PlannedPress:
        """Plan a press that touches in a given configuration."""
        lift = self.settings.lift_m
        path, failed = press_path(self.kinematics, point, direction, touch, -lift, depth)
        if path is None:
            reached = self.kinematics.reach(point + failed * direction, direction, touch)
            raise _CannotPress(
                f"{self._why(point + failed * direction, direction, reached)} at depth "
                f"{failed * 1e3:.0f} mm. Move the body nearer to the middle of the arm's range "
                "or press less deep."
            )
        approach = path.at(-lift)[0]
        distance = self._check_clearance(approach, touch)
        self._check_speed(path)
        last = before[-1].approach if before else self.start
        changed = bool(before) and self.tip != self.plan.tip_of(number)
        waypoints = self._transit(last, approach, point, direction, changed)
        self.tip = self.plan.tip_of(number)
        return PlannedPress(point, direction, path, approach, touch, waypoints, distance)

    def _check_friction(self, number: int) -> None:
        tilt, friction = self.tilts[number], self.settings.friction
        if np.tan(tilt) > friction or tilt >= np.pi / 2:
            raise _CannotPress(
                f"the push leaves the friction cone: it is {np.degrees(tilt):.0f} degrees from the "
                f"surface's normal, and with a friction of {friction:g} the tip slips beyond "
                f"{np.degrees(np.arctan(friction)):.0f}. Press along the normal."
            )

    def _touches(
        self, point: np.ndarray, direction: np.ndarray, last: np.ndarray | None
    ) -> Iterator[np.ndarray]:
        """Yield configurations that touch, the nearest to the press before first.

        Random starts follow only where all of these are refused.
        """
        home = self.laboratory.home
        turned = home.copy()
        at_home = self.kinematics.pose(home)[0]
        turned[0] += np.arctan2(point[1], point[0]) - np.arctan2(at_home[1], at_home[0])
        rng = np.random.default_rng(0)
        low, high = self.kinematics.low, self.kinematics.high
        starts = [start for start in (last, home, turned) if start is not None]
        best: Reached | None = None
        found: list[np.ndarray] = []
        far = self._far(point) > 0
        for i in range(len(starts) + (0 if far else RESTARTS)):
            start = starts[i] if i < len(starts) else rng.uniform(low, high)
            drawn = self.kinematics.reach(
                point, direction, start, posture=home, iterations=DRAWN_ITERATIONS
            )
            # The pull of the posture dies away slowly; without it Newton ends in a few steps
            reached = (
                drawn
                if drawn.converged
                else self.kinematics.reach(point, direction, drawn.q, iterations=DRAWN_ITERATIONS)
            )
            if best is None or reached.error < best.error:
                best = reached
            if not reached.converged:  # the pull may have led into a corner
                reached = self.kinematics.reach(point, direction, start)
            known = any(np.abs(reached.q - q).max() < SAME_RAD for q in found)
            if reached.converged and not known:
                found.append(reached.q)
                yield reached.q
                if len(found) == MOST_POSTURES:
                    return
        if not found:
            assert best is not None  # some starts were tried
            raise _CannotPress(
                f"{self._why(point, direction, best)}. Move the body, turn it, or leave this press "
                "out."
            )

    def _far(self, point: np.ndarray) -> float:
        """Return the distance of a point beyond the arm's length, m; negative within it."""
        kinematics = self.kinematics
        return float(np.linalg.norm(point - kinematics.shoulder_m)) - kinematics.reach_m

    def _why(self, point: np.ndarray, direction: np.ndarray, reached: Reached) -> str:
        """Return the reason for which a pose was not reached."""
        if self._far(point) > 0:
            return (
                f"out of reach: the point is {1e3 * self._far(point):.0f} mm beyond the length of "
                "the arm stretched out"
            )
        low, high = self.kinematics.low, self.kinematics.high
        stopped = np.flatnonzero((reached.q <= low) | (reached.q >= high))
        if len(stopped):
            names = ", ".join(f"joint{i + 1} at {reached.q[i]:.3f} rad" for i in stopped)
            return f"joint limit: {names} stops the arm {reached.error * 1e3:.1f} mm or mrad short"
        return (
            f"out of reach: the tip stays {reached.error * 1e3:.1f} mm or mrad away from the pose"
        )

    def _check_clearance(self, approach: np.ndarray, touch: np.ndarray) -> float:
        distance, part, obstacle = self.clearance.nearest(approach)
        if distance >= CLEARANCE_M:
            at_touch = self.clearance.nearest(touch, tip_may_touch=True)
            if at_touch[0] >= CLEARANCE_M:
                return distance
            distance, part, obstacle = at_touch
        raise _CannotPress(
            f"collision: {part} would come within {distance * 1e3:.1f} mm of {obstacle} "
            f"(at least {CLEARANCE_M * 1e3:.0f} mm wanted). Move the body, tilt the press away, or "
            "leave this press out."
        )

    def _check_speed(self, path: PressPath) -> None:
        for depth in np.linspace(path.start_m, path.end_m, 5):
            turn = np.abs(path.at(depth)[1])
            worst = int((turn / self.most_turn).argmax())
            if turn[worst] > self.most_turn[worst]:
                raise _CannotPress(
                    f"joint{worst + 1} would turn by {turn[worst]:.2f} rad for each metre "
                    f"of depth; half of its limits of speed and acceleration allow "
                    f"{self.most_turn[worst]:.2f}. Approach more slowly or move the body away from "
                    "the edge of the arm's range."
                )

    def _transit(
        self,
        start: np.ndarray,
        end: np.ndarray,
        point: np.ndarray,
        direction: np.ndarray,
        change: bool,
    ) -> tuple[tuple[np.ndarray, float], ...]:
        """Straight to the approach pose, or by poses drawn back from it and from start, or home.

        To change the tip the arm goes home and stands there.
        """
        tip, turn = self.kinematics.pose(start)
        back_start = self.kinematics.reach(tip - DRAW_BACK_M * turn[:, 2], turn[:, 2], start).q
        back_end = self.kinematics.reach(point - DRAW_BACK_M * direction, direction, end).q
        nearest = (-np.inf, "", "")
        home = self.laboratory.home
        by_home = [back_start, home, back_end]
        for via in [by_home] if change else [[], [back_end], [back_start, back_end], by_home]:
            legs = list(pairwise([start, *via, end]))
            found = min(self._nearest_on_way(a, b) for a, b in legs)
            if found[0] >= TRANSIT_CLEARANCE_M:
                way = [(b, transit_duration(self.laboratory, a, b)) for a, b in legs]
                stop = [(home, self.settings.tip_change_s)] if change else []
                return (*way[:2], *stop, *way[2:])
            nearest = max(nearest, found)
        raise _CannotPress(
            f"collision on the way there: {nearest[1]} would come within "
            f"{nearest[0] * 1e3:.1f} mm of {nearest[2]}. Order the presses so that neighbours "
            "follow each other, or raise the lift height."
        )

    def _nearest_on_way(self, start: np.ndarray, end: np.ndarray) -> tuple[float, str, str]:
        count = 3 + int(np.abs(end - start).max() / 0.05)
        return min(
            self.clearance.nearest(start + s * (end - start), within_m=NEAR_M)
            for s in np.linspace(0, 1, count)
        )
