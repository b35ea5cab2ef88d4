"""The mechanics behind a measurement model, against models that were built for the state asked."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial import cKDTree

from fem import PalpationModel, RefinedModel, block_mesh
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.parameters import parameter_space
from identify.optimize.result import InadmissibleError
from tests.identify.select import loop_problem as problem


@pytest.mark.slow
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
    changed, left = np.abs(own.correction.ratio / (exact / coarse) - 1), np.abs(found / exact - 1)
    assert np.abs(exact / known - 1).max() > 0.03  # the ratio matters
    assert np.median(changed) > 1e-3  # and so does what it makes of the mesh's error
    assert np.median(left) < 0.4 * np.median(changed)
    assert left.max() < 0.5 * changed.max()


@pytest.mark.parametrize(("nu", "step"), [(problem.NU, -2e-3), (0.483, 5e-4), (0.4935, 2e-4)])
def test_first_order_change_of_poissons_ratio_is_that_of_the_carried_model(nu, step):
    own = problem.mechanics()
    at = own.evaluate(problem.TRUE, own.state().changed(poisson_ratio=nu))
    predicted, _ = at.change(own.state().changed(poisson_ratio=nu + step))
    found, _ = at.exact_change(own.state().changed(poisson_ratio=nu + step))
    np.testing.assert_allclose(predicted, found, rtol=0.03, atol=1e-3 * np.abs(found).max())


def hole(background: float) -> GaussianMap:
    """A soft inclusion where only the finer mesh has a point; 10 Pa are left at coarse ones."""
    own = problem.mechanics()
    points = own.fine.fine.points_m  # pyright: ignore[reportOptionalMemberAccess, reportAttributeAccessIssue]
    inside = points[(np.abs(points - [0.03, 0.03, 0.018]) < 0.01).all(axis=1)]
    x, y, z = inside[cKDTree(own.coarse.points_m).query(inside)[0].argmax()].tolist()
    place = Inclusion(-1.0, x, y, z, 0.008)
    depth = -GaussianMap(0.0, (place,)).modulus(own.coarse.points_m).min()
    return GaussianMap(background, (replace(place, weight_pa=-(background - 10.0) / depth),))


def test_a_soft_inclusion_may_be_softest_between_the_coarse_meshs_points():
    own, stiffness = problem.mechanics(), hole(5000.0)
    assert stiffness.modulus(own.coarse.points_m).min() == pytest.approx(10.0)
    assert stiffness.modulus(own.fine.points_m).min() < 0  # pyright: ignore[reportOptionalMemberAccess]
    carried = own.corrected(stiffness, own.state())
    assert np.abs(np.log(carried.correction.ratio)).max() < 0.1
    with pytest.raises(InadmissibleError, match="positive everywhere"):
        own.corrected(replace(stiffness, background_pa=4900.0), own.state())


def test_a_soft_inclusion_is_at_most_as_good_as_a_hole():
    soft = GaussianMap(6e3, (replace(problem.TRUE.inclusions[0], weight_pa=-2e3),))
    weight = parameter_space(soft, np.array([[0, 0, 0], problem.SIZE])).parameters[1]
    assert (weight.name, weight.lower, weight.upper) == ("inclusion_1.weight_pa", -5700.0, 0.0)


def test_at_a_ratio_with_a_model_no_other_one_is_built():
    own, built = problem.mechanics(), []

    def at(nu: float) -> PalpationModel:
        built.append(nu)
        return own.at_poisson_ratio(nu)

    counting = replace(own, at_poisson_ratio=at, _others={}, _ratios={}, _reduced_ratios={})
    node = own.settings.poisson_ratios[5]
    counting.evaluate(problem.TRUE, own.state().changed(poisson_ratio=node))
    assert built == [node]


def test_a_change_is_solved_once_unless_it_is_asked_for_more_exactly(monkeypatch):
    own, solved = problem.mechanics(), []
    at = own.evaluate(problem.TRUE, own.state())
    evaluate = type(own).evaluate

    def counted(self, stiffness, state, slack=0.0):
        solved.append(slack)
        return evaluate(self, stiffness, state, slack)

    monkeypatch.setattr(type(own), "evaluate", counted)
    there = own.state().changed(base_normal_m_per_pa=1e-7)
    changes = [at.exact_change(there, slack)[0] for slack in (10.0, 100.0, 10.0, 0.0, 1.0)]
    assert solved == [10.0, 0.0]
    np.testing.assert_array_equal(changes[0], changes[1])
    np.testing.assert_array_equal(changes[3], changes[4])
