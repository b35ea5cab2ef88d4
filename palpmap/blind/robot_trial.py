"""Scans of blind trials by the virtual robot: hidden effects act in its loop."""

from collections.abc import Mapping, Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from models import PressProgram, Scan, read_scan
from palpmap.blind.records import TrialTruthRecord
from palpmap.study.press_plan import program_plan_of, reachable
from palpmap.study.study import Study
from palpmap.study.truth_file import Truth
from palpmap.study.virtual_lab import build_laboratory, known_of, truth_of, with_touch_error

BETWEEN_SCANS_S = 60.0


def robot_scan(
    study: Study,
    program: PressProgram,
    truth: Truth,
    seed: int,
    plant: Sequence[tuple[str, float]] = (),
) -> tuple[Scan, Study, dict[str, Any]]:
    """Let the robot make the presses of a program on a block with hidden effects.

    Parameters
    ----------
    study : the block and its tip
    truth : of the block, with the scans of it before
    seed : of noise, pauses and drawn values
    plant : effects to be hidden, with their sizes

    Returns
    -------
    the scan, what is known of it, and its truth as `sim.bench.planted_scan` tells it
    """
    from sim.motion import ScanSettings

    settings = ScanSettings(seed=seed)
    plan, motion = reachable(program_plan_of(study, program), settings)
    laboratory = build_laboratory(study, plan, settings, plant, truth, motion)
    made, scan = laboratory.press()
    known = with_touch_error(known_of(study, study.study.scan, laboratory), made)
    hidden = laboratory.hidden
    return scan, known.model_copy(update={"map": study.map, "probe": study.probe}), {
        "effects": [dict(record) for record in hidden.records],
        "body": truth.map.record(),
        "seed": seed,
        "noise": known.noise.model_dump(),
        "radii_m": sorted(set(program.radius_m.tolist())),
        "robot": True,
        "program": _columns(program),
    }  # fmt: skip


def further_robot_scan(
    study: Study, answer: TrialTruthRecord, program: PressProgram
) -> tuple[Scan, TrialTruthRecord]:
    """Let the robot press the body of a trial further, where its clock and its effects stand.

    Parameters
    ----------
    study : of the trial, with the scan of all presses so far
    answer : of the trial
    program : the further presses

    Returns
    -------
    the scan of the further presses alone, numbered on, and the answer with all presses
    """
    from sim.scan import Earlier

    earlier = PressProgram(**{name: np.array(v) for name, v in (answer.program or {}).items()})
    made = len(earlier)
    start_s = float(read_scan(study.study.scan).time_s.max()) + BETWEEN_SCANS_S
    effects = [effect.model_dump() for effect in answer.effects]
    truth = Truth(truth_of(answer.body.map), earlier=Earlier(effects, start_s, made))
    seed = int(np.random.SeedSequence([answer.seed or 0, 6, made]).generate_state(1)[0])
    scan, _, said = robot_scan(study, program, truth, seed)
    scan = scan.replace(time_s=scan.time_s + start_s, press=scan.press + made)
    said |= {"seed": answer.seed, "program": _columns(earlier.then(program, BETWEEN_SCANS_S))}
    kept = {"effects": answer.effects, "size_m": answer.size_m}
    return scan, TrialTruthRecord.model_validate({**said, **kept})


def _columns(program: PressProgram) -> Mapping[str, list[float]]:
    """Return the columns of a program that are given."""
    return {
        f.name: column.tolist()
        for f in fields(program)
        if not np.isnan(column := getattr(program, f.name)).all()
    }
