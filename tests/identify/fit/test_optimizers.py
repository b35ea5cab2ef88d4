"""BFGS and Gauss-Newton: convergence, bounds, and trials at which the model has no answer."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem.errors import SolverError
from identify.fit.joint_fit import fit_jointly
from identify.fit.settings import TRIAL
from identify.optimize.bfgs import minimize_bfgs, minimize_bfgs_residuals
from identify.optimize.gauss_newton import covariance, minimize_gauss_newton
from identify.optimize.line_search import Trial, wolfe_step
from identify.optimize.optimizers import OPTIMIZERS
from identify.optimize.result import InadmissibleError
from tests.identify.select.loop_problem import TRUE, model, scan, timing, true_compliance

both = pytest.mark.parametrize("minimize", OPTIMIZERS.values(), ids=OPTIMIZERS.keys())


def rosenbrock(x):
    r = np.array([10 * (x[1] - x[0] ** 2), 1 - x[0]])
    return r, np.array([[-20 * x[0], 10.0], [-1.0, 0.0]])


def linear(x):
    """A least-squares problem whose minimum is at (2, -1), its coordinates coupled."""
    a = np.array([[1.0, 0.5], [0.5, 3.0], [0.2, -1.0]])
    return a @ (x - np.array([2.0, -1.0])), a


@both
def test_the_minimum_of_a_curved_valley_is_found(minimize):
    result = minimize(rosenbrock, np.array([-1.2, 1.0]), ftol=1e-18)
    assert result.success
    assert result.status == 0
    assert_allclose(result.x, [1, 1], atol=1e-7)
    assert result.nfev < 80


@both
def test_a_minimum_outside_the_bounds_is_found_on_them(minimize):
    lower, upper = np.array([-5.0, -5.0]), np.array([1.0, 5.0])
    result = minimize(linear, np.array([0.0, 0.0]), bounds=(lower, upper), ftol=1e-18)
    a = linear(np.zeros(2))[1]
    # On the bound x = 1 the rest is least squares in y alone.
    y = -1.0 + a[:, 1] @ a[:, 0] * (2.0 - 1.0) / (a[:, 1] @ a[:, 1])
    assert result.success
    assert_allclose(result.x, [1.0, y], atol=1e-7)


@both
def test_no_trial_leaves_the_bounds(minimize):
    lower, upper = np.array([-1.5, -0.2]), np.array([0.8, 1.2])
    seen = []

    def watched(x):
        seen.append(x.copy())
        return rosenbrock(x)

    minimize(watched, np.array([-1.2, 1.0]), bounds=(lower, upper))
    assert np.all(np.array(seen) >= lower)
    assert np.all(np.array(seen) <= upper)


def forbidden(kind):
    """ln(x) = ln(1/50) from x = 1: the first Newton step goes to x < 0."""

    def residuals(x):
        if x[0] <= 0:
            if kind is None:
                return np.array([np.nan]), np.array([[1.0]])
            raise kind("no answer")
        return np.log(x * 50), 1 / x[:, None]

    return residuals


@both
@pytest.mark.parametrize("kind", [InadmissibleError, SolverError, None])
def test_a_trial_without_an_answer_is_a_failed_step(minimize, kind):
    failed = []

    def watched(x):
        failed.append(x[0] <= 0)
        return forbidden(kind)(x)

    result = minimize(watched, np.array([1.0]), ftol=1e-18)
    assert any(failed)
    assert result.success
    assert_allclose(result.x, [0.02], rtol=1e-6)


@both
def test_a_start_without_an_answer_is_an_error(minimize):
    with pytest.raises(InadmissibleError):
        minimize(forbidden(None), np.array([-1.0]))


@both
def test_every_accepted_step_lowers_the_misfit(minimize):
    values = []
    minimize(rosenbrock, np.array([-1.2, 1.0]), callback=lambda x, fun: values.append(fun))
    assert len(values) > 5
    assert np.all(np.diff(values) < 0)


@both
def test_the_limit_of_evaluations_is_kept_and_said(minimize):
    result = minimize(rosenbrock, np.array([-1.2, 1.0]), max_evaluations=4)
    assert not result.success
    assert result.status == 1
    assert "4 evaluations" in result.message


@both
def test_what_a_gross_misfit_exceeds_decides_when_to_stop(minimize):
    def misfitting(x):
        r, jac = rosenbrock(x)
        return np.append(r, 1e3), np.vstack([jac, np.zeros(2)])

    start = np.array([-1.2, 1.0])
    to_the_end = minimize(misfitting, start, ftol=1e-12)
    sooner = minimize(misfitting, start, ftol=1e-12, rtol=1e-6)
    assert sooner.success
    assert sooner.nfev < to_the_end.nfev
    assert sooner.fun - to_the_end.fun < 1e-5 * to_the_end.fun
    # A value that is not gross is followed to its end.
    ordinary = minimize(misfitting, start, ftol=1e-12, rtol=1e-6, above=6e5)
    assert ordinary.nfev == to_the_end.nfev
    assert_allclose(ordinary.x, to_the_end.x)


def test_gauss_newton_stops_where_steps_keep_less_than_they_promise():
    def promising(x):
        """The second residual's zero, which its slope promises, does not exist."""
        return np.append(100.0, 1 + x**2), np.array([[0.0], [2 * x[0]]])

    assert not minimize_gauss_newton(promising, np.array([1.5]), ftol=1e-6).success
    result = minimize_gauss_newton(promising, np.array([1.5]), ftol=1e-6, rtol=1e-5)
    assert result.success
    assert result.nfev < 30
    assert result.fun - 5000.5 < 0.1


