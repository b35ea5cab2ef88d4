"""Beside a free map and with nothing hidden, the p-values of all effects are uniform.

The compliances are drawn from the prior of the map (a tenth around the fitted ones) and pressed by
the model; scans have times, holds and unloading.
"""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from identify.map import FreeMap, Grid, MaternField
from identify.map.parameters import ParameterSpace
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import MeasurementModel
from identify.select.null_distribution import NullNoise
from identify.select.score_test import fitted_basis, score_effect
from tests.identify.select.loop_problem import NOISE, SIZE, scan, timing, uncorrected

SEEDS = range(500)
SHARE, ERROR = 0.05, 0.01  # of the prior's spread; own error of the map in each press
NONE = np.empty(0)


@pytest.mark.slow
def test_p_values_of_all_effects_are_uniform_beside_a_free_map():
    grid = Grid.over(np.array([[0, 0, 0], SIZE]), 0.006)
    log_pa = np.log(8e3) + MaternField(grid, 0.02, 0.3).draws(np.random.default_rng(1), 1)[0]
    space = ParameterSpace(FreeMap(grid, log_pa), (), ())
    press, _, _, force = timing(0)
    known = MeasurementModel(
        Readings.of(scan(0 * force, force, 0)), 0 * force, NOISE, uncorrected(), space
    )
    body = known.body(NONE)
    by_field = body.by_field()
    of_field = SHARE**2 * MaternField(grid, 0.02, 0.3, 2.0).product(by_field) @ by_field.T
    own = np.full(25, (SHARE * ERROR) ** 2)
    root = np.linalg.cholesky(of_field + np.diag(own))
    assert np.sqrt(np.diag(of_field)).min() > 0.08
    p_values: dict[str, list[float]] = {effect.name: [] for effect in CATALOGUE}
    for seed in SEEDS:
        moved = root @ np.random.default_rng(5000 + seed).standard_normal(25)
        press, _, _, force = timing(seed)
        drawn = scan((body.compliance * np.exp(moved))[press] * force, force, seed)
        model = replace(
            known, readings=Readings.of(drawn), displacement_m=drawn.used().displacement_m,
            map_uncertainty=MapUncertainty(of_field, own, np.zeros(25), np.ones(25)),
        )  # fmt: skip
        at = model.around(body, NONE)
        fit: Any = SimpleNamespace(model=model, at=at, expected_residual=0.0)
        fitted, noise = fitted_basis(at), NullNoise(seed)
        for effect in CATALOGUE:
            if "frequency_hz" in [p.name for p in effect.parameters] and seed % 5:
                continue  # most of the time
            score = score_effect(fit, effect, fitted, noise)
            if score.untestable is None:
                p_values[effect.name].append(score.p_value)
    tested = {name: np.array(p) for name, p in p_values.items() if p}
    # The others are forms of the map, and a touch that is a force bias under a flat tip
    assert len(tested) == len(CATALOGUE) - 6
    chances = {name: float(stats.kstest(p, "uniform").pvalue) for name, p in tested.items()}
    assert min(chances.values()) > 0.01 / len(tested), chances
    rates = {name: float(np.mean(p < 0.01)) for name, p in tested.items()}
    assert max(rates.values()) <= 0.03, rates
