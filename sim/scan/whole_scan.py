"""A whole scan: the presses of a plan one after another, and what became of each."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence

from sim.motion.depth_check import beyond_limits
from sim.motion.planned_motion import Motion, Refusal, refuse
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
    on_outcome : called for every planned press with what became of it, first for those that
        `motion` has refused
    mechanisms : that act in the loop, unknown to the robot
    motion : of the plan, where it is known already; presses that it has refused are no longer in
        the plan

    Raises
    ------
    InputError
        Before the arm moves: no press can be made for the arm's reach (see `sim.motion.planner`),
        its force or its depth; or some cannot, and `on_fault` is "stop".
    """
    settings = settings or ScanSettings()
    started = time.perf_counter()
    beyond = beyond_limits(plan, soft_body, settings)
    refuse(beyond, len(plan), settings.on_fault != "stop")
    program = Program(plan, soft_body, settings, on_frame, mechanisms or Mechanisms(), motion)
    unreachable = motion.refused if motion else ()
    return make_presses(program, unreachable, beyond, on_press, on_outcome, started)


def make_presses(
    program: Program,
    unreachable: Sequence[Refusal],
    beyond: Sequence[Refusal],
    on_press: Callable[[PressResult], None] | None,
    on_outcome: Callable[[PressOutcome], None] | None,
    started: float,
) -> ScanRun:
    """Make the presses of a program.

    Parameters
    ----------
    unreachable : presses that are not in the program
    beyond : presses of the program that are left out
    on_press, on_outcome : see `run_scan`
    started : when the computation began
    """
    results, outcomes = [], []
    for outcome, result in _outcomes(program, unreachable, beyond):
        outcomes.append(outcome)
        if result:
            results.append(result)
            if on_press:
                on_press(result)
        if on_outcome:
            on_outcome(outcome)
    return ScanRun(
        tuple(results),
        program.time_s,
        time.perf_counter() - started,
        program.rig.peak_torque,
        tuple(outcomes),
    )


def _outcomes(
    program: Program, unreachable: Sequence[Refusal], beyond: Sequence[Refusal]
) -> Iterator[tuple[PressOutcome, PressResult | None]]:
    """Yield the outcome of each planned press, and the result of one that is made."""
    for one in unreachable:
        yield PressOutcome(one.press, "skipped", one.force_n, reason=one.reason), None
    plan, left_out, stopped = program.plan, {one.press: one for one in beyond}, ""
    for number, planned in enumerate(program.presses):
        name = int(plan.ids[number])
        if stopped:
            yield PressOutcome(name, "skipped", plan.force_of(number), reason=stopped), None
        elif name in left_out:
            program.pass_by(number, planned)
            one = left_out[name]
            yield PressOutcome(name, "skipped", one.force_n, reason=one.reason), None
        else:
            outcome, result = program.press(number, planned)
            yield outcome, result
            if not outcome.delivered and program.settings.on_fault == "stop":
                stopped = f"the scan was stopped after press {name}"
