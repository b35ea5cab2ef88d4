"""Effects and faults in a scan of the robot: drawn and sized on the bench, planted in the loop."""

from __future__ import annotations

import runpy
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from models import InputError, PressProgram, Scan, nearest
from sim.bench.amplitude_search import amplitude_for
from sim.bench.press import Planted
from sim.body.soft_body import DIVISIONS, Divisions
from sim.body.true_body import HiddenBody
from sim.motion.planner import plan_motion
from sim.motion.scan_plan import ScanPlan
from sim.motion.scene import plan_scene
from sim.motion.settings import ScanSettings
from sim.planted.bench import Bench
from sim.planted.body_in_loop import Extra, LawOnBody
from sim.planted.catalogue import HIDDEN
from sim.planted.faults import FAULTS, fault
from sim.planted.instrument_in_loop import PlantScene
from sim.planted.mechanisms import FIELDS, SOLVED_ANEW, mechanism
from sim.robot.arm_steps import SERVO_RAD_PER_S
from sim.robot.force_control import ACCELERATION_M_PER_S2
from sim.robot.mechanism import Mechanism, Mechanisms
from sim.scan.scan_program import DWELL_S, TARE_S

NAMES = tuple(effect.name for effect in HIDDEN)
FILE_HOOKS = ("begin", "sensor", "encoders", "joint_torque", "body_pose", "clock")

SEARCH_DIVISIONS = (8, 8, 4)
"""Of the mesh on which amplitudes are searched: the size is right to about a hundredth of it."""


@dataclass(frozen=True)
class RobotPlant:
    """Effects and faults that act in a robot's scan.

    Attributes
    ----------
    body : the block with its changed build
    pressed : the block as its own finite elements have it; the rest of `body` is a mechanism
    records : name, category, law, values and sizes of each, as in `planted_scan`
    mechanisms : of the loop
    """

    body: HiddenBody
    pressed: HiddenBody
    records: tuple[Mapping[str, Any], ...] = ()
    mechanisms: Mechanisms = field(default_factory=Mechanisms)

    def report(self, scan: Scan) -> Scan:
        """Return rows as the robot reports them, without the columns that reveal an effect."""
        if not self.mechanisms.parts:
            return scan
        return scan.replace(force_vector_n=None, tip_pose=None)


@dataclass(frozen=True)
class Earlier:
    """Scans that were made of the same body before.

    Attributes
    ----------
    records : of the effects in them, as `RobotPlant` has them
    end_s, presses : time of the body's clock at which the next scan begins, and presses by then
    """

    records: Sequence[Mapping[str, Any]] = ()
    end_s: float = 0.0
    presses: int = 0

    @property
    def planted(self) -> tuple[Planted, ...]:
        """The effects with their values.

        Raises
        ------
        InputError
            Something that is no effect: a fault befalls presses of its own scan alone.
        """
        for record in self.records:
            if record["name"] not in NAMES:
                raise InputError(
                    f"found '{record['name']}' in the earlier scan, expected effects alone: faults "
                    "and files of hooks belong to the presses of their scan; plant them with "
                    "--plant"
                )
        return tuple((HIDDEN[one["name"]], dict(one["values"])) for one in self.records)


NONE_EARLIER = Earlier()


def refuse_plants(wanted: Sequence[tuple[str, float]]) -> None:
    """Refuse names and sizes of effects to be hidden that mean nothing, before a body is solved.

    Raises
    ------
    InputError
        A name that is not known (the nearest one is said, or all), or a size out of range.
    """
    known = (*NAMES, *FAULTS)
    for one in wanted:
        if not (isinstance(one, tuple | list) and len(one) == 2):
            raise InputError(
                f"plant: found {one!r}, expected a name and a size, such as ('force_drift', 0.03)"
            )
        name, size = one
        if name.endswith(".py"):
            continue
        if name not in known:
            cure = nearest(name, known) or f"; there are {', '.join(known)}"
            raise InputError(
                f"no effect or fault '{name}'{cure}, or give a file of hooks that ends with .py"
            )
        if not 0 < size <= 1:
            raise InputError(
                f"size of the planted '{name}': found {size:g}, expected a share of the signal or "
                "of the presses above 0 and up to 1, such as 0.03 for 3 %"
            )


