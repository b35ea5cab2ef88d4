"""Each statistic of the residual agrees with its closed form or with plain simulation."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import stats

from identify.residual.compare import compare_residual
from identify.residual.hypothesis_tests import (
    holm,
    lag_test,
    largest_test,
    moran_test,
    nearest_neighbours,
    orthonormal,
    positive_probability,
    project_out,
    score_test,
)
from identify.residual.statement import sigmas
from identify.residual.whitened import Whitened
from models.errors import InputError
from models.scan import Scan


@pytest.mark.parametrize("ratio", [0.2, 1.0, 3.0])
def test_the_saddlepoint_gives_the_f_distribution(ratio):
    """x2(3) - ratio x2(5) > 0 is F(3, 5) > 5 ratio / 3."""
    weights = np.concatenate([np.ones(3), np.full(5, -ratio)])
    exact = stats.f.sf(5 * ratio / 3, 3, 5)
    assert_allclose(positive_probability(weights), exact, rtol=0.06)


def test_the_saddlepoint_holds_far_in_the_tail():
    weights = np.concatenate([np.ones(10), np.full(60, -2.0)])
    exact = stats.f.sf(12.0, 10, 60)
    assert exact < 1e-10
    assert_allclose(positive_probability(weights), exact, rtol=0.1)


def test_the_saddlepoint_is_one_half_for_a_symmetric_form():
    assert positive_probability(np.array([2.0, 1, -1, -2])) == pytest.approx(0.5, abs=1e-6)
    assert positive_probability(np.array([1.0, 0.5])) == 1.0
    assert positive_probability(np.array([-1.0, -0.5])) == 0.0


def test_the_score_is_the_drop_of_chi_square_in_a_refit():
    rng = np.random.default_rng(0)
    residual, nuisance, directions = (rng.normal(size=s) for s in ((60,), (60, 3), (60, 4)))
    both = np.hstack([nuisance, directions])

    def chi2(columns):
        return np.sum((residual - columns @ np.linalg.lstsq(columns, residual, rcond=None)[0]) ** 2)

    found = score_test(residual, directions * [1, 1e-6, 1e6, 1], orthonormal(nuisance))
    assert_allclose(found.statistic, chi2(nuisance) - chi2(both), rtol=1e-6)
    assert found.dof == 4


def test_directions_that_the_fit_absorbs_cost_no_degree_of_freedom():
    rng = np.random.default_rng(1)
    nuisance = rng.normal(size=(50, 3))
    found = score_test(
        rng.normal(size=50), nuisance @ rng.normal(size=(3, 2)), orthonormal(nuisance)
    )
    assert found.dof == 0
    assert found.p_value == 1.0


@pytest.mark.slow
def test_moran_matches_simulation_under_a_projection():
    rng = np.random.default_rng(2)
    points = rng.uniform(size=(30, 3)) * [1, 1, 0]
    neighbours = nearest_neighbours(points)
    basis = orthonormal(np.column_stack([np.ones(30), points[:, 0], points[:, 1] ** 2]))
    covariance = np.eye(30) - basis @ basis.T
    draws = project_out(basis, rng.normal(size=(30, 4000)))
    results = [moran_test(z, covariance, neighbours) for z in draws.T]
    assert_allclose(np.mean([r.moran_i for r in results]), results[0].expected, atol=0.01)
    p = np.array([r.p_value for r in results])
    for level in (0.5, 0.05, 0.01):
        assert_allclose(np.mean(p < level), level, atol=4 * np.sqrt(level / 4000))


def test_the_lag_test_counts_what_the_projection_does():
    rng = np.random.default_rng(3)
    follows = np.tile(np.arange(8) > 0, 10)
    steps = np.repeat(np.arange(10), 8)
    basis = orthonormal((steps[:, None] == np.arange(10)).astype(float))
    z = [lag_test(project_out(basis, rng.normal(size=80)), follows, basis).z for _ in range(3000)]
    # Ten means taken away bias the raw product by -70 / 8, which is one standard deviation.
    assert_allclose(np.mean(z), 0, atol=0.08)
    assert_allclose(np.std(z), 1, atol=0.08)


def test_the_lag_test_measures_the_correlation():
    rng = np.random.default_rng(4)
    noise = rng.normal(size=4001)
    residual = noise[1:] + 0.5 * noise[:-1]
    found = lag_test(residual, np.arange(4000) > 0, np.empty((4000, 0)))
    assert_allclose(found.value, 0.5 / 1.25, atol=0.05)
    assert found.p_value < 1e-50


def test_the_largest_of_many_is_judged_as_such():
    # Two-sided 1 - (1 - 2 sf(4))^1000.
    exact = 1 - (1 - 2 * stats.norm.sf(4)) ** 1000
    assert_allclose(largest_test(np.r_[4.0, np.zeros(999)]), exact, rtol=1e-6)


def test_holm_is_bonferroni_for_the_smallest_and_never_falls():
    adjusted = holm([0.001, 0.5, 0.02])
    assert_allclose(adjusted, [0.003, 0.5, 0.04])


def small_comparison(shared_m=0.0):
    rng = np.random.default_rng(5)
    j, n = 12, 6
    press = np.repeat(3 + 2 * np.arange(j), n)
    points = np.column_stack([np.arange(j) % 4, np.arange(j) // 4, np.zeros(j)]) * 0.01
    force = np.tile(np.linspace(0.1, 1, n), j)
    scan = Scan(
        press, np.arange(j * n) * 0.1, np.full(j * n, "load"), np.repeat(points, n, axis=0),
        np.tile([0, 0, -1.0], (j * n, 1)), force, 0.01 * force, np.full(j * n, 0.005),
    )  # fmt: skip
    sigma = np.full(j * n, 2e-5)
    residual = rng.normal(0, sigma)
    w = Whitened(scan, residual, sigma, force, force[:, None] / 2e-5, False, shared_m=shared_m)
    return compare_residual(w)


def test_a_comparison_is_written_whole(tmp_path):
    comparison = small_comparison()
    comparison.write(tmp_path / "comparison.json")
    written = json.loads((tmp_path / "comparison.json").read_text())
    assert written == json.loads(json.dumps(comparison.to_dict()))
    assert [p["press"] for p in written["presses"]] == list(range(3, 27, 2))


def test_the_noise_expected_of_a_residual_has_the_shared_errors_in_it():
    sharp, unsure = small_comparison(), small_comparison(shared_m=5e-5)
    assert_allclose(unsure.expected_rms_m, np.hypot(sharp.expected_rms_m, 5e-5))


def test_fewer_readings_than_parameters_are_refused():
    scan = Scan(
        np.array([0, 0]), np.array([0.0, 1.0]), np.array(["load", "load"]), np.zeros((2, 3)),
        np.tile([0, 0, -1.0], (2, 1)), np.array([1.0, 2.0]), np.array([1.0, 2.0]), np.ones(2),
    )  # fmt: skip
    w = Whitened(scan, np.zeros(2), np.ones(2), np.array([1.0, 2.0]), np.eye(2), False)
    with pytest.raises(InputError, match="cannot be compared"):
        compare_residual(w)


def test_a_misfit_beyond_all_chance_is_not_said_as_a_number():
    press = small_comparison().presses[0]
    assert sigmas(replace(press, sigmas=4.21)) == "4.2"
    assert sigmas(replace(press, sigmas=36.94), ".1f") == "36.9"
    for digits in (".2g", ".1f"):
        assert sigmas(replace(press, sigmas=37.07), digits) == "> 37"
