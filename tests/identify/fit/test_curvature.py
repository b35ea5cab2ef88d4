"""What a curved model leaves of its residual on average, taken off before effects score."""

from dataclasses import replace

import numpy as np
import pytest

from identify.fit.curvature_bias import expected_residual
from identify.fit.joint_fit import fit_jointly
from identify.optimize.result import InadmissibleError
from identify.select.score_test import fitted_basis
from tests.identify.select.loop_problem import NOISE, TRUE, model
from tests.identify.select.test_null import body, compliance, null_scan, timing

ANYWHERE = (np.full(2, -np.inf), np.full(2, np.inf))


def test_the_mean_residual_of_a_decay_is_that_of_many_noises():
    """Cook, Tsai, Wei: of y = a exp(-b t), against the mean over pairs of noises +e and -e."""
    t = np.linspace(0.0, 2.0, 12)
    true, sigma = np.array([1.0, 1.2]), 0.1

    def prediction(p):
        return p[..., :1] * np.exp(-p[..., 1:] * t) / sigma

    def slope(p):
        e = np.exp(-p[..., 1:] * t) / sigma
        return np.stack([e, -p[..., :1] * t * e], axis=-1)

    def left(noises):
        data, p = prediction(true) + noises, np.tile(true, (len(noises), 1))
        for _ in range(20):
            jac = slope(p)
            across = jac.swapaxes(1, 2)
            p += np.linalg.solve(across @ jac, across @ (data - prediction(p))[..., None])[..., 0]
        return data - prediction(p)

    rng = np.random.default_rng(0)
    noises = rng.standard_normal((4000, len(t)))
    mean = (left(noises) + left(-noises)).mean(axis=0) / 2
    jac = slope(true)
    predicted = expected_residual(
        lambda p: -prediction(p), true, -prediction(true), np.linalg.inv(jac.T @ jac), ANYWHERE
    )
    basis = np.linalg.qr(jac)[0]
    predicted = predicted - basis @ (basis.T @ predicted)
    assert np.linalg.norm(mean) > 0.03
    assert np.linalg.norm(mean - predicted) < 0.1 * np.linalg.norm(mean)


@pytest.mark.slow
def test_a_map_leaves_what_its_curvature_says():
    """Pairs of scans with opposite noise: what is odd in the noise drops out of their mean."""
    press, _, _, force = timing(0)
    exact = compliance()[press] * force
    means = []
    for seed in range(40):
        one = null_scan(seed)
        other = replace(
            one,
            force_n=2 * force - one.force_n,
            displacement_m=2 * exact - one.displacement_m,
        )
        assert np.std(one.force_n - force) == pytest.approx(NOISE.force_n, rel=0.15)
        pair = [fit_jointly(model(table, body()), TRUE) for table in (one, other)]
        basis = fitted_basis(pair[0].at)
        shift = pair[0].expected_residual
        shift = shift - basis @ (basis.T @ shift)
        along = shift / np.linalg.norm(shift)
        mean = sum(along @ fit.at.residual for fit in pair) / 2
        means.append((mean, np.linalg.norm(shift)))
    found, expected = np.mean(means, axis=0)
    error = np.std([m for m, _ in means]) / np.sqrt(len(means))
    assert found > 3 * error
    assert found == pytest.approx(expected, abs=3 * error)


def test_what_is_straight_impossible_or_at_a_bound_says_nothing():
    asked = []

    def residual(u):
        asked.append(u)
        if u[0] > 1.2:
            raise InadmissibleError("no body")
        return -np.exp(u)

    def expected(variances, bounds=ANYWHERE):
        here = -np.exp(np.ones(2))
        return expected_residual(residual, np.ones(2), here, np.diag(variances), bounds)

    assert not expected([1e-5, 1e-5]).any()
    assert not asked
    assert not expected([1.0, 1e-5]).any()
    # A coordinate that is left open counts as known to half a unit
    assert expected([1e-5, 1e20])[1] == pytest.approx(-np.e * (np.cosh(0.5) - 1))
    assert not expected([1e-5, 1.0], (np.array([-9.0, 1.0]), np.full(2, 9.0))).any()
    near = expected([1e-5, 1.0], (np.array([-9.0, 0.9]), np.full(2, 9.0)))
    assert near[1] == pytest.approx(-np.e * (np.cosh(0.1) - 1))