def plant_on_robot(
    wanted: Sequence[tuple[str, float]],
    plan: ScanPlan,
    settings: ScanSettings,
    body: HiddenBody,
    earlier: Earlier = NONE_EARLIER,
) -> RobotPlant:
    """Draw the effects to be hidden in a robot's scan and search their amplitudes.

    Parameters
    ----------
    wanted : names and sizes. Of an effect the size is rms(with - without)/rms(without), reached to
        about a tenth, as clock and control of the robot are only foreseen; of a fault
        (`sim.planted.faults.FAULTS`) the share of presses that it befalls; of a file of hooks (.py)
        it has no meaning
    plan, settings : of the scan
    body : the body without them
    earlier : scans whose effects act again, with the same values

    Raises
    ------
    InputError
        A name that is not known, a file that cannot be used, a fault in an earlier scan; on a body
        that is no block, an effect for which the body would have to be solved anew.
    """
    if not (wanted or earlier.records):
        return RobotPlant(body, body)
    refuse_plants(wanted)
    for name in (*(name for name, _ in wanted), *(one["name"] for one in earlier.records)):
        if body.solved is not None and name in SOLVED_ANEW:
            raise InputError(
                f"found '{name}' to be planted in a body that is no block; an effect of the body's "
                "build is planted in blocks alone: leave it out, or plant one of the instrument, "
                "of the body's answer in time, or a fault"
            )
    effects = [(name, size) for name, size in wanted if name in NAMES]
    planted, drawn = _drawn(effects, plan, settings, body, earlier.planted)
    records = [*earlier.records, *drawn]
    mechanisms = list(mechanisms_of(planted, plan, settings, body, earlier.end_s, earlier.presses))
    rng = np.random.default_rng([settings.seed, 4])
    for name, size in wanted:
        if name in NAMES:
            continue
        if name.endswith(".py"):
            mechanisms.append(mechanism_of_file(name))
            records.append({"name": name, "category": "file", "law": "", "values": {}})
        else:
            count = max(round(size * len(plan)), 1)
            presses = {int(j) for j in rng.choice(len(plan), count, replace=False)}
            mechanisms.append(fault(name, settings.seed, presses))
            values = {f"press_{i}": float(j) for i, j in enumerate(sorted(presses))}
            records.append({"name": name, "category": "fault", "law": "", "values": values})
    pressed = body
    for effect, values in planted:
        body = effect.body(body, values)
        pressed = effect.body(pressed, values) if effect.name in FIELDS else pressed
    return RobotPlant(body, pressed, tuple(records), Mechanisms(tuple(mechanisms)))


def mechanisms_of(
    planted: Sequence[Planted],
    plan: ScanPlan,
    settings: ScanSettings,
    body: HiddenBody,
    start_s: float = 0.0,
    presses_before: int = 0,
    divisions: Divisions = DIVISIONS,
) -> tuple[Mechanism, ...]:
    """Return drawn effects as mechanisms, each on the body as those before it have left it.

    Parameters
    ----------
    planted : effects with their values
    plan, settings, body : of the scan, the block without them
    start_s, presses_before : of a body that was pressed before, see `PlantScene`
    divisions : of the mesh on which the effects' own shares are solved
    """
    if not planted:
        return ()
    program = _given(plan, settings)
    directions = plan.body_in_world.vectors_to_world(plan.directions)
    made = []
    for effect, values in planted:
        scene = PlantScene(
            Bench(program, body, divisions=divisions), directions, start_s, presses_before
        )
        made.append(mechanism(effect.name, scene, values))
        body = effect.body(body, values)
    return tuple(made)


