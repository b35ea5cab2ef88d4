"""Hidden effects in a scan of the robot: as far as they leave its coupled simulation alone.

Errors of the instrument are applied to the recorded rows, another modulus field or Poisson's ratio
to the pressed body. Effects of contact and response would have to act inside the exchange between
arm and body, step by step; only the bench can hide those, as well as supports, fibres and a skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np

from models import InputError, PressProgram, Scan
from sim.bench.amplitude_search import amplitude_for, size_of
from sim.bench.press import Planted, Pressed
from sim.body.soft_body import block_compliance
from sim.body.true_body import HiddenBody
from sim.motion.planner import plan_motion
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.planted.bench import Bench
from sim.planted.catalogue import HIDDEN
from sim.robot.force_control import ACCELERATION_M_PER_S2
from sim.robot.laboratory import build_laboratory
from sim.robot.simulated_arm import SERVO_RAD_PER_S
from sim.scan.scan_program import DWELL_S

SEARCH_DIVISIONS = (8, 8, 4)
"""Of the mesh on which amplitudes are searched: the size is right to about a hundredth of it."""

REPORTED = (
    "tool_compliance",
    "force_bias",
    "force_drift",
    "sensitivity_drift",
    "force_saturation",
    "contact_offset",
    "surface_tilt",
    "displacement_drift",
    "breathing",
    "outside_stick_slip",
    "outside_coarse_encoder",
    "outside_sticky_tip",
)
FIELDS = ("extra_inclusion", "stiffness_gradient", "poisson_ratio")


@dataclass(frozen=True)
class RobotPlant:
    """Effects hidden in a robot's scan.

    Attributes
    ----------
    planted : with their values
    body : the block with them in it
    records : name, category, law, values and sizes of each, as in `planted_scan`
    """

    planted: tuple[Planted, ...]
    body: HiddenBody
    records: tuple[dict[str, Any], ...]

    def report(self, scan: Scan, start_s: float) -> Scan:
        """Return one press's rows as the robot reports them.

        Force vector and pose are left out: they would reveal the hidden effects.

        Parameters
        ----------
        scan : the rows of one press
        start_s : when the scan began
        """
        if not self.planted:
            return scan
        force, travel = self._readings(scan, start_s)[-1]
        return scan.replace(
            force_n=force, displacement_m=travel, force_vector_n=None, tip_pose=None
        )

    def reached(self, scans: Sequence[Scan]) -> tuple[dict[str, Any], ...]:
        """Return `records` with the sizes that effects of the instrument have in a whole scan.

        Until the scan is made its clock is only foreseen, and so is the size of a drift.

        Parameters
        ----------
        scans : the rows of each press, before `report`
        """
        start = float(scans[0].time_s[0])
        stages = [
            np.hstack(stage)
            for stage in zip(*(self._readings(s, start) for s in scans), strict=True)
        ]
        sizes = [size_of(Pressed(*after), Pressed(*before)) for before, after in pairwise(stages)]
        return tuple(
            {**record, "size": size} if record["name"] in REPORTED else record
            for record, size in zip(self.records, sizes, strict=True)
        )

    def _readings(self, scan: Scan, start_s: float) -> list[np.ndarray]:
        """Force and travel of one press, (2, m): as they are, and after each effect."""
        peak = float(scan.force_n[scan.phase == "hold"].mean())
        scene: Any = SimpleNamespace(
            time_s=scan.time_s[None],
            begin_s=start_s,
            force_n=scan.force_n[None],
            part=np.select([scan.phase == "hold", scan.phase == "unload"], [1, 2], 0),
            points_m=scan.point_m[:1, :2],
            body=self.body,
            program=SimpleNamespace(force_n=np.array([peak])),
        )
        force, travel = scan.force_n[None], scan.displacement_m[None]
        readings = [np.vstack([force, travel])]
        for effect, values in self.planted:
            force, travel = effect.sensor(scene, force, travel, values)
            readings.append(np.vstack([force, travel]))
        return readings


def plant_on_robot(
    wanted: Sequence[tuple[str, float]], plan: ScanPlan, settings: ScanSettings, body: HiddenBody
) -> RobotPlant:
    """Draw the effects to be hidden in a robot's scan and search their amplitudes.

    Parameters
    ----------
    wanted : names and sizes, rms(with - without)/rms(without)
    plan, settings : of the scan
    body : the block without them

    Raises
    ------
    InputError
        An effect that only the bench can hide.
    """
    rng = np.random.default_rng([settings.seed, 3])
    if not wanted:
        return RobotPlant((), body, ())
    bench = Bench(program_of(plan, settings, body), body, divisions=SEARCH_DIVISIONS)
    planted: tuple[Planted, ...] = ()
    records = []
    for name, size in wanted:
        effect = HIDDEN[name]
        if name not in (*REPORTED, *FIELDS):
            raise InputError(
                f"the robot's scan cannot hide '{name}', which acts while the body yields; it can "
                f"hide {', '.join((*FIELDS, *REPORTED))}. `palpmap blind --effects {name}` can"
            )
        drawn = effect.draw(bench, rng)
        sign = float(rng.choice([-1, 1])) if effect.two_sided else 1.0
        one, reached = amplitude_for(bench, effect, drawn, size, planted, sign)
        planted = (*planted, one)
        body = effect.body(body, one[1])
        record = {"name": name, "category": effect.category, "law": effect.law}
        record |= {"values": dict(one[1]), "wanted_size": size, "size": reached}
        records.append(record)
    return RobotPlant(planted, body, tuple(records))


def program_of(plan: ScanPlan, settings: ScanSettings, body: HiddenBody) -> PressProgram:
    """Return a plan's presses as a program on the robot's clock: with the ways between as rests.

    Parameters
    ----------
    body : tells how deep the tip is at first touch and where it lets go
    """
    count = len(plan)
    same = np.ones(count)
    given = plan.program or PressProgram(
        plan.points_m[:, 0],
        plan.points_m[:, 1],
        plan.tip_radius_m * same,
        plan.force_n * same,
        settings.ramp_s * same,
        settings.hold_s * same,
        settings.unload_s * same,
        settings.pauses(count),
    )
    compliance = block_compliance(
        body, plan.points_m[:, :2], given.radius_m, divisions=SEARCH_DIVISIONS
    )
    laboratory = build_laboratory(
        plan.tip_radius_m, plan.body_size_m, plan.body_in_world, settings.timestep_s
    )
    moved = plan_motion(plan, laboratory, settings).require_all()
    transit = np.array([sum(duration for _, duration in press.waypoints) for press in moved])
    fast, slow = settings.approach_m_per_s, settings.touch_m_per_s
    speeding = fast / ACCELERATION_M_PER_S2
    lag = 2 / SERVO_RAD_PER_S
    touching = settings.slow_m + compliance * settings.touch_force_n
    approach = (settings.lift_m - settings.slow_m) / fast + speeding + touching / slow + lag
    retract = (settings.lift_m + settings.residual * given.force_n * compliance) / fast + speeding
    rest = given.pause_s + transit + approach + DWELL_S
    rest[1:] += retract[:-1]
    return replace(given, pause_s=rest)