def test_the_first_step_of_bfgs_is_bounded_however_steep_the_function():
    seen = []

    def steep(x):
        seen.append(x.copy())
        return 0.5e6 * float(x @ x), 1e6 * x

    minimize_bfgs(steep, np.array([3.0, -1.0]), first_step=0.05, gtol=1e-3)
    assert np.abs(seen[1] - seen[0]).max() == pytest.approx(0.05)


def test_bfgs_converges_faster_than_linearly_on_scales_apart():
    scales = np.array([1.0, 30.0, 400.0, 3000.0])
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(4, 4)))[0]
    result = minimize_bfgs_residuals(
        lambda x: (np.sqrt(scales) * (turn @ x), np.sqrt(scales)[:, None] * turn),
        np.array([0.7, -0.4, 0.2, 0.9]),
        ftol=1e-16,
    )
    # Steepest descent needs thousands of steps at a condition number of 3000.
    assert result.success
    assert result.nfev < 40
    assert np.abs(result.x).max() < 1e-6


def test_the_line_search_meets_the_wolfe_conditions():
    def evaluate(step):
        value, slope = (step - 3.0) ** 4 - 81.0, 4 * (step - 3.0) ** 3
        return Trial(step, np.array([step]), value, np.array([slope]), slope)

    start = evaluate(0.0)
    found = wolfe_step(evaluate, start, first=1e-3, longest=100.0)
    assert found is not None
    assert found.fun <= start.fun + 1e-4 * found.step * start.slope
    assert found.slope >= 0.9 * start.slope


def test_the_covariance_is_the_inverse_of_the_normal_matrix():
    jac = np.random.default_rng(2).normal(size=(30, 4))
    scale = np.array([1.0, 1e3, 1e-4, 10.0])
    found = covariance(jac * scale) * np.outer(scale, scale)
    assert_allclose(found @ (jac.T @ jac), np.eye(4), atol=1e-12)


def test_what_the_data_do_not_determine_has_a_huge_variance():
    jac = np.random.default_rng(2).normal(size=(30, 3))
    jac[:, 2] = 0.0
    found = covariance(jac)
    assert found[2, 2] > 1e20
    assert_allclose(found[:2, :2], covariance(jac[:, :2]), rtol=1e-9)


def test_gauss_newton_is_quadratic_near_a_perfect_fit():
    values = []
    minimize_gauss_newton(
        rosenbrock, np.array([0.9, 0.8]), ftol=1e-28, callback=lambda x, fun: values.append(fun)
    )
    assert len(values) < 10
    assert values[-1] < 1e-25


def test_a_promise_within_the_rounding_of_evaluations_ends_a_search():
    start = np.array([2.02, -1.01])

    def rounded(x):
        r, a = linear(x)
        rise = 0.0 if np.array_equal(x, start) else 0.1
        return np.append(r, rise), np.vstack([a, np.zeros(2)])

    found = minimize_gauss_newton(rounded, start, ftol=1e-6)
    assert found.success
    assert "would lower chi-square by less than" in found.message
    found = minimize_gauss_newton(rounded, start, ftol=1e-6, resolved=1e-5)
    assert not found.success
    assert found.message == "no step lowers chi-square"


@pytest.mark.parametrize(("above", "evaluations"), [(1.0, 1), (51.5, 2)])
def test_a_search_that_cannot_reach_a_value_is_given_up(above, evaluations):
    """From 52 the next step promises 2: a part of 2 that is missing, or none of 51."""

    def residuals(x):
        return np.array([x[0], 10.0]), np.array([[1.0], [0.0]])

    found = minimize_gauss_newton(
        residuals, np.array([2.0]), max_step=10.0, reach=0.4, above=above, max_evaluations=2
    )
    assert found.nfev == evaluations
    assert found.success == (evaluations == 1)


def test_a_fit_ends_where_its_target_is_out_of_reach_and_goes_on_where_it_is_near():
    press, _, _, force = timing(3)
    table = scan(true_compliance()[press] * force + 5e-4, force, 3)

    def fit(target):
        return fit_jointly(model(table), TRUE, rounds=0, target=target, settings=TRIAL)

    free = fit(None)
    far, near = fit(0.5 * free.chi2), fit(free.chi2 - 1.0)
    assert len(far.history) < len(free.history) / 3
    assert far.chi2 < 1.05 * free.chi2
    assert near.chi2 == pytest.approx(free.chi2, abs=10.0)
    assert len(near.history) > len(far.history)
