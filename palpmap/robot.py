"""The simulated robot from Python: presses, paths and sweeps, one after the other.

The clock runs on and the arm stays where it is from call to call. Everything is in the frame of the
study, SI units. `assert_force_kept` and `assert_path_clear` test a scripted motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
from numpy.typing import ArrayLike

from identify.map import GaussianMap
from models import InputError, Scan, Seed, kinds_checked, stack_scans
from palpmap.arguments import for_each, rows
from palpmap.study import virtual_lab
from palpmap.study.body import Body
from palpmap.study.press_plan import plan_at, surface_of
from palpmap.study.study import Probe, Study
from palpmap.study.truth_file import Truth, refuse_outside

if TYPE_CHECKING:
    from sim.motion import ScanPlan, ScanSettings
    from sim.robot import Mechanism
    from sim.scan import PathResult, PressOutcome, ScanRun, Series

OFF_SURFACE_M = 1e-3
SETTLED = 0.5  # part of a hold, or of a sweep, after which its force has to be kept


@kinds_checked
@dataclass(frozen=True)
class Presses:
    """Presses of one call and their outcomes.

    Attributes
    ----------
    scan : readings of those that were made, press ids counting from 0 in this call; None if none
    outcomes : made, retried, skipped or aborted, with the reason; those out of reach first
    unreachable : number of the press and the reason, of those that cannot be made
    series : every time step of the presses that were made; None if none

    Examples
    --------
    >>> import palpmap as pm
    >>> robot = pm.Robot(pm.Block((0.08, 0.08, 0.04), poisson_ratio=0.45))
    >>> pressed = robot.press((0.04, 0.04, 0.04), (0.0, 0.0, -1.0), force_n=0.2)
    >>> pressed.made, pressed.outcomes[0].outcome
    (1, 'made')
    """

    scan: Scan | None
    outcomes: tuple[PressOutcome, ...]
    unreachable: tuple[tuple[int, str], ...]
    series: Series | None

    @property
    def made(self) -> int:
        """Number of presses with readings."""
        return sum(outcome.delivered for outcome in self.outcomes)


class Robot:
    """A simulated arm with a force sensor beside a soft body.

    Parameters
    ----------
    body : that is pressed; None is the built-in phantom's block
    tip : of the probe; None is a flat one of 5 mm radius
    map : true map; None is the phantom's in a block, else one that the seed draws
    arm : times, speeds, noise and sampling
    mechanisms : faults that act in the loop, unknown to the robot
    seed : of the noise

    Examples
    --------
    >>> import palpmap as pm
    >>> robot = pm.Robot(pm.Block((0.08, 0.08, 0.04), poisson_ratio=0.45))
    >>> robot.time_s
    0.0
    """

    @kinds_checked
    def __init__(
        self,
        body: Body | None = None,
        *,
        tip: Probe | None = None,
        map: GaussianMap | None = None,
        arm: ScanSettings | None = None,
        mechanisms: Sequence[Mechanism] = (),
        seed: Seed = 0,
    ) -> None:
        from sim.motion import ScanSettings
        from sim.robot import Mechanisms
        from sim.scan import Session

        known = virtual_lab.default_study()
        update = {"body": body or known.body, "probe": tip or known.probe}
        self.study: Study = known.model_copy(update=update)
        self.settings = replace(arm or ScanSettings(), seed=seed)
        self._origin = np.array(self.study.body.origin_m)
        surface = surface_of(self.study)
        if map is not None:
            refuse_outside(map.inclusions, self.study, "map.inclusions", scans=True)
        self._truth = Truth(
            virtual_lab.default_truth(surface, seed)
            if map is None
            else virtual_lab.truth_of(map, self._origin)
        )
        self._surface = surface
        middle = surface.top((surface.lowest_m + surface.extent_m / 2)[None, :2])
        plan = plan_at(self.study, middle, -surface.footing(middle, 1e-3).normals, 0.3)
        self._session = Session(self.settings, plan, Mechanisms(tuple(mechanisms)))
        self._runs: list[ScanRun] = []

    @property
    def time_s(self) -> float:
        """Clock of the robot, s."""
        return self._session.time_s

    @property
    def q(self) -> np.ndarray:
        """Joint angles, (n,) rad."""
        return self._session.posture.copy()

    def surface(self, xy_m: ArrayLike) -> tuple[np.ndarray, np.ndarray]:
        """Return the upper surface's points (j, 3) m at places (j, 2), and its inward normals.

        Raises
        ------
        InputError
            A place beside the body.
        """
        places = rows("xy_m", xy_m, 2) - self._origin[:2]
        points = self._surface.top(places)
        if np.isnan(points).any():
            j = int(np.flatnonzero(np.isnan(points[:, 2]))[0])
            raise InputError(f"place {j}: there is no body at {places[j] + self._origin[:2]} m")
        normals = self._surface.footing(points, self.study.probe.radius_m).normals
        return points + self._origin, -normals

    @kinds_checked
    def press(
        self,
        points_m: ArrayLike,
        directions: ArrayLike | None = None,
        force_n: float | ArrayLike = 0.3,
        *,
        on_unreachable: Literal["raise", "skip"] = "raise",
    ) -> Presses:
        """Press at points, in their order.

        Parameters
        ----------
        points_m : (3,) or (j, 3) on the surface
        directions : (3,) or (j, 3) unit, into the body; None presses along the normals
        force_n : one, or (j,)
        on_unreachable : "skip" leaves out presses that cannot be made or would go too deep; their
            outcomes say why

        Raises
        ------
        InputError
            A press that cannot be made, would go too deep, or is not on the body.
        """
        plan = self._plan(points_m, directions, force_n)
        from sim.motion import beyond_limits, refuse

        motion = self._session.reach(plan)
        skip, count = on_unreachable == "skip", len(plan)
        refuse(motion.refused, count, skip)
        plan = plan.only(np.delete(np.arange(count), [one.press for one in motion.refused]))
        laboratory = virtual_lab.build_laboratory(
            self.study, plan, self.settings, truth=self._truth, motion=motion
        )
        beyond = beyond_limits(plan, laboratory.body, self.settings)
        left_out = (*motion.refused, *beyond)
        refuse(left_out, count, skip)
        run = self._session.press(plan, laboratory.body, motion, beyond)
        self._runs.append(run)
        scan = run.scan.moved(self._origin) if run.presses else None
        left = tuple((one.press, one.reason) for one in left_out)
        return Presses(scan, run.outcomes, left, run.series if run.presses else None)

    @kinds_checked
    def follow(
        self,
        points_m: ArrayLike,
        directions: ArrayLike = (0.0, 0.0, -1.0),
        *,
        force_n: float | None = None,
        speed_m_per_s: float = 0.02,
    ) -> PathResult:
        """Move the tip through poses; with a force, slide it over the body.

        Without a force the tip moves in straight lines. The body does not resist it; the table
        does, and the arm stops and goes back at 8 N, or at the settings' `force_limit_n`.

        Parameters
        ----------
        points_m : (k, 3) of the tip's centre; with a force, on the surface
        directions : (3,) or (k, 3) unit, of the tip's axis
        force_n : set force along the axis
        speed_m_per_s : of the tip

        Raises
        ------
        InputError
            A pose that the arm does not reach.
        """
        points = rows("points_m", points_m, 3)
        axes = for_each("directions", directions, points.shape)
        if not speed_m_per_s > 0:
            raise InputError(f"speed_m_per_s: found {speed_m_per_s!r}, expected greater than 0")
        if force_n is None:
            found = self._session.follow(points - self._origin, axes, speed_m_per_s)
        else:
            if len(points) < 2:
                raise InputError("a sweep needs two points or more; press at one with press()")
            plan = self._plan(points, axes, force_n)
            body = virtual_lab.build_laboratory(
                self.study, plan, self.settings, truth=self._truth
            ).body
            found = self._session.sweep(
                plan.points_m, plan.directions, body.compliance_m_per_n, force_n, speed_m_per_s
            )
        return replace(found, tip_m=found.tip_m + self._origin)

    @property
    def scan(self) -> Scan:
        """All readings of this robot so far, presses counting on from call to call.

        Raises
        ------
        InputError
            Nothing was pressed yet.
        """
        scans, first = [], 0
        for run in self._runs:
            if run.presses:
                scans.append(run.scan.replace(press=run.scan.press + first))
                first += int(run.scan.press.max()) + 1
        if not scans:
            raise InputError("the robot has made no press yet; call press() first")
        return stack_scans(scans).moved(self._origin)

    def _plan(
        self, points_m: ArrayLike, directions: ArrayLike | None, force_n: float | ArrayLike
    ) -> ScanPlan:
        points = rows("points_m", points_m, 3) - self._origin
        footing = self._surface.footing(points, self.study.probe.radius_m)
        away = np.linalg.norm(footing.points_m - points, axis=1)
        if away.max() > OFF_SURFACE_M:
            j = int(away.argmax())
            raise InputError(
                f"point {j} at {np.round(1e3 * (points[j] + self._origin), 2).tolist()} mm is "
                f"{1e3 * away[j]:.3g} mm off the body's surface; take one of robot.surface()"
            )
        along = -footing.normals if directions is None else directions
        along = for_each("directions", along, points.shape)
        forces = for_each("force_n", force_n, (len(points),))
        plan = plan_at(self.study, footing.points_m, along, float(forces.max()))
        return replace(plan, forces_n=forces.copy())


@kinds_checked
def assert_force_kept(made: Presses | PathResult, tolerance: float = 0.01) -> None:
    """Assert that the set force was held: in every press, or in the second half of a sweep.

    Presses that cannot be made, and were left out for that, are not asked about.

    Parameters
    ----------
    tolerance : of the force, relative; of a sweep, of its mean

    Raises
    ------
    AssertionError
        It names the press, or the time, and the error.

    Examples
    --------
    >>> import palpmap as pm
    >>> robot = pm.Robot(pm.Block((0.08, 0.08, 0.04), poisson_ratio=0.45))
    >>> pm.assert_force_kept(robot.press((0.04, 0.04, 0.04), force_n=0.2))
    """
    if isinstance(made, Presses):
        unreachable = dict(made.unreachable)
        for outcome in made.outcomes:
            if outcome.press in unreachable:
                continue
            assert outcome.delivered, outcome.sentence
            assert outcome.judged is not None
            error = outcome.judged.force_error
            assert abs(error) <= tolerance, (
                f"press {outcome.press}: the held force is off by {100 * error:.2f} %"
            )
        return
    wanted = made.wanted_n
    assert wanted.any(), "this path has no set force"
    held = np.flatnonzero(wanted >= wanted.max() * (1 - 1e-9))
    held = held[int(SETTLED * len(held)) :]
    error = float((made.force_n[held] / wanted[held]).mean() - 1)
    assert abs(error) <= tolerance, (
        f"from {made.time_s[held[0]]:.1f} s on the force is off by {100 * error:.2f} %"
    )


@kinds_checked
def assert_path_clear(path: PathResult, least_m: float = 0.002) -> None:
    """Assert that the arm kept its distance from table, body and itself, and the tip met nothing.

    Raises
    ------
    AssertionError
        It names the time and the distance, or what the tip met.

    Examples
    --------
    >>> import palpmap as pm
    >>> robot = pm.Robot(pm.Block((0.08, 0.08, 0.04), poisson_ratio=0.45))
    >>> pm.assert_path_clear(robot.follow([[0.04, 0.04, 0.08], [0.06, 0.02, 0.09]]))
    """
    i = int(path.clearance_m.argmin())
    assert path.clearance_m[i] >= least_m, (
        f"at {path.time_s[i]:.2f} s the arm was {1e3 * path.clearance_m[i]:.1f} mm away from an "
        "obstacle"
    )
    if not path.wanted_n.any():
        met = [event for event in path.events if event.kind in ("touch", "force")]
        assert not met, f"at {met[0].time_s:.2f} s {met[0].text}"
