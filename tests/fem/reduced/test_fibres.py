"""Reduced bases of bodies with fibres against full solutions."""

import numpy as np
import pytest

from fem.palpation import fibre_weights
from fem.reduced import Body, ReducedBases, ReducedModel
from tests.fem.reduced.test_reduced import (
    CENTRE,
    HALF,
    answered,
    drawn,
    field,
    full,  # noqa: F401  pyright: ignore[reportUnusedImport] - a fixture
    slopes,
    solved,
)


def fibres(angle: float, share: float, modulus):
    return np.array([np.cos(angle), np.sin(angle), 0.0]), share * modulus


@pytest.fixture(scope="module")
def with_fibres(full):  # noqa: F811
    model, modulus = ReducedModel(full, fibres=True), field(CENTRE, full.points_m)
    model.add(solved(full, CENTRE))
    for angle, share in [(0.4, 0.2), (0.9, 0.5), (0.1, 0.6)]:
        model.add(full.evaluate(modulus, fibres=fibres(angle, share, modulus)))
    for parameters in drawn(2, 1):
        modulus = field(parameters, full.points_m)
        model.add(full.evaluate(modulus, fibres=fibres(0.5, 0.4, modulus)))
    return model


@pytest.mark.parametrize(("angle", "share"), [(0.5, 0.3), (0.2, 0.5), (0.7, 0.15), (0.5, -0.1)])
def test_bodies_with_fibres_lie_between_the_bounds(full, with_fibres, angle, share):  # noqa: F811
    (parameters,) = CENTRE + 0.3 * (drawn(1, 3) - CENTRE)
    modulus = field(parameters, full.points_m)
    along = fibres(angle, share, modulus)
    found = answered(with_fibres, Body(modulus, None, along))
    expected = full.evaluate(modulus, fibres=along)
    effect = np.abs(expected.compliance / full.evaluate(modulus).compliance - 1).max()
    error = expected.compliance / found.compliance - 1
    bound = found.high / found.compliance - 1
    assert np.all(error > -2e-7)
    assert np.all(error < bound + 2e-7)
    assert np.all(bound < 12 * error)
    assert error.max() < 0.05 * effect
    slope = slopes(parameters, full.points_m)
    by_fibres = expected.fibre_sensitivity(along[0])
    exact = expected.gradient(slope) + share * by_fibres @ slope
    near = found.gradient(slope)
    assert np.all(np.abs(near - exact).max(axis=0) < 5e-2 * np.abs(exact).max(axis=0))
    moments, own = expected.fibre_moments(modulus), found.fibre_moments(modulus)
    assert np.abs(own - moments).max() < 5e-2 * np.abs(moments).max()


def test_bodies_with_fibres_are_exact_at_their_snapshots(full, with_fibres):  # noqa: F811
    modulus = field(CENTRE, full.points_m)
    for angle, share in [(0.4, 0.2), (0.9, 0.5)]:
        along = fibres(angle, share, modulus)
        found = answered(with_fibres, Body(modulus, None, along))
        expected = full.evaluate(modulus, fibres=along).compliance
        assert found.compliance == pytest.approx(expected, rel=1e-6)
        assert found.error < 1e-5


def test_derivatives_by_fibres_are_those_of_the_reduced_compliance(full, with_fibres):  # noqa: F811
    modulus = field(CENTRE + 0.1 * HALF, full.points_m)
    found = answered(with_fibres, Body(modulus, None, fibres(0.5, 0.3, modulus)))

    def quotient(angle: float, share: float, by: float, factor: float = 1.0) -> np.ndarray:
        other = answered(
            with_fibres, Body(factor * modulus, None, fibres(angle, share, factor * modulus))
        )
        return (other.compliance - found.compliance) / by

    moments = found.fibre_moments(modulus)
    turned = -0.3 * moments @ (fibre_weights(0.5 + 1e-30j).imag / 1e-30)  # pyright: ignore[reportArgumentType]
    for own, other in [
        (-moments @ fibre_weights(0.5), quotient(0.5, 0.3003, 3e-4)),
        (turned, quotient(0.503, 0.3, 3e-3)),
        (found.gradient(modulus), quotient(0.5, 0.3, 1e-3, 1.001)),
    ]:
        assert np.abs(own - other).max() < 1e-2 * np.abs(other).max()


def test_a_span_that_begins_anew_keeps_nothing_of_fibres(full):  # noqa: F811
    centre = field(CENTRE, full.points_m)
    solutions = [solved(full, CENTRE), full.evaluate(centre, fibres=fibres(0.5, 0.3, centre))]

    def begun() -> ReducedModel:
        model = ReducedModel(full, fibres=True)
        for solution in solutions:
            model.add(solution)
        return model

    model, sizes = begun(), []
    for parameters in drawn(12, 8):
        modulus = field(parameters, full.points_m)
        along, slope = fibres(0.6, 0.2, modulus), slopes(parameters, full.points_m)
        fresh = begun()
        found, other = (answered(m, Body(modulus, None, along)) for m in (model, fresh))
        assert found.compliance == pytest.approx(other.compliance, rel=2e-6)
        own, wanted = found.gradient(slope), other.gradient(slope)
        assert np.all(np.abs(own - wanted).max(axis=0) < 5e-3 * np.abs(wanted).max(axis=0))
        sizes.append(len(model._primal))
    assert np.any(np.diff(sizes) < 0)


def test_fibres_join_springs_and_skin(full):  # noqa: F811
    model, modulus = ReducedModel(full, fibres=True), field(CENTRE, full.points_m)
    base, skin = (1e-6, 5e-7), (1e-3, 4.0)
    for share in (0.0, 0.2, 0.5):
        along = fibres(0.5, share, modulus) if share else None
        model.add(full.evaluate(modulus, base, along, skin))
    along = fibres(0.5, 0.35, modulus)
    found = answered(model, Body(modulus, base, along, skin))
    expected = full.evaluate(modulus, base, along, skin)
    error = expected.compliance / found.compliance - 1
    assert np.all(error > -2e-7)
    assert np.all(error < found.high / found.compliance - 1 + 2e-7)
    assert error.max() < 1e-4


def test_fibres_have_a_basis_of_their_own_and_only_where_it_knows_them(full):  # noqa: F811
    bases, modulus = ReducedBases(full), field(CENTRE, full.points_m)
    plain, along = full.evaluate(modulus), fibres(0.5, 0.3, modulus)
    assert bases.evaluate(Body(modulus), 1e-3) is None
    bases.add(plain)
    assert bases.evaluate(Body(modulus, None, along), 1e-3) is None
    bases.add(full.evaluate(modulus, fibres=along), plain)
    found = bases.evaluate(Body(modulus, None, fibres(0.52, 0.31, modulus)), 1e-4)
    assert found is not None
    assert bases.evaluate(Body(modulus), 1e-4) is not None
    slanted = np.array([0.6, 0.0, 0.8]), 0.3 * modulus
    uneven = along[0], np.where(full.points_m[:, 0] > 0.02, 0.3, 0.2) * modulus
    for others in (slanted, uneven):
        assert bases.evaluate(Body(modulus, None, others), 1.0) is None
        bases.add(full.evaluate(modulus, fibres=others))
        assert bases.evaluate(Body(modulus, None, others), 1.0) is None
