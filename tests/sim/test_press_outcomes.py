"""A press that fails is broken off, told and left out; the scan goes on."""

# mujoco is a compiled module without type stubs
# pyright: reportAttributeAccessIssue=false

from dataclasses import replace

import mujoco
import numpy as np
import pytest

from models.scan_file import read_scan, write_scan
from sim.motion.scan_plan import ScanPlan
from sim.motion.settings import ScanSettings
from sim.robot.mechanism import Mechanism, Mechanisms
from sim.scan.result import PHASES
from sim.scan.whole_scan import run_scan
from tests.sim.springs import Spring

POINTS = np.array([[0.030, 0.041, 0.048], [0.040, 0.041, 0.048], [0.052, 0.050, 0.048]])
PLAN = ScanPlan(POINTS, np.tile([0.0, 0.0, -1.0], (3, 1)), 0.3)
SHORT = {"ramp_s": 0.5, "hold_s": 0.6, "unload_s": 0.5, "pause_s": (0.1, 0.1)}


class Fault:
    """A fault of the sensor in one press: from 1 s after its begin, in its first attempts."""

    def __init__(self, act, press=1, attempts=9, after_s=1.0):
        self.act, self.press, self.left, self.after = act, press, attempts, after_s
        self.start, self.on, self.kept = np.inf, False, None

    def begin(self, press, time_s):
        self.on = press == self.press and self.left > 0
        self.left -= self.on
        self.start = time_s + self.after
        self.kept = None

    def sensor(self, time_s, wrench):
        if not self.on or time_s < self.start:
            return wrench
        if self.kept is None:
            self.kept = wrench
        return self.act(wrench, self.kept)

    @property
    def mechanisms(self):
        return Mechanisms((Mechanism("fault", begin=self.begin, sensor=self.sensor),))


def scanned(mechanisms=None, body=None, **settings):
    return run_scan(
        PLAN, body or Spring(), ScanSettings(**SHORT, **settings), mechanisms=mechanisms
    )


def words(run):
    return [outcome.outcome for outcome in run.outcomes]


@pytest.mark.parametrize(
    ("kind", "act"),
    [
        ("repeated", lambda wrench, kept: kept),
        ("force", lambda wrench, kept: 0 * wrench),
        ("not_a_number", lambda wrench, kept: np.nan * wrench),
        ("cross_check", lambda wrench, kept: wrench - np.array([0, 0, 0.25, 0, 0, 0])),
        ("force", lambda wrench, kept: wrench + np.array([0, 0, 5.0, 0, 0, 0])),
    ],
)
def test_a_sensor_that_fails_in_one_press_costs_that_press_alone(kind, act):
    run = scanned(Fault(act).mechanisms)
    assert words(run) == ["made", "aborted", "made"]
    (fault,) = run.outcomes[1].faults
    assert fault.kind == kind
    assert f"{kind} ({fault.phase}): " in run.outcomes[1].sentence
    assert run.scan.press_ids.tolist() == [0, 2]
    assert all(press.judged.kept for press in run.presses)
    assert all(abs(press.force_error) < 0.01 for press in run.statistics)


def test_a_pull_on_the_cable_at_the_end_of_a_press_is_told():
    one = ScanPlan(POINTS[:1], PLAN.directions[:1], 0.9)
    series = run_scan(one, Spring(), ScanSettings(**SHORT)).presses[0].series
    let_go = float(series.time_s[series.phase == PHASES.index("unload")][-1])

    def pull(time_s, wrench):
        pulled = let_go - 0.016 < time_s < let_go + 0.07
        return wrench + 0.065 * pulled * np.eye(6)[2]

    pulls = Mechanisms((Mechanism("pull", sensor=pull),))
    run = run_scan(one, Spring(), ScanSettings(**SHORT), mechanisms=pulls)
    assert [fault.kind for fault in run.outcomes[0].faults] == ["cross_check"]


def test_a_press_is_tried_again_where_that_is_asked_for(tmp_path):
    fault = Fault(lambda wrench, kept: kept, attempts=2)
    run = scanned(fault.mechanisms, on_fault="retry")
    assert words(run) == ["made", "retried", "made"]
    assert len(run.outcomes[1].faults) == 2
    write_scan(run.scan, tmp_path / "scan.csv")
    back = read_scan(tmp_path / "scan.csv")
    assert back.outcome is not None
    assert set(back.outcome[back.press == 1]) == {"retried"}
    assert set(back.outcome[back.press != 1]) == {"made"}
    run = scanned(Fault(lambda wrench, kept: kept).mechanisms, on_fault="retry")
    assert words(run) == ["made", "aborted", "made"]
    assert len(run.outcomes[1].faults) == 3


def test_a_scan_that_shall_stop_names_the_presses_that_were_not_begun():
    run = scanned(Fault(lambda wrench, kept: kept).mechanisms, on_fault="stop")
    assert words(run) == ["made", "aborted", "skipped"]
    assert run.outcomes[2].reason == "the scan was stopped after press 1"


def test_a_sensor_that_is_dead_from_the_start_skips_the_press_without_touching():
    fault = Fault(lambda wrench, kept: 0 * wrench, press=0, after_s=0.0)
    run = scanned(fault.mechanisms)
    assert words(run) == ["skipped", "made", "made"]
    assert "repeats one value at rest" in run.outcomes[0].reason