def _drawn(
    wanted: Sequence[tuple[str, float]],
    plan: ScanPlan,
    settings: ScanSettings,
    body: HiddenBody,
    planted: tuple[Planted, ...],
) -> tuple[tuple[Planted, ...], list[dict[str, Any]]]:
    """Draw values and search amplitudes on the bench, beside effects that are planted already."""
    if not wanted:
        return planted, []
    rng = np.random.default_rng([settings.seed, 3])
    bench = Bench(program_of(plan, settings, body), body, divisions=SEARCH_DIVISIONS)
    records = []
    for name, size in wanted:
        effect = HIDDEN[name]
        drawn = effect.draw(bench, rng)
        sign = float(rng.choice([-1, 1])) if effect.two_sided else 1.0
        # The error of a mesh has its size on the mesh on which it acts
        meant = replace(bench, divisions=DIVISIONS) if name == "mesh_error" else bench
        one, reached = amplitude_for(meant, effect, drawn, size, planted, sign)
        planted = (*planted, one)
        record = {"name": name, "category": effect.category, "law": effect.law}
        record |= {"values": dict(one[1]), "wanted_size": size, "size": reached}
        records.append(record)
    return planted, records


def mechanism_of_file(path: str) -> Mechanism:
    """Read a mechanism from a Python file: functions with the names of hooks.

    Known are `begin(press)`, `sensor(t, wrench)`, `encoders(t, q)`, `joint_torque(t, q)`,
    `body_pose(t, press)`, `advance(t, force)` (travel in m that the body yields beside its own) and
    `clock(t)`, as in `sim.robot.mechanism.Mechanism`.

    Raises
    ------
    InputError
        A file that is missing, cannot be run or has no hook.
    """
    try:
        names = runpy.run_path(path)
    except OSError as error:
        raise InputError(f"{path}: cannot be read ({error.strerror}); check the path") from error
    except Exception as error:
        raise InputError(f"{path}: fails with {type(error).__name__}: {error}") from error
    hooks: dict[str, Any] = {name: names[name] for name in FILE_HOOKS if callable(names.get(name))}
    if not hooks and not callable(names.get("advance")):
        raise InputError(
            f"{path}: found no function of a hook, expected one of {', '.join(FILE_HOOKS)}, "
            "advance; see docs/tutorials/robot.md"
        )
    if "begin" in hooks:
        begin = hooks["begin"]
        hooks["begin"] = lambda press, time_s: begin(press)
    if callable(names.get("advance")):
        part = Extra(names["advance"])
        hooks["body"] = lambda below: LawOnBody(below, part)
    return Mechanism(path, **hooks)


def _given(plan: ScanPlan, settings: ScanSettings) -> PressProgram:
    """Return a plan's presses with the rests that were asked for."""
    count = len(plan)
    same = np.ones(count)
    return plan.program or PressProgram(
        plan.points_m[:, 0],
        plan.points_m[:, 1],
        plan.radii_m * same,
        plan.force_n * same,
        settings.ramp_s * same,
        np.array([settings.hold_of(plan.force_of(press)) for press in range(count)]),
        settings.unload_s * same,
        settings.pauses(count),
    )


def program_of(plan: ScanPlan, settings: ScanSettings, body: HiddenBody) -> PressProgram:
    """Return a plan's presses as a program on the robot's clock: with the ways between as rests.

    Parameters
    ----------
    body : tells how deep the tip is at first touch and where it lets go
    """
    given = _given(plan, settings)
    bench = Bench(given, body, divisions=SEARCH_DIVISIONS)
    moved = plan_motion(plan, plan_scene(plan, settings), settings).require_all()
    transit = np.array([sum(duration for _, duration in press.waypoints) for press in moved])
    fast, slow = settings.approach_m_per_s, settings.touch_m_per_s
    speeding = fast / ACCELERATION_M_PER_S2
    lag = 2 / SERVO_RAD_PER_S
    felt = np.full(len(plan), settings.touch_force_n)
    touching = settings.slow_m + bench.depth_m(felt)
    approach = (settings.lift_m - settings.slow_m) / fast + speeding + touching / slow + lag
    left = bench.depth_m(settings.residual * given.force_n)
    retract = (settings.lift_m + left) / fast + speeding
    rest = np.maximum(given.pause_s, TARE_S) + transit + approach + DWELL_S
    rest[1:] += retract[:-1]
    return replace(given, pause_s=rest)
