"""Hidden effects in a scan of the robot: as far as they leave its coupled simulation alone.

What the instrument reports wrongly is done to the recorded rows, and another modulus field or
Poisson's ratio to the body that the robot presses. Effects of contact and response would have to
act inside the exchange between arm and body, step by step; those the bench alone can hide, as well
as supports, fibres and a skin.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from types import SimpleNamespace
from typing import Any

import numpy as np

from models.errors import InputError
from models.scan import Scan
from sim.bench import Bench, Planted
from sim.hidden.amplitude import amplitude_for
from sim.hidden.catalogue import hidden_effect
from sim.hidden_body import HiddenBody
from sim.press_program import PressProgram, random_pauses
from sim.scan_plan import ScanPlan
from sim.settings import ScanSettings

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

        Force vector and pose are left out: they would say what the columns hide.

        Parameters
        ----------
        scan : the rows of one press
        start_s : when the scan began
        """
        if not self.planted:
            return scan
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
        for effect, values in self.planted:
            force, travel = effect.sensor(scene, force, travel, values)
        return scan.replace(
            force_n=force[0], displacement_m=travel[0], force_vector_n=None, tip_pose=None
        )


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
    bench = Bench(program_of(plan, settings), body, divisions=SEARCH_DIVISIONS)
    planted: tuple[Planted, ...] = ()
    records = []
    for name, size in wanted:
        effect = hidden_effect(name)
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


def program_of(plan: ScanPlan, settings: ScanSettings) -> PressProgram:
    """Return a plan's presses as a program."""
    if plan.program is not None:
        return plan.program
    count = len(plan)
    same = np.ones(count)
    return PressProgram(
        plan.points_m[:, 0],
        plan.points_m[:, 1],
        plan.tip_radius_m * same,
        plan.force_n * same,
        settings.ramp_s * same,
        settings.hold_s * same,
        settings.unload_s * same,
        random_pauses(count, settings.seed),
    )
