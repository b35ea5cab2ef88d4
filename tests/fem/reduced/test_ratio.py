"""Ratios of two models' compliances in reduced bases, against full solutions of both."""

import numpy as np
import pytest

from fem import PalpationModel, block_mesh
from fem.mesh import moved_sides
from fem.reduced import Body, ReducedRatio
from tests.fem.reduced.test_fibres import fibres
from tests.fem.reduced.test_reduced import CENTRE, HALF, contacts, drawn, field


@pytest.fixture(scope="module")
def models():
    """A block, the block 4 mm further on, and one of another Poisson's ratio."""
    mesh = block_mesh((0.04, 0.04, 0.024), (3, 3, 2))
    own = PalpationModel(mesh, 0.49, contacts())
    return own, own.on(moved_sides(mesh, (0.004, 0.0))), PalpationModel(mesh, 0.45, contacts())


LAWS = {
    "plain": {},
    "springs": {"support_compliance": (1e-6, 5e-7)},
    "slides": {"support_compliance": (0.0, np.inf)},
    "skin": {"skin": (1e-3, 4.0)},
    "fibres": {"fibres": (0.5, 0.3)},
}


def body(parameters, law):
    """Return what makes the body for any model."""

    def of(model) -> Body:
        modulus = field(parameters, model.points_m)
        along = {"fibres": fibres(*law["fibres"], modulus)} if "fibres" in law else {}
        return Body(modulus, **{**law, **along})

    return of


def solved(models, of):
    return [model.evaluate(*of(model)) for model in models]


def grown(models, bodies, law) -> ReducedRatio:
    ratio = ReducedRatio(models[0], fibres="fibres" in law)
    for number, of in enumerate(bodies):
        own, *others = solved(models, of)
        for name, other in zip(("moved", "softer"), others, strict=True):
            ratio.add(name, number, own, other)
    return ratio


def nearby(scale: float, count: int, seed: int):
    return CENTRE + scale * (drawn(count, seed) - CENTRE)


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)
@pytest.mark.parametrize("scale", [0.2, 1.0])
def test_the_error_of_a_ratio_is_small_and_within_its_estimate(models, law, scale):
    count = 3
    ratio = grown(models, [body(one, law) for one in nearby(scale, count, 1)], law)
    for number, parameters in enumerate(nearby(scale, 3, 2)):
        of = body(parameters, law)
        own, *others = solved(models, of)
        for name, other in zip(("moved", "softer"), others, strict=True):
            numbers = ratio._others[name].numbers
            alone = ratio._own.evaluate(of(models[0]), among=numbers, rests=True)
            assert alone is not None
            off = np.abs(own.compliance / alone.compliance - 1).max()
            exact = np.log(other.compliance / own.compliance)
            found = ratio.log_at(name, ("there", number), of, 1.0)
            assert found is not None
            error = np.abs(found - exact).max()
            assert error < 0.4 * off + 1e-7
            assert ratio.log_at(name, ("there", number), of, 0.8 * error) is None


def test_solutions_too_much_alike_are_no_false_certainty(models):
    """Their energies in single precision leave rounding in place of a second direction."""
    places = [CENTRE + 1e-3 * HALF * factor for factor in (0.0, 1.0, 1.1, 1.2)]
    ratio = grown(models, [body(one, {}) for one in places], {})
    for size in (1e-3, 0.1, 1.0):
        of = body(CENTRE - size * HALF, {})
        own, moved, _ = solved(models, of)
        exact = np.log(moved.compliance / own.compliance)
        found = ratio.log_at("moved", size, of, np.inf)
        assert found is not None
        error = np.abs(found - exact).max()
        assert ratio.log_at("moved", size, of, 0.5 * error) is None


def test_a_model_that_is_new_or_has_no_solution_in_common_has_no_ratio(models):
    ratio = ReducedRatio(models[0])
    places = nearby(1.0, 8, 3)
    bodies = [body(one, {}) for one in places]
    own, moved, _ = solved(models, bodies[0])
    assert ratio.log_at("moved", 0, bodies[0], np.inf) is None
    ratio.add("moved", 0, own, moved)
    exact = np.log(moved.compliance / own.compliance)
    assert ratio.log_at("moved", 0, bodies[0], 1e-5) == pytest.approx(exact, abs=1e-6)
    assert ratio.log_at("softer", 0, bodies[0], np.inf) is None
    for number, of in enumerate(bodies[1:], 1):  # the solutions in common go
        own, _, softer = solved(models, of)
        ratio.add("softer", number, own, softer)
    assert ratio.log_at("moved", 0, bodies[0], np.inf) is None
    own, moved, _ = solved(models, bodies[7])
    ratio.add("moved", 7, own, moved)
    exact = np.log(moved.compliance / own.compliance)
    assert ratio.log_at("moved", 7, bodies[7], 1e-5) == pytest.approx(exact, abs=1e-6)


def test_the_middle_of_both_bounds_is_nearer_than_the_lower_ones(models):
    ratio = grown(models, [body(one, {}) for one in nearby(1.0, 3, 1)], {})
    middle, lower = [], []
    for number, parameters in enumerate(nearby(1.0, 6, 4)):
        of = body(parameters, {})
        own, moved, _ = solved(models, of)
        exact = np.log(moved.compliance / own.compliance)
        found = ratio.estimated("moved", number, of)
        assert found is not None
        middle.append(found[0] - exact)
        low = [m.evaluate(of(m.full)) for m in (ratio._own, ratio._others["moved"])]
        assert low[0] is not None
        assert low[1] is not None
        lower.append(np.log(low[1].compliance / low[0].compliance) - exact)
    assert np.sqrt(np.mean(np.square(middle))) < 0.7 * np.sqrt(np.mean(np.square(lower)))


def test_a_body_is_solved_once_for_all_other_models(models):
    ratio = grown(models, [body(one, {}) for one in nearby(1.0, 2, 1)], {})
    assert len(ratio._own) == 2
    assert ratio.model("moved") is models[1]
    assert ratio.model("another") is None
