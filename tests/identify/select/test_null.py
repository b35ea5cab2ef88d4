"""With nothing hidden: p-values are uniform, intervals cover, and nothing is named.

The readings here come from the model's own compliances: it is the statistics that is tested. What
the meshes' error does to a diagnosis is tested on other solvers' scans (`cli/test_loop.py`).
"""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from identify.catalogue.breathing import Breathing
from identify.catalogue.catalogue import CATALOGUE
from identify.fit.joint_fit import fit_jointly
from identify.select import score_test
from identify.select.diagnosis import diagnose
from identify.select.forward_selection import forward_selection
from identify.select.null_distribution import NullNoise, NullSearch
from identify.select.patterns import EffectPattern, effect_patterns
from identify.select.score_test import beyond, fitted_basis, score_effect
from identify.select.settings import DiagnosisSettings
from tests.identify.select.loop_problem import TRUE, model, scan, timing
from tests.identify.select.loop_problem import uncorrected as body

SEEDS = 500
TWINS = 200


@cache
def compliance():
    return body().evaluate(TRUE, body().state()).compliance


def test_a_direction_that_the_model_contains_is_no_degree_of_freedom():
    rng = np.random.default_rng(5)
    fitted, _ = np.linalg.qr(rng.standard_normal((300, 4)))
    free = rng.standard_normal((300, 2))
    # the first column lies in the model up to rounding, as an offset beside a plane with an offset
    columns = np.column_stack([fitted @ [1.0, -2.0, 0.5, 3.0], free])[None]
    pattern = EffectPattern(CATALOGUE["surface_tilt"], [{}], columns, columns)
    _, basis, visible = beyond(pattern, fitted)
    assert basis.shape == (1, 300, 2)
    expected, _ = np.linalg.qr(free - fitted @ (fitted.T @ free))
    assert_allclose(basis[0] @ basis[0].T, expected @ expected.T, atol=1e-12)
    assert 0 < visible[0] < 1
    search = NullSearch(1, 3, False, NullNoise(5))
    search.add(basis)
    assert search.null().dof == 2


def null_scan(seed: int):
    press, _, _, force = timing(seed)
    return scan(compliance()[press] * force, force, seed)


@pytest.mark.parametrize("name", ["breathing_from_touch", "breathing_harmonics"])
def test_patterns_that_come_at_once_are_those_of_the_hook(name, monkeypatch):
    fitted = model(null_scan(0))
    effect, at = CATALOGUE[name], fitted.linearise(fitted.start(TRUE))
    at_once = effect_patterns(fitted, at, effect, most=5)
    monkeypatch.setattr(type(effect), "columns", lambda *_: None)
    alone = effect_patterns(fitted, at, effect, most=5)
    assert at_once.columns.shape == (5, len(at.residual), len(effect.amplitudes))
    for given, found in ((at_once.columns, alone.columns), (at_once.change_m, alone.change_m)):
        assert_allclose(given, found, rtol=0, atol=1e-6 * np.abs(found).max())


def test_a_certain_score_widens_the_search_and_counts_what_was_tried():
    search = NullSearch(100, 2, False, NullNoise())
    assert search.is_certain(200.0)
    before = search.null(200.0).log_p(200.0)
    search.widen(900)
    assert search.null(200.0).log_p(200.0) - before == pytest.approx(np.log(10), abs=1e-6)


