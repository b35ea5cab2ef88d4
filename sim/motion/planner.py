"""Plan the whole scan before the arm moves: reach, limits, speed, clearance, one elbow."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from models import PROBE_LENGTH_M, REACH_M, SHOULDER_M, InputError
from sim.motion.clearance import Clearance
from sim.motion.press_path import PressPath, press_path
from sim.motion.quintic import PEAK_ACCELERATION, PEAK_SPEED
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody
from sim.robot.inverse_kinematics import Reached, TipKinematics
from sim.robot.laboratory import Laboratory

LIMIT_FRACTION = 0.5
"""Part of the joints' limits of speed and acceleration that a planned motion may use."""

CLEARANCE_M = 0.003
TRANSIT_CLEARANCE_M = 0.001
DRAW_BACK_M = 0.06
LARGEST_ELBOW_STEP_RAD = 0.6


@dataclass(frozen=True)
class PlannedPress:
    """One press, ready to be made.

    Attributes
    ----------
    point_m, direction : (3,) m and unit, world frame
    path : the arm's configuration over depth
    approach : (7,) rad, above the surface, start and end of the press
    touch : (7,) rad, tip on the undeformed surface
    waypoints : configurations (7,) rad and durations (s) of the motion from the press before to
        `approach`
    clearance_m : smallest distance of the arm from body and table at `approach`
    """

    point_m: np.ndarray
    direction: np.ndarray
    path: PressPath
    approach: np.ndarray
    touch: np.ndarray
    waypoints: tuple[tuple[np.ndarray, float], ...]
    clearance_m: float


def plan_motion(
    plan: ScanPlan,
    laboratory: Laboratory,
    lift_m: float = 0.005,
    depth_m: float = 0.02,
    fastest_m_per_s: float = 0.1,
    hardest_m_per_s2: float = 0.5,
) -> tuple[PlannedPress, ...]:
    """Find configurations and paths for all presses.

    Parameters
    ----------
    lift_m : height above the surface at which a press starts and ends
    depth_m : largest depth to be reached
    fastest_m_per_s, hardest_m_per_s2 : largest speed and acceleration of the tip along the press
        direction

    Raises
    ------
    InputError
        A press that is out of reach, against a joint limit, in collision or too fast; it names
        press and pose.
    """
    planner = _Planner(laboratory, lift_m, depth_m, fastest_m_per_s, hardest_m_per_s2)
    points = plan.body_in_world.points_to_world(plan.points_m)
    directions = plan.body_in_world.vectors_to_world(plan.directions)
    presses: list[PlannedPress] = []
    for point, direction in zip(points, directions, strict=True):
        presses.append(planner.press(len(presses), point, direction, presses))
    return tuple(presses)


