"""Each planted effect, stepped through the robot's loop, is what its formula on arrays says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from models.press_program import grid_program
from sim.body.true_body import HiddenBody
from sim.motion.scan_plan import program_plan
from sim.motion.settings import ScanSettings
from sim.planted.bench import Bench
from sim.planted.catalogue import HIDDEN
from sim.planted.effect import HiddenEffect
from sim.planted.mechanisms import FIELDS
from sim.robot.mechanism import Mechanisms
from sim.scan.plant_on_robot import mechanisms_of
from sim.scan.result import PHASES
from sim.scan.whole_scan import run_scan
from tests.long import long

COARSE = (5, 5, 3)
SIZE = (0.096, 0.096, 0.048)
QUIET = ScanSettings(force_noise_n=0.0, displacement_noise_m=0.0)
UNLOAD = PHASES.index("unload")
LOAD = PHASES.index("load")

COUPLING = 0.0015
"""Of the signal: how well force and depth of arm and body agree while they move."""

TOLERANCE = {"form_fat_loop": 0.04}  # a corner with an infinite slope at the turn
"""Largest difference to the formula, of the effect's own largest; 2 % for all others."""

AS_TYPICAL = (
    "force_saturation", "time_lag", "filtered_force", "form_guide_friction", "form_fat_loop",
    "free_loop", "form_full_range_sensor", "form_twice_filtered_force", "form_averaged_force",
    "form_loaded_amplifier", "hysteresis",
)  # fmt: skip
"""Three times as much of them is a fault that the watchdogs see, or hardly a monotonic law."""

OWN_TOUCH = (
    "breathing_from_touch", "breathing_harmonics_from_touch", "creep_recovery",
    "form_recovering_creep",
)  # fmt: skip
"""Their travel counts from the touch as the robot finds it: compared but for a constant a press."""

APART = ("outside_coarse_encoder", "outside_stick_slip", "guide_friction", "backlash")
"""Laws with jumps, which no difference to a formula can bound: they have tests of their own."""


class Compliant:
    def __init__(self, compliance):
        self.compliance = compliance

    def displacement(self, press, force_n):
        return float(self.compliance[press]) * force_n

    def tangent(self, press, force_n):
        return 1 / float(self.compliance[press])


class FromApproach(Bench):
    """A bench whose session begins with the first approach, as the arm's does."""

    @property
    def begin_s(self):
        return 0.0


@pytest.fixture(scope="module")
def scene():
    program = grid_program(SIZE, per_side=2, seed=4)
    program = replace(program, ramp_s=0.5 + 0 * program.ramp_s, hold_s=0.6 + 0 * program.hold_s)
    keep = {n: getattr(program, n)[:3] for n in program.__dataclass_fields__}
    program = type(program)(**keep)
    return program, program_plan(program, SIZE), Bench(program, HiddenBody(), divisions=COARSE)


def values_of(bench, effect):
    drawn = effect.draw(bench, np.random.default_rng(3))
    if effect.name == "outside_slipped_presses":
        drawn = {"press_0": 1.0, "press_1": 2.0}
    if effect.name == "skin_layer":
        drawn["thickness_m"] = 2.4e-3  # a thinner one has many small cells
    if "session_s" in drawn:
        drawn["session_s"] = 200.0  # as of a scan of some size
    if effect.name == "preconditioning_nearby":
        drawn["reach_m"] = 0.05  # to the neighbour of this wide grid
    if "time_constant_s" in drawn and effect.name == "force_warm_up":
        drawn["time_constant_s"] = 60.0
    times = 1 if effect.name in AS_TYPICAL else 3
    return {**drawn, effect.amplitude: min(times * effect.typical, effect.limit)}


def made(scene, effect, values):
    """Robot's samples in contact: bench with the arm's own times and forces, force, travel."""
    program, plan, bench = scene
    body = Compliant(bench.compliance())
    planted = mechanisms_of([(effect, values)], plan, QUIET, bench.body, divisions=COARSE)
    run = run_scan(plan, body, QUIET, mechanisms=Mechanisms(planted))
    assert [o.outcome for o in run.outcomes] == ["made"] * len(plan), run.outcomes
    rows = []
    for press in run.presses:
        s = press.series
        touching = (s.true_force_n > 0) & (s.phase <= UNLOAD)
        rows.append((s, np.flatnonzero(touching)[0], np.flatnonzero(s.phase == UNLOAD)[-1] + 1))
    length = min(end - begin for _, begin, end in rows)
    picked = [(s, slice(begin, begin + length)) for s, begin, end in rows]
    first = run.presses[0].series
    origin = first.time_s[(first.phase == PHASES.index("approach")).argmax()]

    def column(name):
        return np.array([getattr(s, name)[part] for s, part in picked])

    own = FromApproach(program, bench.body, divisions=COARSE)
    time = column("time_s") - origin
    own.__dict__["time_s"] = time
    own.__dict__["within_s"] = time - time[:, :1]
    own.__dict__["force_n"] = column("true_force_n")
    own.__dict__["part"] = np.where(column("phase")[0] == UNLOAD, 2, 0)
    return own, column