def heavier(mass_kg):
    def change(model):
        probe = model.body("probe").id
        model.body_mass[probe] += mass_kg
        mujoco.mj_setConst(model, mujoco.MjData(model))

    return Mechanisms((Mechanism("payload", scene=change),))


def test_a_probe_that_is_heavier_than_modelled_is_tared_and_presses_as_asked():
    run = scanned(heavier(0.1))
    assert words(run) == ["made", "made", "made"]
    for press in run.presses:
        assert press.judged.tare_n == pytest.approx(-0.1 * 9.81, rel=0.02)
        assert abs(press.statistics.touch_error_m) < 3e-4
        assert abs(press.statistics.force_error) < 0.01
        assert np.abs(press.scan.force_n - press.true_force_n).max() < 0.03
    run = scanned(heavier(0.8))
    assert words(run) == ["skipped"] * 3
    assert "check the payload" in run.outcomes[0].reason


class Broken(Spring):
    """A spring that loses its stiffness above a force, in press 1."""

    def tangent(self, press, force_n):
        return 0.0 if press == 1 and force_n > 0.2 else self.stiffness


def test_a_body_without_stiffness_breaks_off_its_press_and_delivers_no_rows_of_it():
    run = scanned(body=Broken())
    assert words(run) == ["made", "aborted", "made"]
    assert run.outcomes[1].faults[0].kind == "body"
    assert np.abs(run.scan.displacement_m).max() < 0.01


def test_an_unstable_simulation_costs_its_press_alone():
    began = []

    def torque(time_s, q):
        hot = len(began) == 2 and time_s > began[1] + 1.0
        return np.full(7, 1e12 if hot else 0.0)

    shaken = Mechanism("shaken", begin=lambda press, t: began.append(t), joint_torque=torque)
    run = scanned(Mechanisms((shaken,)))
    assert words(run) == ["made", "aborted", "made"]
    assert run.outcomes[1].faults[0].kind in ("simulation", "force", "speed", "not_a_number")
    assert np.isfinite(run.scan.force_n).all()
    assert all(press.judged.kept for press in run.presses)


def test_encoders_that_are_off_show_beside_the_press_in_the_simulators_truth_alone():
    def read(time_s, q):
        return q + np.array([2e-3, 0, 0, 0, 0, 0, 0])

    run = scanned(Mechanisms((Mechanism("encoder", encoders=read),)))
    assert words(run) == ["made"] * 3
    for press in run.presses:
        assert press.judged.place_error_m < 2e-4  # the robot believes so
        assert press.statistics.contact_error_m == pytest.approx(2e-3 * 0.44, rel=0.1)


def test_a_clock_that_jumps_is_told():
    clock = Mechanism("clock", clock=lambda t: t + 0.5 * (t > 3.0))
    run = scanned(Mechanisms((clock,)))
    assert words(run).count("aborted") == 1
    assert "the written times go on by" in run.outcomes[words(run).index("aborted")].reason


@pytest.mark.slow
def test_a_body_that_sank_away_is_not_found_and_one_that_rose_is_pressed():
    def pose(by_m):
        return Mechanisms((Mechanism("moved", body_pose=lambda t, press: np.array([0, 0, by_m])),))

    run = scanned(pose(-0.03))
    assert words(run) == ["aborted"] * 3
    assert "no touch within 20 mm" in run.outcomes[0].reason
    run = scanned(pose(0.002), force_noise_n=1e-3)
    assert words(run) == ["made"] * 3
    for press in run.presses:
        assert press.statistics.touch_error_m == pytest.approx(-0.002, abs=2e-5)
        depth = press.true_displacement_m + 0.002
        assert np.abs(press.scan.displacement_m - depth).max() < 1e-4


def test_a_touch_that_is_hardly_known_is_not_kept():
    judged = scanned().presses[0].judged
    assert judged.kept
    assert replace(judged, touch_sd_m=1e-4 + 0.06 * judged.travel_m).shortfalls() == (
        "first touch is known to 0.39 mm only",
    )


def rising(by_m, speed, after_s):
    """A body that rises in press 1, from `after_s` after its begin."""
    start = [np.inf]

    def begin(press, time_s):
        start[0] = time_s + after_s if press == 1 else np.inf

    def pose(time_s, press):
        return np.array([0.0, 0.0, float(np.clip(speed * (time_s - start[0]), 0.0, by_m))])

    return Mechanisms((Mechanism("rising", begin=begin, body_pose=pose),))


@pytest.mark.parametrize("after_s", [0.75, 1.1, 1.6, 2.2])  # approach, load, hold, unload
def test_a_body_that_rises_under_the_tip_is_told_and_left_in_time(after_s):
    run = scanned(rising(0.004, 0.05, after_s), Spring(2000.0))
    assert all(outcome.peak_force_n < 2 * 0.3 + 0.5 for outcome in run.outcomes)
    assert [outcome.kept for outcome in run.outcomes] == [True, False, True]
    assert words(run)[0] == words(run)[2] == "made"


@pytest.mark.parametrize(("after_s", "told"), [(1.8, "higher at the same force"), (4.0, "")])
def test_a_body_that_rises_slowly_shows_on_the_way_back(after_s, told):
    run = scanned(rising(0.002, 0.01, after_s), Spring(60.0))
    assert words(run) == ["made"] * 3
    assert told in run.outcomes[1].reason
    assert [outcome.kept for outcome in run.outcomes] == [True, not told, True]
    assert run.presses[1].judged.rise_m == pytest.approx(0.002 if told else 0.0, abs=2e-4)