def refuse_too_deep(plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> None:
    """Refuse a scan in which a press would go deeper than body or settings allow.

    Raises
    ------
    InputError
        It names the press that goes furthest beyond, and the force that would do.
    """
    provided = settings.largest_depth(plan.force_n)
    presses = range(len(plan))
    expected = np.array([body.displacement(press, plan.force_of(press)) for press in presses])
    thickness = np.array([plan.thickness_m(press) for press in presses])
    allowed = np.minimum(settings.deepest_share * thickness, provided)
    worst = int((allowed / expected).argmin())
    if expected[worst] <= allowed[worst]:
        return
    force = plan.force_of(worst)
    enough = 0.99 * force * allowed[worst] / expected[worst]
    why = (
        f"the scan setting depth_m provides for {provided * 1e3:.3g} mm"
        if allowed[worst] == provided
        else f"the body is {thickness[worst] * 1e3:.3g} mm thick there, of which at most "
        f"{100 * settings.deepest_share:.0f} % may be pressed, as its law is for small depths"
    )
    raise InputError(
        f"Press {worst} at {_mm(plan.points_m[worst])} mm: {force:.3g} N would go "
        f"{expected[worst] * 1e3:.3g} mm deep; {why}. Press with at most "
        f"{enough:.3g} N, with a wider tip, or on a thicker or stiffer body."
    )


def transit_duration(laboratory: Laboratory, start: np.ndarray, end: np.ndarray) -> float:
    """Seconds of a quintic joint motion that keeps to `LIMIT_FRACTION` of the joints' limits."""
    change = np.abs(end - start) / LIMIT_FRACTION
    by_speed = PEAK_SPEED * change / laboratory.speed_limit
    by_acceleration = np.sqrt(PEAK_ACCELERATION * change / laboratory.acceleration_limit)
    return max(0.3, float(by_speed.max()), float(by_acceleration.max()))


class _Planner:
    def __init__(
        self,
        laboratory: Laboratory,
        lift_m: float,
        depth_m: float,
        fastest: float,
        hardest: float,
    ) -> None:
        self.laboratory = laboratory
        self.kinematics = TipKinematics(laboratory.arm)
        self.clearance = Clearance(laboratory.model)
        self.lift_m, self.depth_m = lift_m, depth_m
        # Largest turn of each joint for a metre of depth
        self.most_turn = LIMIT_FRACTION * np.minimum(
            laboratory.speed_limit / fastest, laboratory.acceleration_limit / hardest
        )

    def press(
        self, number: int, point: np.ndarray, direction: np.ndarray, before: list[PlannedPress]
    ) -> PlannedPress:
        home = self.laboratory.home
        where = (
            f"Press {number} at {_mm(point)} mm, direction {np.round(direction, 3).tolist()} "
            "(world frame)"
        )
        last_touch = before[-1].touch if before else home
        touch = self._touch(where, point, direction, last_touch)
        path, failed = press_path(
            self.kinematics, point, direction, touch, -self.lift_m, self.depth_m
        )
        if path is None:
            reached = self.kinematics.reach(point + failed * direction, direction, touch)
            raise InputError(
                f"{where}: {self._why(point + failed * direction, direction, reached)} at depth "
                f"{failed * 1e3:.0f} mm. Move the body nearer to the middle of the arm's range "
                "or press less deep."
            )
        approach = path.at(-self.lift_m)[0]
        distance = self._check_clearance(where, approach, touch)
        self._check_speed(where, path)
        last = before[-1].approach if before else home
        if before and np.abs(touch - last_touch).max() > LARGEST_ELBOW_STEP_RAD:
            raise InputError(
                f"{where}: the elbow would swing by {np.abs(touch - last_touch).max():.2f} rad "
                f"from the press before (at most {LARGEST_ELBOW_STEP_RAD} rad). Order the presses "
                "so that neighbours follow each other, or move the body away from the edge of the "
                "arm's range."
            )
        waypoints = self._transit(where, last, approach, point, direction)
        return PlannedPress(point, direction, path, approach, touch, waypoints, distance)

    def _touch(
        self, where: str, point: np.ndarray, direction: np.ndarray, last: np.ndarray
    ) -> np.ndarray:
        home = self.laboratory.home
        turned = home.copy()
        turned[0] = np.arctan2(point[1], point[0])
        best: Reached | None = None
        for seed in (last, home, turned):
            reached = self.kinematics.reach(point, direction, seed, posture=home)
            if reached.converged:
                return reached.q
            if best is None or reached.error < best.error:
                best = reached
        assert best is not None  # three seeds were tried
        raise InputError(
            f"{where}: {self._why(point, direction, best)}. Move the body, turn it, or leave "
            "this press out."
        )

    def _why(self, point: np.ndarray, direction: np.ndarray, reached: Reached) -> str:
        """Return the reason for which a pose was not reached."""
        distance = np.linalg.norm(point - PROBE_LENGTH_M * direction - SHOULDER_M)
        if distance > REACH_M:
            return (
                f"out of reach: the flange would be {distance:.3f} m from the shoulder, the arm "
                f"reaches {REACH_M} m"
            )
        low, high = self.kinematics.low, self.kinematics.high
        stopped = np.flatnonzero((reached.q <= low) | (reached.q >= high))
        if len(stopped):
            names = ", ".join(f"joint{i + 1} at {reached.q[i]:.3f} rad" for i in stopped)
            return f"joint limit: {names} stops the arm {reached.error * 1e3:.1f} mm or mrad short"
        return (
            f"out of reach: the tip stays {reached.error * 1e3:.1f} mm or mrad away from the pose"
        )

    def _check_clearance(self, where: str, approach: np.ndarray, touch: np.ndarray) -> float:
        distance, part, obstacle = self.clearance.nearest(approach)
        if distance >= CLEARANCE_M:
            at_touch = self.clearance.nearest(touch, tip_may_touch=True)
            if at_touch[0] >= CLEARANCE_M:
                return distance
            distance, part, obstacle = at_touch
        raise InputError(
            f"{where}: collision: {part} would come within {distance * 1e3:.1f} mm of {obstacle} "
            f"(at least {CLEARANCE_M * 1e3:.0f} mm wanted). Move the body, tilt the press away, or "
            "leave this press out."
        )

    def _check_speed(self, where: str, path: PressPath) -> None:
        for depth in np.linspace(path.start_m, path.end_m, 5):
            turn = np.abs(path.at(depth)[1])
            worst = int((turn / self.most_turn).argmax())
            if turn[worst] > self.most_turn[worst]:
                raise InputError(
                    f"{where}: joint{worst + 1} would turn by {turn[worst]:.2f} rad for each metre "
                    f"of depth; half of its limits of speed and acceleration allow "
                    f"{self.most_turn[worst]:.2f}. Approach more slowly or move the body away from "
                    "the edge of the arm's range."
                )

    def _transit(
        self,
        where: str,
        start: np.ndarray,
        end: np.ndarray,
        point: np.ndarray,
        direction: np.ndarray,
    ) -> tuple[tuple[np.ndarray, float], ...]:
        """Straight to the approach pose, or by way of poses drawn back from it and from start."""
        tip, turn = self.kinematics.pose(start)
        back_start = self.kinematics.reach(tip - DRAW_BACK_M * turn[:, 2], turn[:, 2], start)
        back_end = self.kinematics.reach(point - DRAW_BACK_M * direction, direction, end)
        nearest = (np.inf, "", "")
        for via in ([], [back_end.q], [back_start.q, back_end.q]):
            stations = [start, *via, end]
            legs = list(pairwise(stations))
            nearest = min(self._nearest_on_way(a, b) for a, b in legs)
            if nearest[0] >= TRANSIT_CLEARANCE_M:
                return tuple((b, transit_duration(self.laboratory, a, b)) for a, b in legs)
        raise InputError(
            f"{where}: collision on the way there: {nearest[1]} would come within "
            f"{nearest[0] * 1e3:.1f} mm of {nearest[2]}. Order the presses so that neighbours "
            "follow each other, or raise the lift height."
        )

    def _nearest_on_way(self, start: np.ndarray, end: np.ndarray) -> tuple[float, str, str]:
        count = 3 + int(np.abs(end - start).max() / 0.05)
        return min(
            self.clearance.nearest(start + s * (end - start)) for s in np.linspace(0, 1, count)
        )


def _mm(point: np.ndarray) -> str:
    return "(" + ", ".join(f"{value * 1e3:.1f}" for value in point) + ")"
