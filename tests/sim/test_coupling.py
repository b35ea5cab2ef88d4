"""Contact and soft body agree, from very soft to hard, for linear and stiffening laws."""

import re
from dataclasses import replace

import numpy as np
import pytest

from models.errors import InputError
from models.press_program import grid_program
from sim.body.soft_body import SoftBody
from sim.body.true_map import Inclusion, TruthMap
from sim.motion.depth_check import beyond_limits
from sim.motion.scan_plan import ScanPlan, program_plan
from sim.motion.settings import ScanSettings
from sim.motion.tip import Tip
from sim.robot.force_control import rounded_line
from sim.robot.laboratory import build_laboratory
from sim.scan.whole_scan import run_scan
from tests.long import long

SIZE = (0.096, 0.096, 0.048)
POINTS = np.array([[0.030, 0.041, 0.048], [0.052, 0.060, 0.048]])
DOWN = np.tile([0.0, 0.0, -1.0], (2, 1))
SHORT = {"hold_s": 1.0, "pause_s": (0.05, 0.05)}


def body_of(scale):
    """The standard body with its modulus scaled."""
    truth = TruthMap(6000 * scale, (Inclusion(12000 * scale, (0.05, 0.06, 0.03), 0.012),))
    return SoftBody(SIZE, truth, 0.49, 0.005, POINTS, DOWN, divisions=(6, 6, 3))


@pytest.fixture(scope="module")
def local_stiffness():
    """Of the first press on the unscaled body, N/m."""
    return body_of(1.0).tangent(0, 0.0)


class Stiffening:
    """Closed-form law F = k1 u + k3 u^3."""

    def __init__(self, k1, k3):
        self.k1, self.k3 = k1, k3

    def displacement(self, press, force_n):
        roots = np.roots([self.k3, 0, self.k1, -force_n])
        return float(roots[np.abs(roots.imag).argmin()].real)

    def tangent(self, press, force_n):
        return self.k1 + 3 * self.k3 * self.displacement(press, force_n) ** 2


@pytest.mark.parametrize(
    ("stiffness", "force"),
    [(50, 0.25), (100_000, 3), *long((400, 0.25), (5000, 0.25), (20_000, 3), (20_000, 12))],
)
def test_presses_settle_from_50_to_100_000_newton_a_metre(local_stiffness, stiffness, force):
    body = body_of(stiffness / local_stiffness)
    assert body.tangent(0, 0.0) == pytest.approx(stiffness)
    run = run_scan(ScanPlan(POINTS, DOWN, force), body, ScanSettings(**SHORT))
    for press in run.statistics:
        assert abs(press.force_error) < 0.01
        assert press.overshoot < 0.05
        assert press.coupling_error < 1e-3
        assert press.contact_error_m < 1e-5  # 0.06 mm a newton if the servo were left to give way


def test_a_small_force_on_a_hard_body_bounces_at_touch_down_and_still_settles(local_stiffness):
    body = body_of(100_000 / local_stiffness)
    run = run_scan(ScanPlan(POINTS, DOWN, 0.25), body, ScanSettings(**SHORT))
    assert all(abs(press.force_error) < 0.01 for press in run.statistics)
    assert all(press.coupling_error < 1e-3 for press in run.statistics)


@pytest.mark.parametrize(("k1", "k3", "force"), [(60, 1e7, 0.25), (300, 3e8, 3.0)])
def test_a_stiffening_body_is_met_on_its_own_law(k1, k3, force):
    settings = ScanSettings(force_noise_n=0, displacement_noise_m=0, **SHORT)
    run = run_scan(ScanPlan(POINTS, DOWN, force), Stiffening(k1, k3), settings)
    for press in run.statistics:
        assert abs(press.force_error) < 0.01
        assert press.coupling_error < 1e-3
        assert press.fem_calls > 20


def test_every_sample_lies_on_the_law_also_while_the_tip_moves():
    body = body_of(1.0)
    settings = ScanSettings(force_noise_n=0, displacement_noise_m=0, **SHORT)
    run = run_scan(ScanPlan(POINTS, DOWN), body, settings)
    for press in run.presses:
        own = [body.displacement(press.statistics.press, f) for f in press.true_force_n]
        np.testing.assert_allclose(press.true_displacement_m, own, atol=1e-6)


@pytest.mark.parametrize("guess", [20.0, 150.0, 1500.0])
def test_a_wrong_guess_of_the_stiffness_does_no_harm(guess):
    settings = ScanSettings(stiffness_n_per_m=guess, **SHORT)
    first = run_scan(ScanPlan(POINTS, DOWN), body_of(1.0), settings).statistics[0]
    assert abs(first.force_error) < 0.01
    assert first.overshoot < 0.05


def test_three_newton_press_the_soft_body_deep_without_falling_through():
    body = body_of(1.0)
    run = run_scan(ScanPlan(POINTS, DOWN, 3.0), body, ScanSettings(deepest_share=0.7, **SHORT))
    depth = [body.displacement(j, 3.0) for j in (0, 1)]
    assert depth[0] > 0.02
    found = [press.true_displacement_m.max() for press in run.presses]
    np.testing.assert_allclose(found, depth, rtol=0.02)
    assert max(press.contact_error_m for press in run.statistics) < 1e-5


