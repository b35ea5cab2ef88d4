"""Slopes of a ball's travel: those of differences, and what a memory makes of them is kept."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from identify.measurement import chain as chain_module
from identify.measurement.chain import Chain, OperatingPoint
from identify.measurement.judge import judge
from identify.measurement.kept_slope import KeptSlope
from identify.measurement.noise import Noise
from tests.identify.select.loop_problem import scan, timing

NOISE = Noise(2e-5, 5e-3)
VALUES = {
    "hysteresis": {"h": 0.1},
    "viscoelasticity": {"g": 0.3, "tau_s": 2.0},
    "time_lag": {"lag_s": 0.1},
    "strain_stiffening": {"b": 0.5},
    "touch_threshold": {"threshold_n": 0.02},
}
PRESSES = 25


def ball(*names: str) -> tuple[Chain, OperatingPoint]:
    *_, force = timing(1)
    readings = Readings.of(scan(np.zeros(len(force)), force, 1))
    effects = [CATALOGUE[name] for name in names]
    growth = np.full(PRESSES, -0.9)
    chain = Chain(readings, effects, np.full(PRESSES, 0.004), "hertz", 0.45, 0.0, growth)
    values = {name: VALUES[name] for name in names}
    return chain, OperatingPoint(np.full(PRESSES, 0.02), np.full(PRESSES, 5e3), force, values)


@pytest.mark.parametrize("names", [(), ("strain_stiffening",), ("time_lag", "touch_threshold")])
def test_slopes_are_those_of_differences(names):
    chain, at = ball(*names)
    step = 1e-5 * at.force_n.max()
    up, down = (chain.predict(at._replace(force_n=at.force_n + s)) for s in (step, -step))
    felt = at.force_n > 0.02 * at.force_n.max()
    assert_allclose(chain.by_force(at)[felt], ((up - down) / (2 * step))[felt], rtol=3e-4)
    up, down = (
        chain.predict(at._replace(compliance=at.compliance * f, modulus=at.modulus / f))
        for f in (1 + 1e-5, 1 / (1 + 1e-5))
    )
    assert_allclose(
        chain.by_log_compliance(at), (up - down) / (2 * np.log1p(1e-5)), rtol=1e-5, atol=1e-9
    )


def test_a_memory_is_asked_once_for_nearby_forces(monkeypatch):
    chain, at = ball("hysteresis", "viscoelasticity")
    asked = []
    by_force = Chain.by_force
    monkeypatch.setattr(Chain, "by_force", lambda *a: asked.append(a) or by_force(*a))
    kept = KeptSlope(chain)
    assert_allclose(kept(at), by_force(chain, at))
    near = at._replace(force_n=at.force_n + 0.01 * at.force_n.max())
    felt = at.force_n > 0.1 * at.force_n.max()
    assert_allclose(kept(near)[felt], by_force(chain, near)[felt], rtol=0.01)
    assert len(asked) == 1
    plain, at = ball("touch_threshold")
    kept, near = KeptSlope(plain), at._replace(force_n=near.force_n)
    kept(at)
    assert_allclose(kept(near), by_force(plain, near))


def test_a_balls_travel_is_found_once_for_what_is_asked_at_a_point(monkeypatch):
    chain, at = ball("hysteresis", "viscoelasticity", "strain_stiffening")
    found = []
    travel = chain_module.ball_travel
    monkeypatch.setattr(chain_module, "ball_travel", lambda *a: found.append(a) or travel(*a))
    chain.predict(at)
    chain.by_force(at)
    chain.by_log_compliance(at)
    assert len(found) == 1


def test_a_comparison_with_kept_slopes_ends_where_one_without_does():
    chain, at = ball("hysteresis", "viscoelasticity")
    measured = chain.predict(at) + NOISE.displacement_m * np.random.default_rng(2).standard_normal(
        len(at.force_n)
    )
    start = judge(chain, at.compliance, at.modulus, measured, NOISE, at.values).latent_force_n
    whole, kept = (
        judge(chain, at.compliance, at.modulus, measured, NOISE, at.values, start, slope)
        for slope in (None, KeptSlope(chain))
    )
    assert_allclose(kept.latent_force_n, whole.latent_force_n, atol=2e-3 * at.force_n.max())
    chi2 = [np.sum((j.residual_m / j.sigma_m) ** 2) for j in (whole, kept)]
    assert chi2[1] == pytest.approx(chi2[0], rel=2e-3)
    assert replace(chain, effects=[]).feels_others is False