def formula(bench, effect, values):
    """Force and travel by the effect's own functions on arrays."""
    body = effect.body(bench.body, values)
    force = bench.force_n
    travel = bench.compliance(body=body)[:, None] * force
    travel = effect.contact(bench, travel, values)
    travel = effect.response(bench, travel, values)
    return effect.sensor(bench, force, travel, values)


def error_of(scene, name):
    """Largest difference to the formula beyond the coupling's, of the most that the effect does."""
    effect = HIDDEN[name]
    values = values_of(scene[2], effect)
    bench, column = made(scene, effect, values)
    if name == "outside_sticky_tip":  # its formula goes by the force that the body bears
        bench.__dict__["force_n"] = column("true_depth_m") / bench.compliance()[:, None]
    plain = bench.force_n, bench.compliance()[:, None] * bench.force_n
    told = formula(bench, effect, values)
    contact = np.isfinite(column("displacement_m"))
    by_robot = effect.sensor is not HiddenEffect.sensor
    seen = column("force_n"), column("displacement_m" if by_robot else "true_depth_m")
    errors = []
    for with_it, without, found in zip(told, plain, seen, strict=True):
        change, signal = (np.abs(x)[contact].max() for x in (with_it - without, without))
        if change > 1e-3 * signal:
            off = np.where(contact, found - with_it, np.nan)
            if name in OWN_TOUCH:
                off = off - np.nanmedian(off, axis=1, keepdims=True)
            off = np.nanmax(np.abs(off))
            errors.append(max(off - COUPLING * signal, 0.0) / change)
    assert errors, "the effect does nothing here"
    return max(errors)


ACTING = [effect.name for effect in HIDDEN if effect.name not in (*FIELDS, *APART)]
SOME = ("viscoelasticity", "play", "force_drift", "breathing", "tool_compliance", "skin_layer")


@pytest.mark.parametrize("name", SOME)
def test_a_mechanism_in_the_loop_does_what_its_formula_says(scene, name):
    assert error_of(scene, name) < TOLERANCE.get(name, 0.02)


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in ACTING if name not in SOME])
def test_every_mechanism_in_the_loop_does_what_its_formula_says(scene, name):
    assert error_of(scene, name) < TOLERANCE.get(name, 0.02)


def test_a_worn_encoder_reads_whole_steps(scene):
    effect = HIDDEN["outside_coarse_encoder"]
    _, column = made(scene, effect, {"step_m": 4e-4})
    travel = column("displacement_m")
    for press in travel:
        read = press[np.isfinite(press)]
        steps = (read - read[0]) / 4e-4
        assert np.abs(steps - np.round(steps)).max() < 0.02
        assert np.ptp(np.round(steps)) > 8


def test_a_tip_that_sticks_and_slips_jumps_at_each_step(scene):
    effect = HIDDEN["outside_stick_slip"]
    values = {"height_m": 2e-4, "step_m": 1e-3}
    bench, column = made(scene, effect, values)
    elastic = bench.compliance()[:, None] * bench.force_n
    behind = elastic - column("true_depth_m")
    assert behind.min() > -1e-4
    assert behind.max() < 3e-4
    within = np.mod(elastic / 1e-3, 1)
    settled = (within > 0.2) & (within < 0.8)
    assert np.median(np.abs(behind - 2e-4 * within)[settled]) < 1e-5


@pytest.mark.parametrize("name", ["backlash", *long("guide_friction")])
def test_what_turns_with_the_way_is_as_its_formula_before_and_after_the_turn(scene, name):
    effect = HIDDEN[name]
    size = 0.7 * effect.typical  # of more friction the robot, which has no noise here, tells itself
    bench, column = made(scene, effect, values := {effect.amplitude: size})
    force, travel = formula(bench, effect, values)
    phase = column("phase")
    turned = bench.force_n < 0.9 * bench.force_n.max(axis=1, keepdims=True)
    way = ((phase == LOAD) | (phase == UNLOAD)) & turned & (bench.force_n > 0.05)
    assert way.sum() > 200
    if name == "backlash":  # but for the constant of the robot's own first touch
        off = np.where(way, column("displacement_m") - travel, np.nan)
        off = np.abs(off - np.nanmedian(off, axis=1, keepdims=True))
    else:
        off = np.abs(np.where(way, column("force_n") - force, np.nan))
    assert np.nanpercentile(off, 95) < 0.25 * size


def test_every_planted_effect_has_a_mechanism(scene):
    _, plan, bench = scene
    for effect in HIDDEN:
        values = values_of(bench, effect)
        planted = mechanisms_of([(effect, values)], plan, QUIET, bench.body, divisions=COARSE)
        assert planted[0].name == effect.name
