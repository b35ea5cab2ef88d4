"""Noise in both columns: the misfit, its compressed form, and what is estimated from ramps."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.optimize import minimize_scalar

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.errors_in_variables import press_table, whitening
from identify.measurement.judge import judge
from identify.measurement.noise import Noise, scan_noise
from models.errors import InputError
from models.scan import Scan
from tests.identify.select.loop_problem import scan, timing

NOISE = Noise(2e-5, 5e-3)


def random_rows(seed=0, presses=5, rows=23):
    rng = np.random.default_rng(seed)
    index = rng.permutation(np.arange(rows) % presses)
    compliance = rng.uniform(0.004, 0.02, presses)
    force = rng.uniform(0.02, 0.3, rows)
    displacement = compliance[index] * force + rng.normal(0, 5e-4, rows)
    return index, displacement, force, compliance


def test_two_rows_a_press_carry_the_whole_misfit():
    index, d, f, compliance = random_rows()
    table = press_table(index, d, f, 5)
    r, slope = table.residuals(compliance, NOISE)
    e, s, latent = whitening(d, f, compliance[index], NOISE)
    assert_allclose(np.sum(r**2), np.sum((e / s) ** 2), rtol=1e-12)
    gradient = np.bincount(index, -(e / s) * (latent / s))
    assert_allclose(np.sum(r * slope, axis=1), gradient, rtol=1e-10)
    assert_allclose(np.sum(slope**2, axis=1), np.bincount(index, (latent / s) ** 2), rtol=1e-12)
    assert_allclose(table.rms(compliance), np.sqrt(np.mean(e**2)), rtol=1e-12)


def test_a_press_of_one_row_is_kept():
    table = press_table(np.array([0, 1, 1]), np.array([1e-3, 2e-3, 3e-3]), np.ones(3), 2)
    r, _ = table.residuals(np.array([0.5e-3, 2.5e-3]), Noise(1e-4, 0.0))
    assert_allclose(np.sum(r**2, axis=1), [25.0, 50.0])


def test_the_derivative_is_taken_at_the_latent_force():
    _, d, f, _ = random_rows()
    c, h = 0.012, 1e-7
    _, s, latent = whitening(d, f, c, NOISE)
    above, below = (whitening(d, f, c + side * h, NOISE) for side in (1, -1))
    slope = (above[0] / above[1] - below[0] / below[1]) / (2 * h)
    assert_allclose(-latent / s, slope, rtol=1e-6)


def test_the_latent_force_is_the_likeliest_true_force():
    d, f, c = 2.3e-3, 0.2, 0.011

    def misfit(true):
        d_misfit = (d - c * true) / NOISE.displacement_m
        return d_misfit**2 + ((f - true) / NOISE.force_n) ** 2

    best = minimize_scalar(misfit, bracket=(0.1, 0.3), tol=1e-12)
    e, s, latent = whitening(np.array(d), np.array(f), np.array(c), NOISE)
    assert_allclose(latent, best.x, rtol=1e-7)
    assert_allclose((e / s) ** 2, best.fun, rtol=1e-9)


def test_force_noise_does_not_bend_the_slope():
    rng = np.random.default_rng(5)
    noise, true, rows = Noise(2e-5, 0.04), 0.012, 6000
    force = rng.uniform(0.02, 0.3, rows)
    d = true * force + rng.normal(0, noise.displacement_m, rows)
    measured = force + rng.normal(0, noise.force_n, rows)
    table = press_table(np.zeros(rows, int), d, measured, 1)
    best = minimize_scalar(
        lambda c: float(np.sum(table.residuals(np.array([c]), noise)[0] ** 2)),
        bracket=(0.01, 0.014),
    )
    # Least squares of d on F is attenuated by 5 %, twenty times the deviation asked for here.
    assert table.slope[0] < 0.96 * true
    assert best.x == pytest.approx(true, rel=3e-3)


def ramp_scan(rng, sd_d, sd_f, *, timed=True, wiggle=0.0, presses=40):
    """Presses with curved ramps of 12 rows up and 10 down, and a hold that creeps."""
    parts = []
    for j in range(presses):
        compliance = 0.006 + 0.0003 * j
        up, hold, down = np.arange(1, 13) / 12, np.arange(1, 9) / 8, np.arange(1, 11) / 10
        force = 0.3 * np.concatenate([up**1.3, np.ones(8), (1 - down) ** 1.2])
        force = force + wiggle * rng.normal(size=30)
        creep = 1 + 0.1 * np.concatenate([np.zeros(12), 1 - np.exp(-hold), np.full(10, 0.6)])
        time = 5.0 * j + np.concatenate([up, 1 + 2 * hold, 3 + down])
        parts.append((np.full(30, j), time, force, compliance * creep * force))
    press, time, force, d = (np.concatenate(p) for p in zip(*parts, strict=True))
    return Scan(
        press=press,
        time_s=time if timed else np.full(len(press), np.nan),
        phase=np.tile(["load"] * 12 + ["hold"] * 8 + ["unload"] * 10, presses),
        point_m=np.zeros((len(press), 3)),
        direction=np.tile([0.0, 0.0, -1.0], (len(press), 1)),
        force_n=force + rng.normal(0, sd_f, len(press)),
        displacement_m=d + rng.normal(0, sd_d, len(press)),
        probe_radius_m=np.full(len(press), 0.005),
    )


@pytest.mark.parametrize("timed", [True, False])
def test_both_noises_are_estimated_from_the_ramps(timed):
    noise = scan_noise(ramp_scan(np.random.default_rng(1), 2e-5, 5e-3, timed=timed))
    assert noise.estimated
    assert noise.displacement_m == pytest.approx(2e-5, rel=0.1)
    assert noise.force_n == pytest.approx(5e-3, rel=0.1)


def test_a_noise_that_is_known_is_kept():
    scan = ramp_scan(np.random.default_rng(1), 2e-5, 5e-3)
    noise = scan_noise(scan, displacement_m=3e-5)
    assert noise.displacement_m == 3e-5
    assert not noise.displacement_estimated
    assert noise.force_n == pytest.approx(5e-3, rel=0.1)
    assert scan_noise(scan, 1e-5, 1e-3) == Noise(1e-5, 1e-3)


def test_motion_that_both_columns_share_is_no_noise():
    noise = scan_noise(ramp_scan(np.random.default_rng(1), 2e-5, 5e-3, wiggle=0.02))
    assert noise.displacement_m == pytest.approx(2e-5, rel=0.35)
    assert noise.force_n == pytest.approx(5e-3, rel=0.2)


def test_a_scan_without_noise_gets_finite_weights():
    noise = scan_noise(ramp_scan(np.random.default_rng(1), 0.0, 0.0))
    assert 0 < noise.displacement_m < 1e-5
    assert 0 < noise.force_n < 1e-3


def test_too_few_samples_for_an_estimate_are_said():
    scan = ramp_scan(np.random.default_rng(1), 2e-5, 5e-3, presses=3)
    sparse = scan.rows(np.arange(0, len(scan), 10))
    with pytest.raises(InputError, match="displacement_m and force_n under"):
        scan_noise(sparse)


@pytest.mark.parametrize("pair", [(0.0, 0.0), (-1e-5, 1e-3), (np.nan, 1e-3)])
def test_a_noise_that_gives_no_weight_is_refused(pair):
    with pytest.raises(InputError, match="noise"):
        Noise(*pair)


def test_the_noise_expected_beside_creep_is_that_of_repeated_readings():
    """What a reading's residual varies by when all forces of its press are read again."""
    *_, force = timing(1)
    table = scan(np.zeros(len(force)), force, 1)
    readings, compliance = Readings.of(table), np.full(25, 0.02)
    names = ("two_time_creep", "power_law_creep")
    values = {"two_time_creep": {"g_fast": 0.1, "g_slow": 0.1, "tau_s": 0.3, "ratio": 10.0},
              "power_law_creep": {"g": 0.1, "alpha": 0.3}}  # fmt: skip
    for name in names:
        chain = Chain(readings, [CATALOGUE[name]], np.full(25, 0.004), "flat", 0.45)
        at = OperatingPoint(compliance, np.full(25, 5e3), force, values)
        slope = chain.by_force(at)
        rng, drawn = np.random.default_rng(3), []
        told = chain.predict(at)
        for _ in range(60):
            noise = 5e-3 * rng.standard_normal(len(force))
            drawn.append(chain.predict(at._replace(force_n=force + noise)) - told)
        varied = np.mean(np.square(drawn))
        assert np.mean((slope * 5e-3) ** 2) == pytest.approx(varied, rel=0.012)


def test_the_latent_force_of_a_balls_last_readings_settles_from_either_side_of_none():
    """Where a ball leaves the body its slope is steep, and a step may lead across no force."""
    *_, force = timing(1)
    read = np.where(
        force < 0.1 * force.max(), 0.014, force
    )  # the last of each unloading, too large
    readings = Readings.of(scan(np.zeros(len(force)), read, 1))
    chain = Chain(readings, [], np.full(25, 0.004), "hertz", 0.45)
    compliance, modulus = np.full(25, 0.02), np.full(25, 5e3)
    low = chain.predict(OperatingPoint(compliance, modulus, np.minimum(force, 0.002), {}))
    moved = np.where(
        read > force, low, chain.predict(OperatingPoint(compliance, modulus, read, {}))
    )
    found = [
        judge(chain, compliance, modulus, moved, NOISE, {}, start).latent_force_n
        for start in (None, 0.5 * force, -0.01 + 0 * force)
    ]
    last = read > force
    assert last.sum() >= 25
    assert np.all(np.abs(found[0] - read)[last] > NOISE.force_n)
    for other in found[1:]:
        assert_allclose(other, found[0], atol=1e-3 * force.max())