@pytest.mark.parametrize("size", [-1.0, 0.0, 1.0])
def test_a_shape_that_the_map_absorbs_has_no_size(size, monkeypatch):
    """Its remainder is rounding, by which nothing may be divided; nor may it win by a zero."""
    rng = np.random.default_rng(0)
    fitted = np.linalg.qr(rng.standard_normal((200, 3)))[0]
    hidden = fitted @ [10.0, 20.0, 30.0] + 1e-9 * rng.standard_normal(200)
    shown = rng.standard_normal(200)
    columns = np.stack([hidden, shown])[:, :, None]
    noise = rng.standard_normal(200)
    basis = np.linalg.qr(np.column_stack([fitted, shown]))[0]
    left = shown - fitted @ (fitted.T @ shown)
    residual = noise - basis @ (basis.T @ noise) + size * left
    effect: Any = SimpleNamespace(
        name="demo", family="demo", amplitudes=CATALOGUE["contact_offset"].parameters[:1],
        null={}, hooks=(), grid=lambda readings, state: [{"s": 0.0}, {"s": 1.0}],
        bounded=lambda readings, state: [SimpleNamespace(null=0.0, lower=0.0, upper=1.0)],
        untestable=lambda readings: None,
    )  # fmt: skip
    monkeypatch.setattr(
        score_test, "pattern_blocks",
        lambda *_: iter([EffectPattern(effect, [{"s": 0.0}, {"s": 1.0}], columns, columns)]),
    )  # fmt: skip
    model = SimpleNamespace(
        readings=None, map_uncertainty=None, chain=SimpleNamespace(profile="", nonlinear=False)
    )
    fit: Any = SimpleNamespace(
        model=model, at=SimpleNamespace(residual=residual, state=None), expected_residual=0.0
    )
    score = score_effect(fit, effect, fitted)
    assert score.sizes == pytest.approx([max(size, 0.0)], abs=1e-9)
    assert score.rms_m < 2
    assert score.values["s"] == 1.0


def test_noise_is_drawn_once_for_searches_of_as_many_readings():
    noise = NullNoise(4)
    first = noise.batches(30, 1000)
    assert sum(batch.shape[1] for batch in first) == 1000
    assert noise.batches(30, 1000) is first
    assert all(batch.shape[0] == 40 for batch in noise.batches(40, 1000))
    assert_allclose(noise.batches(30, 1000), first, rtol=0, atol=0)  # of the seed alone


class CoarseBreath(Breathing):
    """A breath whose grid misses the planted one, and that knows where to look further."""

    def grid(self, readings, state):
        return [{"frequency_hz": 0.247}, {"frequency_hz": 0.254}]

    def around(self, shape, readings):
        return [{"frequency_hz": shape["frequency_hz"] + step} for step in (-0.004, 0.003)]


def test_shapes_beyond_the_grid_are_scored_around_a_certain_best():
    table = null_scan(0)
    wave = 2e-3 * np.sin(2 * np.pi * 0.25 * (table.time_s - table.time_s[0]))
    fit = fit_jointly(model(table.replace(displacement_m=table.displacement_m + wave)), TRUE)
    fitted = fitted_basis(fit.at)
    found = score_effect(fit, CoarseBreath(), fitted)
    assert found.values["frequency_hz"] == pytest.approx(0.25)
    assert found.statistic > score_effect(fit, Breathing(), fitted).statistic / 2


def test_a_searched_score_has_the_simulated_null():
    """p-values of maxima over a grid of random directions are uniform, bulk and tail."""
    rng = np.random.default_rng(1)
    basis = rng.standard_normal((40, 300, 1))
    basis /= np.linalg.norm(basis, axis=1, keepdims=True)
    search = NullSearch(40, 1, True, NullNoise(2))
    for block in (basis[:17], basis[17:]):
        search.add(block)
    null = search.null()
    draws = (basis[:, :, 0] @ rng.standard_normal((300, 2000))).max(axis=0)
    p = np.exp([null.log_p(float(z)) for z in draws])
    # The null is itself a sample of 1000: as many draws as this would see that, so a part is tested
    assert stats.kstest(p[:300], "uniform").pvalue > 0.01
    assert np.mean(p < 0.01) == pytest.approx(0.01, abs=0.008)


@pytest.mark.parametrize("name", ["viscoelasticity", "breathing", "skin_layer"])
def test_a_score_does_not_depend_on_the_memory_that_it_may_take(name):
    """One candidate at a time, or all at once: grids, grids of two columns, levels of a body."""
    drawn = model(null_scan(3), body())
    fit = fit_jointly(drawn, TRUE, rounds=0, max_evaluations=1)
    fitted = fitted_basis(fit.at)
    whole, small = (
        score_effect(fit, CATALOGUE[name], fitted, NullNoise(3), DiagnosisSettings(block_bytes=b))
        for b in (1e9, 1.0)
    )
    assert_allclose(small.statistic, whole.statistic, rtol=1e-4)
    assert_allclose(small.log_p, whole.log_p, rtol=1e-4)
    assert small.values == pytest.approx(whole.values, rel=1e-3)
    assert_allclose(abs(small.beyond.T @ whole.beyond), np.eye(small.beyond.shape[1]), atol=1e-4)


