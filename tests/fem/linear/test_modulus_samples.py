"""The modulus between its samples around the tips: positive, and one in all that use it."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, SolverError, block_mesh
from fem.linear.modulus_samples import CLOSE_RULE, QuadraticModulus, at_rule
from fem.palpation.model import _solve_definite

STEEP = np.exp(np.random.default_rng(3).normal(0, 1, (40, 10)))  # up to 1 : 100 within a cell


def test_a_quadratic_through_mild_samples_is_left_alone():
    mild = np.random.default_rng(1).uniform(1, 2, (20, 10))
    np.testing.assert_array_equal(QuadraticModulus(mild).values, mild)
    by_value = np.random.default_rng(2).normal(size=(3, 20, 10))
    np.testing.assert_array_equal(QuadraticModulus(mild).by_asked(by_value), by_value)


def test_a_quadratic_through_steep_samples_stays_positive_and_keeps_the_cells_mean():
    limited = QuadraticModulus(STEEP).values
    raw, found = at_rule(STEEP), at_rule(limited)
    fallen = raw.min(axis=1) < 0
    assert 5 < fallen.sum() < 40
    assert (found.min(axis=1) > 0.049 * STEEP.min(axis=1)).all()
    np.testing.assert_allclose(found @ CLOSE_RULE[1], raw @ CLOSE_RULE[1], rtol=1e-12)
    np.testing.assert_allclose(found[fallen].min(axis=1), 0.05 * STEEP[fallen].min(axis=1))


def test_derivatives_are_taken_through_the_limit():
    rng = np.random.default_rng(4)
    by_value, step = rng.normal(size=(3, *STEEP.shape)), 1e-6 * STEEP * rng.normal(size=STEEP.shape)
    up, down = (by_value * QuadraticModulus(STEEP + h).values for h in (step, -step))
    expected = ((up - down) / 2).sum(axis=2)  # cell by cell
    found = (QuadraticModulus(STEEP).by_asked(by_value) * step).sum(axis=2)
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-7 * abs(expected).max())


@pytest.fixture(scope="module")
def model() -> PalpationModel:
    points = [(0.03, 0.03, 0.036), (0.036, 0.042, 0.036)]
    mesh = block_mesh((0.072, 0.072, 0.036), (6, 6, 3))
    return PalpationModel(mesh, 0.49, Contacts(points, (0, 0, -1), 0.005))


@pytest.mark.parametrize(("hard", "radius"), [(100, 0.0032), (50, 0.0032), (30, 0.0035)])
def test_under_a_small_hard_inclusion_the_gradient_is_that_of_the_compliance(model, hard, radius):
    def modulus(scale: float, x: float) -> np.ndarray:
        distance = ((model.points_m - [x, 0.033, 0.031]) ** 2).sum(axis=1)
        return 6e3 * (1 + scale * hard * np.exp(-distance / (2 * radius**2)))

    samples = modulus(1, 0.032)
    close = samples[len(model.stiffness.points_m) : -len(model.contacts)].reshape(-1, 10)
    assert (at_rule(close).min(axis=1) < 0).any()
    response = model.evaluate(samples)
    # twice the energy, sample by sample, is the work of the unit force
    np.testing.assert_allclose(response.sensitivity @ samples, -response.compliance, rtol=1e-6)
    for up, down in (
        (modulus(1 + 1e-5, 0.032), modulus(1 - 1e-5, 0.032)),
        (modulus(1, 0.032 + 1e-8), modulus(1, 0.032 - 1e-8)),
    ):
        change = model.evaluate(up).compliance - model.evaluate(down).compliance
        slope = response.sensitivity @ (up - down)
        np.testing.assert_allclose(slope, change, rtol=1e-5, atol=1e-5 * abs(change).max())


def test_a_near_field_without_positive_energy_is_refused():
    with pytest.raises(SolverError, match="the map is finer than the mesh"):
        _solve_definite(np.array([np.eye(2), [[1.0, 2.0], [2.0, 1.0]]]), np.ones((2, 2)))
