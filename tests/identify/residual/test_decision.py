"""Noise is called noise at the stated level, and planted structure is called by its name."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from identify.effects.readings import Readings
from identify.measurement.errors_in_variables import whitening
from identify.measurement.noise import Noise
from identify.residual.compare import QUESTIONS, compare_residual
from identify.residual.whitened import Whitened, shared_errors
from identify.select.settings import SELECTION
from models.scan import Scan

NOISE = Noise(2e-5, 5e-3)
SEEDS = 200


def law(theta, xy):
    """Compliance (j,) of a stand-in for the body, and its derivative (j, 5): a soft half-space
    with a stiff spot, C = a / (w0 + w exp(-|p - q|^2 / 2 r^2))."""
    w0, w, x, y, r = theta
    offset = xy - (x, y)
    bump = np.exp(-np.sum(offset**2, axis=1) / (2 * r**2))
    stiffness = w0 + w * bump
    d_stiffness = np.column_stack(
        [
            np.ones(len(xy)),
            bump,
            w * bump * offset[:, 0] / r**2,
            w * bump * offset[:, 1] / r**2,
            w * bump * np.sum(offset**2, axis=1) / r**3,
        ]
    )
    compliance = 75.0 / stiffness
    return compliance, -(compliance / stiffness)[:, None] * d_stiffness


def program(grid=9, samples=22, top_n=0.3):
    """Contact points (j, 3) row by row, and of each sample of a press: force, time and phase."""
    axis = np.linspace(0.012, 0.084, grid)
    x, y = np.meshgrid(axis, axis)
    points = np.column_stack([x.ravel(), y.ravel(), np.full(grid**2, 0.048)])
    load, hold = samples // 2 - 1, samples // 4
    force = np.concatenate(
        [
            np.linspace(0.1, 1, load),
            np.ones(hold),
            np.linspace(1, 0.1, samples - load - hold + 1)[1:],
        ]
    )
    phase = np.repeat(["load", "hold", "unload"], [load, hold, samples - load - hold])
    return points, top_n * force, 0.125 * np.arange(1, samples + 1), phase


def scan_of(seed, plant=None, given=NOISE, timed=True, only_load=False, grid=9):
    """A scan with noise in both columns and its least-squares residual; `plant(scan, c)` adds to
    the true displacement (m,)."""
    rng = np.random.default_rng(seed)
    points, force, time, phase = program(grid)
    j, n = len(points), len(force)
    true = np.array([5000.0, 12000.0, 0.04, 0.058, 0.012])
    compliance = np.repeat(law(true, points[:, :2])[0], n)
    scan = Scan(
        press=np.repeat(np.arange(j), n),
        time_s=(4.5 * np.arange(j)[:, None] + time).ravel() if timed else np.full(j * n, np.nan),
        phase=np.tile(phase, j),
        point_m=np.repeat(points, n, axis=0),
        direction=np.tile([0.0, 0.0, -1.0], (j * n, 1)),
        force_n=np.tile(force, j),
        displacement_m=compliance * np.tile(force, j),
        probe_radius_m=np.full(j * n, 0.005),
    )
    planted = plant(scan, compliance) if plant else 0.0
    scan = scan.replace(
        force_n=scan.force_n + rng.normal(0, NOISE.force_n, j * n),
        displacement_m=scan.displacement_m + planted + rng.normal(0, NOISE.displacement_m, j * n),
    )
    if only_load:
        scan = scan.rows(scan.phase == "load")
    return fitted(scan, true, given)


def parameters(scan, theta, noise=NOISE):
    index = scan.press_index
    for _ in range(6):
        compliance, derivative = law(theta, scan.contact_points[:, :2])
        e, s, latent = whitening(scan.displacement_m, scan.force_n, compliance[index], noise)
        jacobian = derivative[index] * (latent / s)[:, None]
        theta = theta + np.linalg.lstsq(jacobian, e / s, rcond=None)[0]
    return theta


def fitted(scan, theta, noise):
    index, theta = scan.press_index, parameters(scan, theta, noise)
    compliance, derivative = law(theta, scan.contact_points[:, :2])
    e, s, latent = whitening(scan.displacement_m, scan.force_n, compliance[index], noise)
    return Whitened(scan, e, s, latent, derivative[index] * (latent / s)[:, None], noise.estimated)


def since_touch(scan):
    first = np.searchsorted(scan.press, scan.press_ids)
    return scan.time_s - scan.time_s[first][scan.press_index]


def bump(scan, x, y, width):
    return np.exp(-np.sum((scan.point_m[:, :2] - (x, y)) ** 2, axis=1) / (2 * width**2))


PLANTED = {
    "a force offset": ("force", lambda s, c: -0.015 * c),
    "stiffening": ("force", lambda s, c: -0.1 * c * s.force_n**2 / 0.3),
    "creep": ("time", lambda s, c: 0.12 * c * s.force_n * (1 - np.exp(-since_touch(s)))),
    "hysteresis": (
        "phase",
        lambda s, c: 0.015 * c * (s.phase == "unload") * np.sin(np.pi * s.force_n / 0.3),
    ),
    "an offset that drifts": ("order", lambda s, c: 0.02 * c * s.press_index / 80),
    "a gain that drifts": ("order", lambda s, c: 0.1 * c * s.force_n * s.press_index / 80),
    "a second soft spot": ("place", lambda s, c: 0.08 * c * s.force_n * bump(s, 0.07, 0.03, 0.01)),
    "four bad presses": (
        "press",
        lambda s, c: 0.15 * c * s.force_n * np.isin(s.press, [7, 30, 44, 71]),
    ),
    "one glitch": ("reading", lambda s, c: 1e-3 * (np.arange(len(s)) == 500)),
    "understated noise": (
        None,
        lambda s, c: np.random.default_rng(8).normal(0, 8e-5, len(s)),
    ),
}


@pytest.mark.slow
def test_noise_alone_is_called_structure_in_at_most_one_scan_of_a_hundred():
    alarms, p_values = 0, []
    for seed in range(SEEDS):
        comparison = compare_residual(scan_of(seed, grid=7))
        alarms += not comparison.is_noise
        p_values.append([t.p_value for t in comparison.tests])
    # The family-wise level is 1 %: 200 scans give 2 +- 1.4 alarms; 8 have a chance of 0.1 %.
    assert alarms <= 7
    often = np.mean(np.array(p_values) < 0.05, axis=0)
    # Each test by itself: 5 % +- 1.5 %.
    assert np.all(often < 0.05 + 4 * 0.015), dict(zip(QUESTIONS, often, strict=True))


def test_a_pattern_of_chance_is_told_and_is_no_missing_cause():
    """Of 400 scans of noise six go beyond 1 %; a verdict that a cause is missing asks for 0.1 %."""
    w = scan_of(80, grid=5)
    compared, selected = compare_residual(w), compare_residual(w, SELECTION.residual)
    assert not compared.is_noise
    assert selected.is_noise
    assert SELECTION.sure < selected.p_value < compared.alpha
    assert "may be noise" in selected.statement
    assert "in one of 187 scans: it varies most with the phase" in selected.statement
    beyond = compare_residual(scan_of(80, PLANTED["hysteresis"][1], grid=5), SELECTION.residual)
    assert not beyond.is_noise


def test_a_touch_within_its_error_is_noise_and_one_far_beyond_is_structure():
    """Projected out, any offset was noise, and with it whatever bends all curves alike."""
    noise = replace(NOISE, touch_m=3.6e-5)
    for seed in range(4):
        w = scan_of(seed, grid=7)
        readings = Readings.of(w.scan)
        shared, rms = shared_errors(noise, readings, w.scan.displacement_m, w.sigma_m)
        assert rms == noise.touch_m
        rng = np.random.default_rng(1000 + seed)
        touched = w.residual_m + rng.normal(0, noise.touch_m, w.presses)[w.press_index]
        assert compare_residual(replace(w, residual_m=touched, shared=shared)).is_noise
        assert not compare_residual(replace(w, residual_m=touched)).is_noise
        far = compare_residual(replace(w, residual_m=touched + 2e-4, shared=shared))
        assert not far.is_noise
        assert far.varies_with == "force", far.statement


def test_the_measured_force_in_place_of_the_latent_one_fabricates_structure():
    w = scan_of(3)
    measured = replace(w, force_n=np.array(w.scan.force_n))
    assert compare_residual(w).is_noise
    assert compare_residual(measured).test("force").p_value < 1e-4


def test_an_unprojected_parameter_hides_structure_no_more_than_it_should():
    """A gain common to all presses lies along the fitted background: nothing can see it."""
    gain = scan_of(4, lambda s, c: 0.3 * c * s.force_n)
    assert compare_residual(gain).is_noise


@pytest.mark.parametrize("name", PLANTED)
@pytest.mark.parametrize("seed", [1, 2])
def test_planted_structure_is_named(name, seed):
    expected, plant = PLANTED[name]
    comparison = compare_residual(scan_of(seed, plant))
    assert not comparison.is_noise
    assert comparison.varies_with == expected, comparison.statement


def test_bad_presses_are_named_and_only_these():
    comparison = compare_residual(scan_of(1, PLANTED["four bad presses"][1]))
    assert comparison.bad_presses == (7, 30, 44, 71)
    assert {p.press for p in comparison.worst_presses[:4]} == {7, 30, 44, 71}
    softer = {p.press: p.softer for p in comparison.presses}
    # The map absorbs part of the 15 %.
    assert all(0.08 < softer[press] < 0.16 for press in comparison.bad_presses)


def test_the_sentence_tells_size_and_place_along_the_force():
    comparison = compare_residual(scan_of(1, PLANTED["a force offset"][1]))
    low, high = comparison.levels["force"][0], comparison.levels["force"][-1]
    # The offset takes 15 mN off the force: at small forces the body seems to give way less.
    assert low.mean_m < -8e-5
    assert high.mean_m > 1e-5
    assert "it varies most with the force" in comparison.statement
    assert f"{1e6 * low.mean_m:+.0f} µm at {low.label}" in comparison.statement


def test_the_soft_spot_is_found_where_it_was_planted():
    w = scan_of(1, PLANTED["a second soft spot"][1])
    comparison = compare_residual(w)
    assert "around (66, 30, 48) mm" in comparison.statement
    moved = replace(w, scan=w.scan.replace(frame_m=(0.1, 0.0, -0.05)))
    assert "around (166, 30, -2) mm" in compare_residual(moved).statement  # of the scan's frame
    assert comparison.moran_i is not None
    assert comparison.moran_i > 0.3


def test_a_drift_down_the_rows_is_said_to_look_like_a_place():
    """Row after row, order and y are nearly the same thing."""
    comparison = compare_residual(
        scan_of(1, lambda s, c: 0.004 * c * (s.point_m[:, 1] - 0.048) / 0.036)
    )
    named = {comparison.varies_with, *comparison.confused_with}
    assert named >= {"place", "order"}, comparison.statement


def test_without_time_stamps_and_unloading_the_reason_is_said():
    comparison = compare_residual(scan_of(5, timed=False, only_load=True))
    assert comparison.is_noise
    assert comparison.test("time").untestable == "the scan has no time stamps"
    assert comparison.test("phase").untestable == "the scan has only 'load' readings"
    assert any("no time stamps" in note for note in comparison.notes)
    assert "time" not in comparison.levels


def test_few_presses_leave_place_and_order_untested_and_the_rest_tested():
    comparison = compare_residual(scan_of(6, grid=2))
    assert comparison.is_noise
    for name in ("place", "order", "neighbours", "succession"):
        assert comparison.test(name).untestable
    assert comparison.test("force").untestable is None


def test_understated_noise_is_said_with_its_factor():
    comparison = compare_residual(scan_of(1, PLANTED["understated noise"][1]))
    assert comparison.scatter == pytest.approx(np.sqrt(comparison.chi2_per_dof), rel=0.1)
    assert "times the noise given" in comparison.statement


def test_overstated_noise_is_no_structure_but_is_said():
    comparison = compare_residual(scan_of(1, given=Noise(4e-5, 1e-2)))
    assert comparison.is_noise
    assert comparison.chi2_per_dof == pytest.approx(0.25, rel=0.15)
    assert any("noise seems too large" in note for note in comparison.notes)


def test_estimated_noise_is_said_and_its_own_error_is_counted():
    low = scan_of(1, given=Noise(1.9e-5, 4.75e-3))
    given = compare_residual(low).test("size").p_value
    estimated = compare_residual(replace(low, noise_estimated=True))
    assert given < 1e-4
    assert 1e-2 < estimated.test("size").p_value
    assert any("estimated from this scan" in note for note in estimated.notes)


def test_influence_is_the_shift_of_the_map_when_the_press_is_left_out():
    w = scan_of(2, PLANTED["four bad presses"][1])
    influence = compare_residual(w).presses[30].influence
    start = np.array([5000.0, 12000.0, 0.04, 0.058, 0.012])
    with_it, without = (parameters(s, start) for s in (w.scan, w.scan.rows(w.scan.press != 30)))
    covariance = np.linalg.inv(w.absorbed.T @ w.absorbed)
    shift = without - with_it
    exact = np.sqrt(shift @ np.linalg.solve(covariance, shift))
    # The influence is linearised at the fit with the press.
    assert influence == pytest.approx(exact, rel=0.25)
    assert exact > 3


def test_an_offset_common_to_all_readings_belongs_to_the_force_alone():
    comparison = compare_residual(scan_of(1, lambda s, c: np.full(len(s), 1.5e-4)))
    assert comparison.varies_with == "force"
    assert not comparison.test("phase").fires
    assert not comparison.test("time").fires


def late_force(scan, c):
    """Displacement of a body whose force is read 40 ms late: that of the force read then."""
    later = np.empty_like(scan.force_n)
    for press in scan.press_ids:
        rows = scan.press == press
        time, force = scan.time_s[rows], scan.force_n[rows]
        later[rows] = np.interp(time + 0.04, time, force)
    return c * (later - scan.force_n)


def sign(scan):
    return 1.0 * (scan.phase == "load") - (scan.phase == "unload")


@pytest.mark.parametrize(
    ("name", "plant", "value", "says"),
    [
        ("speed", late_force, 0.04, "as if the force lagged the displacement by"),
        ("direction", lambda scan, c: 6e-5 * sign(scan), 6e-5, "µm on the way up"),
        ("share_of_travel", lambda scan, c: -0.03 * sign(scan) * c * scan.force_n, -0.03,
         "of the travel on the way down"),
        ("session", lambda scan, c: 0.08 * c * scan.force_n * (scan.time_s / 364 - 0.5), 0.08,
         "softer by"),
    ],
)  # fmt: skip
def test_a_law_that_takes_nearly_all_is_said_with_its_size(name, plant, value, says):
    comparison = compare_residual(scan_of(5, plant))
    found = comparison.law
    assert found is not None
    assert found.name == name
    assert found.value == pytest.approx(value, abs=0.1 * abs(value) + 3 * found.error)
    assert found.error < 0.1 * abs(value)
    assert 0.85 < found.share <= 1
    assert says in comparison.statement
    assert f"{100 * found.share:.0f} % of it goes with {found.words}." in comparison.statement


FOLLOW_NO_LAW = [name for name in PLANTED if name != "a gain that drifts"]


@pytest.mark.parametrize("seed", range(2))
def test_what_follows_no_law_gets_none(seed):
    def creep(scan, c, share):
        return share * c * scan.force_n * (1 - np.exp(-since_touch(scan)))

    none = [compare_residual(scan_of(seed)).law]
    none += [compare_residual(scan_of(seed, partial(creep, share=a))).law for a in (0.1, 0.3)]
    none += [compare_residual(scan_of(seed, PLANTED[name][1])).law for name in FOLLOW_NO_LAW]
    assert none == [None] * len(none)
    untimed = compare_residual(scan_of(seed, lambda scan, c: 6e-5 * sign(scan), timed=False))
    assert untimed.law is not None
    assert untimed.law.name == "direction"
