"""The mechanics behind a measurement model, against models that were built for the state asked."""

import loop_problem as problem
import numpy as np

from fem import PalpationModel, RefinedModel, block_mesh


def test_another_poisson_ratio_has_the_finer_models_compliance_too():
    """The coarse mesh's error depends on it; what carries it to the finer mesh must follow."""
    nu = 0.40
    own = problem.mechanics()
    found = own.evaluate(problem.TRUE, own.state().changed(poisson_ratio=nu)).compliance
    known = own.evaluate(problem.TRUE, own.state()).compliance
    pair = RefinedModel(
        own.at_poisson_ratio(nu),
        PalpationModel(block_mesh(problem.SIZE, (8, 8, 5)), nu, problem.contacts()),
    )
    exact = pair.evaluate(problem.TRUE.modulus(pair.points_m)).compliance
    coarse = pair.coarse.evaluate(problem.TRUE.modulus(pair.coarse.points_m)).compliance
    changed, left = np.abs(own.ratio / (exact / coarse) - 1), np.abs(found / exact - 1)
    assert np.abs(exact / known - 1).max() > 0.03  # the ratio matters
    assert np.median(changed) > 1e-3  # and so does what it makes of the mesh's error
    assert np.median(left) < 0.4 * np.median(changed)
    assert left.max() < 0.5 * changed.max()


def test_first_order_change_of_poissons_ratio_is_that_of_the_carried_model():
    own = problem.mechanics()
    at = own.evaluate(problem.TRUE, own.state())
    step = 2e-3
    predicted, _ = at.change(own.state().changed(poisson_ratio=problem.NU - step))
    found, _ = at.exact_change(own.state().changed(poisson_ratio=problem.NU - step))
    np.testing.assert_allclose(predicted, found, rtol=0.03, atol=1e-3 * np.abs(found).max())