@pytest.mark.slow
def test_p_values_are_uniform_and_intervals_cover_where_nothing_is_hidden():
    p_values: dict[str, list[float]] = {effect.name: [] for effect in CATALOGUE}
    covered: dict[str, list[bool]] = {name: [] for name in TRUE.names}
    for seed in range(SEEDS):
        fit = fit_jointly(model(null_scan(seed), body()), TRUE)
        for score in diagnose(fit, CATALOGUE, seed=seed).scores:
            if score.untestable is None:
                p_values[score.name].append(score.p_value)
        intervals = fit.parameters
        for name, value in zip(TRUE.names, TRUE.values, strict=True):
            own = intervals[name]
            covered[name].append(own.lower95 <= value <= own.upper95)
    tested = {name: p for name, p in p_values.items() if len(p) == SEEDS}
    assert len(tested) >= 18
    chances = {name: float(stats.kstest(p, "uniform").pvalue) for name, p in tested.items()}
    assert min(chances.values()) > 0.01, chances
    rates = {name: float(np.mean(inside)) for name, inside in covered.items()}
    # The mesh's error is counted, where there is none
    assert min(rates.values()) > 0.92, rates


FORMS = [
    effect for effect in CATALOGUE if effect.family != effect.name or effect.name == "time_lag"
]


@pytest.mark.slow
def test_p_values_of_all_forms_are_uniform_at_the_true_map():
    """Scores alone, at the true map: their directions lie beyond those that a fit would move in.

    The pattern of a lag comes from the noisy readings themselves, so that it is not enough to draw
    the residual.
    """
    p_values: dict[str, list[float]] = {effect.name: [] for effect in FORMS}
    for seed in range(SEEDS):
        drawn = model(null_scan(seed), body())
        at = drawn.linearise(drawn.start(TRUE))
        fit: Any = SimpleNamespace(model=drawn, at=at, expected_residual=0.0)
        fitted, noise = fitted_basis(at), NullNoise(seed)
        for effect in FORMS:
            if "frequency_hz" in [p.name for p in effect.parameters] and seed % 5:
                continue  # a quarter of a second each
            score = score_effect(fit, effect, fitted, noise)
            p_values[effect.name].append(score.p_value)
    chances = {name: float(stats.kstest(p, "uniform").pvalue) for name, p in p_values.items()}
    assert min(chances.values()) > 0.01, chances
    rates = {name: float(np.mean(np.array(p) < 0.01)) for name, p in p_values.items()}
    assert max(rates.values()) <= 0.03, rates


def map_coverage(seeds, offset_m: float = 0.0):
    """How often the 95 % intervals of the map alone hold the truth, of the noise alone, by name."""
    exact = replace(body(), correction=replace(body().correction, model_error=0.0))
    inside: dict[str, list[bool]] = {name: [] for name in TRUE.names}
    for seed in seeds:
        table = null_scan(seed)
        table = replace(table, displacement_m=table.displacement_m + offset_m)
        intervals = fit_jointly(model(table, exact), TRUE).parameters
        for name, value in zip(TRUE.names, TRUE.values, strict=True):
            own = intervals[name]
            inside[name].append(own.lower95 <= value <= own.upper95)
    return {name: float(np.mean(held)) for name, held in inside.items()}


@pytest.mark.slow
def test_intervals_of_noise_alone_cover_as_often_as_they_say():
    rates = map_coverage(range(TWINS))
    assert min(rates.values()) >= 0.92, rates
    assert max(rates.values()) <= 0.98, rates


@pytest.mark.slow
def test_intervals_without_the_missing_effect_do_not_cover():
    """A first touch that is declared late by 0.15 mm, 4 % of the travel's rms, is left out."""
    rates = map_coverage(range(4), offset_m=-1.5e-4)
    assert rates["background_pa"] == 0
    assert rates["inclusion_1.weight_pa"] < 0.5


@pytest.mark.slow
def test_nothing_is_named_where_nothing_is_hidden():
    verdicts = []
    for seed in range(100, 130):
        table = null_scan(seed)
        verdicts.append(
            forward_selection(model(table, body()), TRUE, table, CATALOGUE, seed=seed).verdict
        )
    assert verdicts.count("nothing_missing") >= 28, verdicts