@pytest.mark.parametrize(
    ("scale", "setting", "reason"),
    [
        (1.0, {}, "the body is 48 mm thick there, of which at most 50 %"),
        (0.2, {"depth_m": 0.02}, "the scan setting depth_m provides for 20 mm"),
    ],
)
def test_a_press_that_would_go_too_deep_is_refused_with_the_force_that_would_do(
    scale, setting, reason
):
    body, settings = body_of(scale), ScanSettings(on_fault="stop", **setting, **SHORT)
    with pytest.raises(InputError, match=rf"Press 0 at .*3 N would go .*{reason}") as caught:
        run_scan(ScanPlan(POINTS, DOWN, 3.0), body, settings)
    enough = float(re.search(r"at most ([0-9.]+) N", str(caught.value))[1])  # pyright: ignore[reportOptionalSubscript]
    for more, refused in ((1.0, False), (1.02, True)):
        plan = ScanPlan(POINTS, DOWN, more * enough)
        assert (0 in {one.press for one in beyond_limits(plan, body, settings)}) == refused


@pytest.mark.parametrize(("force", "ramp"), [(0.3, 0.05), (3.0, 1.0), (3.0, 0.3)])
def test_the_joints_keep_to_their_limits_of_acceleration_also_where_the_tip_goes_far(force, ramp):
    settings = ScanSettings(deepest_share=0.7, ramp_s=ramp, unload_s=ramp, **SHORT)
    run = run_scan(ScanPlan(POINTS, DOWN, force), body_of(1.0), settings)
    limits = build_laboratory()
    speed = np.diff(run.series.q, axis=0) / settings.timestep_s
    acceleration = np.diff(speed, axis=0) / settings.timestep_s
    assert (np.abs(speed) < limits.speed_limit).all()
    assert (np.abs(acceleration) < 0.6 * limits.acceleration_limit).all()
    for press in run.statistics:
        assert abs(press.force_error) < 0.01
        assert press.overshoot < 0.1  # 0.47 where such a ramp is not made longer


def test_a_line_that_is_rounded_ends_at_one_and_is_as_fast_as_it_says():
    for length, duration in ((0.01, 1.0), (0.05, 0.2), (0.0, 1.0)):
        line = rounded_line(length, duration, 0.25)
        time = np.linspace(0, line.duration_s, 2001)
        way, rate = np.transpose([line.at(t) for t in time])
        np.testing.assert_allclose(way[[0, -1]], [0, 1], atol=1e-12)
        np.testing.assert_allclose(np.gradient(way, time)[2:-2], rate[2:-2], atol=2e-3 * rate.max())
        assert np.abs(np.diff(rate) / np.diff(time) * length).max() < 0.25 * (1 + 1e-6)


def test_every_press_of_a_program_is_judged_by_its_own_force_and_thickness():
    thin, plan = (0.096, 0.096, 0.004), grid_program((0.096, 0.096, 0.004), per_side=2)
    force = np.array([0.1, 0.1, 0.3, 0.1])
    law = Stiffening(60, 0)
    program = program_plan(replace(plan, force_n=force), thin)
    match = r"Press 2 at .*0.3 N would go 5 mm deep; the body is 4 mm"
    with pytest.raises(InputError, match=match):
        run_scan(program, law, ScanSettings(on_fault="stop"))
    ids = np.array([3, 4, 6, 8])  # others were left out before
    run = run_scan(replace(program, press_ids=ids), law, ScanSettings(**SHORT))
    assert [o.press for o in run.outcomes] == ids.tolist()
    assert [o.outcome for o in run.outcomes] == ["made", "made", "skipped", "made"]
    assert "0.3 N would go 5 mm deep" in run.outcomes[2].reason
    assert [s.press for s in run.statistics] == run.scan.press_ids.tolist() == [3, 4, 8]


def test_a_ball_that_would_sink_in_whole_and_a_press_near_touch_are_refused():
    tips = (Tip("ball", 0.003), Tip("ball", 0.008))
    plan = ScanPlan(POINTS, DOWN, tips=tips, forces_n=np.array([0.25, 0.04]))
    sunk, weak = beyond_limits(plan, Stiffening(60, 0), ScanSettings())
    assert "0.25 N would go 4.17 mm deep; the ball would sink in whole" in sunk.reason
    assert "Press with at most 0.178 N" in sunk.reason
    assert "touch force of 0.025 N is more than half of the set force of 0.04 N" in weak.reason


class Softening(Stiffening):
    """A body that is ten times as soft as it said once it has been asked about every press."""

    asked = 0

    def displacement(self, press, force_n):
        self.asked += 1
        return force_n / self.k1 * (1 if self.asked <= len(POINTS) else 10)

    def tangent(self, press, force_n):
        return self.k1 / 10


def test_a_press_that_goes_deeper_than_the_plan_provides_for_is_broken_off():
    plan = ScanPlan(POINTS, DOWN, 3.0)
    for depth, limit in ((0.02, "20"), (0.2, "48")):  # the table lies 48 mm below the surface
        run = run_scan(plan, Softening(200, 0), ScanSettings(depth_m=depth))
        assert [o.outcome for o in run.outcomes] == ["aborted", "aborted"]
        assert run.presses == ()
        for outcome in run.outcomes:
            assert outcome.faults[0].kind == "travel"
            assert f"the limit is {limit} mm; press with less force" in outcome.reason
            assert outcome.peak_force_n < 3.0
