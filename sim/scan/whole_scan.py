"""A whole scan: the presses of a plan one after another, and what became of each."""

from __future__ import annotations

import time
from collections.abc import Callable

from models import InputError
from sim.motion.depth_check import refuse_too_deep
from sim.motion.planned_motion import Motion
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.contact_coupling import PressedBody
from sim.robot.mechanism import Mechanisms
from sim.scan.outcome import PressOutcome
from sim.scan.result import Frame, PressResult, ScanRun
from sim.scan.scan_program import Program


def run_scan(
    plan: ScanPlan,
    soft_body: PressedBody,
    settings: ScanSettings | None = None,
    on_frame: Callable[[Frame], None] | None = None,
    on_press: Callable[[PressResult], None] | None = None,
    on_outcome: Callable[[PressOutcome], None] | None = None,
    mechanisms: Mechanisms | None = None,
    motion: Motion | None = None,
) -> ScanRun:
    """Plan and make all presses of a scan; a press that fails does not end it.

    Parameters
    ----------
    plan : where, in which direction and how hard to press
    soft_body : answers the contact forces; its press j is the plan's press j
    settings : times, speeds, noise, sampling, and what follows a fault
    on_frame : called at `settings.frames_per_s` of simulated time
    on_press : called after each press with its result. A scan that is broken off (also by
        KeyboardInterrupt, which is passed on) has delivered all presses finished so far.
    on_outcome : called for every planned press with what became of it
    mechanisms : that act in the loop, unknown to the robot
    motion : of the plan, where it is known already

    Raises
    ------
    InputError
        Before the arm moves: a press that cannot be made, or would go too deep (see
        `sim.motion.planner`). At the end: no press was made at all.
    """
    settings = settings or ScanSettings()
    started = time.perf_counter()
    refuse_presses(plan, soft_body, settings)
    program = Program(plan, soft_body, settings, on_frame, mechanisms or Mechanisms(), motion)
    return make_presses(program, on_press, on_outcome, started)


def make_presses(
    program: Program,
    on_press: Callable[[PressResult], None] | None,
    on_outcome: Callable[[PressOutcome], None] | None,
    started: float,
) -> ScanRun:
    """Make all presses of a program; `started` is when the computation began."""
    plan, settings = program.plan, program.settings
    results, outcomes = [], []
    for number, planned in enumerate(program.presses):
        outcome, result = program.press(number, planned)
        outcomes.append(outcome)
        if result:
            results.append(result)
            if on_press:
                on_press(result)
        if on_outcome:
            on_outcome(outcome)
        if not outcome.delivered and settings.on_fault == "stop":
            break
    for number in range(len(outcomes), len(plan)):
        why = f"the scan was stopped after press {len(outcomes) - 1}"
        left = PressOutcome(number, "skipped", plan.force_of(number), reason=why)
        outcomes.append(left)
        if on_outcome:
            on_outcome(left)
    return ScanRun(
        tuple(results),
        program.time_s,
        time.perf_counter() - started,
        program.rig.peak_torque,
        tuple(outcomes),
    )


def refuse_presses(plan: ScanPlan, body: PressedBody, settings: ScanSettings) -> None:
    """Raise `InputError` for forces near that of touch, and presses that would go too deep."""
    weakest = min(plan.force_of(press) for press in range(len(plan)))
    if settings.touch_force_n > 0.5 * weakest:
        raise InputError(
            f"The touch force of {settings.touch_force_n:g} N is more than half of the set "
            f"force of {weakest:g} N; press harder or lower touch_force_n."
        )
    refuse_too_deep(plan, body, settings)
