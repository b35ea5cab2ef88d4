"""Presses that stand apart are found though they pull the fit along and hide each other."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from identify.fit.joint_fit import fit_jointly
from identify.residual.compare import compare_residual
from identify.residual.settings import TRIMMED
from identify.residual.trimmed import further, missed, presses_apart, trimmed_residual
from identify.select.step import whitened_fit
from tests.identify.select.loop_problem import TRUE, model, scan, timing, true_compliance


@settings(max_examples=20, deadline=None)
@given(st.integers(0, 10**6), st.integers(1, 7))
def test_the_worst_fifth_may_be_anything(seed, wrong):
    rng = np.random.default_rng(seed)
    matrix = rng.standard_normal((40, 6))
    values = matrix @ rng.standard_normal(6) + 0.1 * rng.standard_normal(40)
    out = rng.choice(40, wrong, replace=False)
    values[out] += rng.uniform(3, 30)  # to one side, as presses that slip go
    residual = trimmed_residual(matrix, values)
    rest = np.setdiff1d(np.arange(40), out)
    assert np.abs(residual[out]).min() > 1.0
    assert np.abs(residual[rest]).max() < 1.0


def measured(factor: np.ndarray):
    """A scan of 25 presses whose travels are multiplied by factors (25,)."""
    press, _, _, force = timing(5)
    return scan((factor * true_compliance())[press] * force, force, 5)


def fitted(factor: np.ndarray):
    return fit_jointly(model(measured(factor)), TRUE)


def test_presses_that_slipped_stand_apart_by_as_much_as_they_slipped():
    factor = np.ones(25)
    factor[[3, 12, 20, 21]] = 1.15
    fit = fitted(factor)
    found = presses_apart(fit.model, fit.at)
    assert set(found) >= {3, 12, 20, 21}
    assert len(found) <= 5
    true = fit.model.linearise(fit.model.start(TRUE))
    found = presses_apart(fit.model, true)
    assert found.tolist() == [3, 12, 20, 21]
    assert further(fit.model, true, found) == pytest.approx(0.15, abs=0.03)


@pytest.mark.parametrize("slipped", [(3, 12, 20, 21), (6, 7, 8), (0, 24)])
def test_a_comparison_names_the_presses_that_slipped_and_no_other(slipped):
    factor = np.ones(25)
    factor[list(slipped)] = 1.12
    comparison = compare_residual(whitened_fit(fitted(factor), measured(factor)))
    assert comparison.bad_presses == slipped


def test_of_presses_left_out_those_that_slipped_are_missed():
    """Two that slipped and two that did not, beside the true map and one fitted to the others."""
    factor = np.ones(25)
    factor[[3, 20]] = 1.12
    fit = fitted(factor)
    true = fit.model.linearise(fit.model.start(TRUE))
    left_out = np.array([3, 8, 20, 23])
    assert missed(fit.model, true, left_out).tolist() == [True, False, True, False]


def test_presses_apart_are_found_beside_an_effect_of_all():
    """A gain that falls along the scan hides them: no map meets the others without it."""
    factor = np.ones(25)
    factor[[3, 12, 20, 21]] = 1.15
    falls = np.linspace(-0.1, 0.1, 25)
    fit = fitted(factor * (1 + falls))
    true = fit.model.linearise(fit.model.start(TRUE))
    press = fit.model.readings.press
    column = true.whitened(fit.model.by_log_compliance(true), press) * falls[press]
    assert len(presses_apart(fit.model, true)) == 0
    other = true.whitened(fit.model.by_log_compliance(true), press) * np.cos(press)
    found = presses_apart(fit.model, true, beside=[other[:, None], column[:, None]])
    assert found.tolist() == [3, 12, 20, 21]


def test_of_noise_no_press_stands_apart():
    fit = fitted(np.ones(25))
    assert len(presses_apart(fit.model, fit.at)) == 0


def test_where_no_map_meets_the_presses_none_stands_apart():
    rng = np.random.default_rng(2)
    fit = fitted(np.exp(0.2 * rng.standard_normal(25)))
    assert len(presses_apart(fit.model, fit.at)) == 0
    assert TRIMMED.scale < 10
