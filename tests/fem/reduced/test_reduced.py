"""The reduced model and its bounds against full solutions of the same mesh."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, SolverError, Support, block_mesh
from fem.reduced import Body, ReducedBases, ReducedModel, ReducedResponse
from fem.reduced.modes import MOST

CENTRE = np.array([5e3, 1.2e4, 0.020, 0.022, 0.012, 0.008])
HALF = np.array([500, 4000, 0.003, 0.003, 0.003, 0.0012])


def contacts() -> Contacts:
    points = [(x, y, 0.024) for x in (0.014, 0.026) for y in (0.016, 0.028)]
    return Contacts(np.array(points), np.array([0.0, 0.0, -1.0]), np.array(0.004))


def field(parameters: np.ndarray, points: np.ndarray) -> np.ndarray:
    """A background with a Gaussian inclusion, Pa."""
    base, weight, *centre, radius = parameters
    distance = np.sum((points - centre) ** 2, axis=1)
    return base + weight * np.exp(-distance / (2 * radius**2))


def slopes(parameters: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Derivatives (p, 6) of the field, by difference quotients."""
    moved = [parameters + sign * step for step in np.diag(1e-4 * HALF) for sign in (1, -1)]
    fields = np.array([field(one, points) for one in moved]).reshape(6, 2, -1)
    return ((fields[:, 0] - fields[:, 1]) / (2e-4 * HALF[:, None])).T


def drawn(count: int, seed: int) -> np.ndarray:
    return CENTRE + HALF * np.random.default_rng(seed).uniform(-1, 1, (count, 6))


@pytest.fixture(scope="module", params=[0.45, 0.499, None], ids=["near", "soft", "bare mesh"])
def full(request):
    """With near fields, with an almost incompressible body, without near fields."""
    ratio, near_field = request.param or 0.45, request.param is not None
    mesh = block_mesh((0.04, 0.04, 0.024), (3, 3, 2))
    return PalpationModel(mesh, ratio, contacts(), near_field=near_field)


def solved(full, parameters):
    return full.evaluate(field(parameters, full.points_m))


def bounded_by(low, high) -> ReducedResponse:
    return ReducedResponse(low, high, np.ones((4, 1)), lambda: None, (0,), None, None)  # pyright: ignore[reportArgumentType]


def answered(model, *arguments):
    """Return what a reduced model answers, and fail where it does not."""
    response = model.evaluate(*arguments)
    assert response is not None
    return response


def grown(full, count: int) -> ReducedModel:
    model = ReducedModel(full)
    for parameters in [CENTRE, *drawn(count - 1, 1)]:
        model.add(solved(full, parameters))
    return model


@pytest.fixture(scope="module")
def reduced(full):
    return grown(full, 6)


def test_both_bounds_meet_at_the_snapshots(full, reduced):
    for parameters in [CENTRE, *drawn(5, 1)]:
        found = reduced.evaluate(Body(field(parameters, full.points_m)))
        expected = solved(full, parameters).compliance
        assert found.compliance == pytest.approx(expected, rel=1e-6)
        assert found.error < 3e-6


@pytest.mark.parametrize("seed", [2, 3, 4])
def test_the_full_compliance_lies_between_the_bounds_and_they_are_tight(full, reduced, seed):
    (parameters,) = drawn(1, seed)
    found = reduced.evaluate(Body(field(parameters, full.points_m)))
    error = solved(full, parameters).compliance / found.compliance - 1
    bound = found.high / found.compliance - 1
    assert np.all(error > 0)
    assert np.all(error < bound)
    assert np.all(bound < 8 * error)
    assert bound.max() < 0.02


def test_errors_fall_with_every_snapshot(full):
    parameters = drawn(3, 5)
    expected = np.array([solved(full, one).compliance for one in parameters])
    errors, bounds = [], []
    for count in (1, 4, 9):
        model = grown(full, count)
        found = [answered(model, Body(field(one, full.points_m))) for one in parameters]
        errors.append(1 - np.array([one.compliance for one in found]) / expected)
        bounds.append(max(one.error for one in found))
    rms = np.sqrt((np.array(errors) ** 2).mean(axis=(1, 2)))
    assert rms[0] > 3 * rms[1] > 9 * rms[2]
    assert bounds[0] > 2 * bounds[1] > 4 * bounds[2]


def test_the_gradient_is_that_of_the_reduced_compliance_and_near_the_full_one(full, reduced):
    (parameters,) = drawn(1, 6)
    points = full.points_m
    own = reduced.evaluate(Body(field(parameters, points))).gradient(slopes(parameters, points))
    for column, step in enumerate(np.diag(1e-3 * HALF)):
        up, down = (
            reduced.evaluate(Body(field(parameters + sign * step, points))).compliance
            for sign in (1, -1)
        )
        quotient = (up - down) / (2e-3 * HALF[column])
        assert np.abs(own[:, column] - quotient).max() < 3e-3 * np.abs(quotient).max()
    other = solved(full, parameters).gradient(slopes(parameters, points))
    assert np.all(np.abs(own - other).max(axis=0) < 5e-2 * np.abs(other).max(axis=0))
    alone = reduced.evaluate(Body(field(parameters, points))).gradient(
        slopes(parameters, points)[:, 2]
    )
    assert alone == pytest.approx(own[:, 2], rel=1e-6)


def test_any_field_is_taken_not_only_those_of_the_map(full, reduced):
    points = full.points_m
    modulus = field(CENTRE, points) * np.exp(3 * (points[:, 0] - 0.02))
    found = reduced.evaluate(Body(modulus))
    error = full.evaluate(modulus).compliance / found.compliance - 1
    assert np.all(error > 0)
    assert np.all(error < found.high / found.compliance - 1)


def test_a_span_that_has_become_large_begins_anew_and_loses_nothing(full):
    model = grown(full, 3)
    places, found, sizes = drawn(12, 8), [], []
    for parameters in places:
        response = answered(model, Body(field(parameters, full.points_m)))
        found.append((response.compliance, response.gradient(slopes(parameters, full.points_m))))
        sizes.append(len(model._primal))
    assert max(sizes) <= MOST
    assert np.any(np.diff(sizes) < 0)  # it did begin anew
    for parameters, (compliance, gradient) in zip(places, found, strict=True):
        fresh = grown(full, 3)
        alone = answered(fresh, Body(field(parameters, full.points_m)))
        assert compliance == pytest.approx(alone.compliance, rel=2e-6)
        other = alone.gradient(slopes(parameters, full.points_m))
        assert np.all(np.abs(gradient - other).max(axis=0) < 5e-3 * np.abs(other).max(axis=0))


def test_the_snapshot_that_went_unused_makes_place(full):
    model = ReducedModel(full, most=2)
    places = CENTRE + np.outer([0, 1, 2], HALF * [0, 0, 1, 0, 0, 0])
    for parameters in places[:2]:
        model.add(solved(full, parameters))
    before = answered(model, Body(field(places[1], full.points_m)))
    slope = before.gradient(slopes(places[1], full.points_m))
    assert answered(model, Body(field(places[0], full.points_m))).error < 3e-6
    model.add(solved(full, places[2]))
    assert len(model) == 2
    assert before.is_stale
    with pytest.raises(SolverError, match="evaluate anew"):
        before.gradient(slopes(places[1], full.points_m))
    assert np.isfinite(slope).all()
    errors = [answered(model, Body(field(one, full.points_m))).error for one in places]
    assert max(errors[0], errors[2]) < 3e-6 < errors[1]


def test_a_response_keeps_its_derivatives_while_the_basis_grows(full):
    model = grown(full, 2)
    (parameters,) = drawn(1, 8)
    before = answered(model, Body(field(parameters, full.points_m)))
    slope = before.gradient(slopes(parameters, full.points_m))
    model.add(solved(full, parameters))
    assert not before.is_stale
    assert before.gradient(slopes(parameters, full.points_m)) == pytest.approx(slope, rel=1e-6)


def test_bases_answer_only_where_they_are_certain(full):
    bases, tolerance = ReducedBases(full), 1e-4
    points = full.points_m
    near = field(CENTRE + 0.01 * HALF, points)
    far = field(CENTRE + 3 * HALF * [0, 1, 1, -1, 0, 0], points)
    assert bases.evaluate(Body(near), tolerance) is None
    bases.add(solved(full, CENTRE))
    found = answered(bases, Body(near), tolerance)
    assert found.compliance == pytest.approx(full.evaluate(near).compliance, rel=tolerance)
    assert bases.evaluate(Body(far), tolerance) is None
    bases.add(full.evaluate(far))
    assert answered(bases, Body(far), tolerance).error < 3e-6
    assert answered(bases, Body(near), tolerance).compliance == pytest.approx(
        found.compliance, rel=1e-6
    )


def test_a_solution_without_springs_and_skin_joins_a_new_basis_once(full):
    bases, plain = ReducedBases(full), solved(full, CENTRE)
    bases.add(plain, plain)
    found = answered(bases, Body(field(CENTRE, full.points_m)), 1e-5)
    assert found.weights.shape == (4, 1)
    bases.add(full.evaluate(field(CENTRE, full.points_m), (0.0, 2e-6)), plain)
    found = answered(bases, Body(field(CENTRE, full.points_m), (0.0, 2e-6)), 1e-5)
    assert found.weights.shape == (4, 2)


def test_a_field_too_steep_for_a_cell_is_left_to_the_full_model():
    mesh = block_mesh((0.04, 0.04, 0.024), (3, 3, 2))
    full, bases = PalpationModel(mesh, 0.45, contacts()), None
    steep = field(np.array([5e3, 3e5, 0.014, 0.016, 0.024, 0.003]), full.points_m)
    assert full.material(steep).close.steep
    bases = ReducedBases(full)
    bases.add(full.evaluate(steep))
    bases.add(solved(full, CENTRE))
    assert bases.evaluate(Body(steep), np.inf) is None
    assert bases.evaluate(Body(field(CENTRE, full.points_m)), 1e-5) is not None


@pytest.mark.filterwarnings("error")
def test_far_from_all_snapshots_the_bound_is_never_small(full, reduced):
    points = full.points_m
    hole = field(np.array([5e3, -4.99e3, 0.014, 0.016, 0.020, 0.006]), points)
    spike = np.where(points[:, 2] > 0.0235, 1e9, 5e3)
    for modulus in (np.full(len(points), 1e-3), 1 / field(CENTRE, points), hole, spike):
        found = reduced.evaluate(Body(modulus))
        assert found is None or found.error > 1e-2 or np.ptp(modulus) == 0
    assert bounded_by(-np.ones(4), -np.ones(4)).error == np.inf
    assert bounded_by(np.ones(4), np.full(4, np.nan)).error == np.inf
    assert bounded_by(np.ones(4), np.full(4, 0.9)).error == pytest.approx(0.1)


def test_a_body_whose_own_support_gives_way_has_a_basis():
    mesh = block_mesh((0.04, 0.04, 0.024), (3, 3, 2))
    soft = PalpationModel(
        mesh, 0.45, contacts(), near_field=False, support=Support("base", normal=1e-6)
    )
    model = grown(soft, 3)
    (parameters,) = drawn(1, 2)
    found = answered(model, Body(field(parameters, soft.points_m)))
    error = solved(soft, parameters).compliance / found.compliance - 1
    assert np.all(error > 0)
    assert np.all(error < found.high / found.compliance - 1)
    slides = PalpationModel(
        mesh, 0.45, contacts(), near_field=False, support=Support("base", tangential=np.inf)
    )
    model = ReducedModel(slides)
    model.add(solved(slides, CENTRE))
    assert model.evaluate(Body(field(CENTRE, slides.points_m))) is None


HELD = (None, (0.0, 2e-6), (1e-6, 5e-7))  # about a fifth of the block's height over its modulus
SKINS = (None, (1e-3, 4.0), (1e-3, 0.5))
LAWS = [(base, skin) for base in HELD for skin in SKINS if base or skin]


@pytest.fixture(scope="module")
def with_laws(full):
    """A basis of a few solutions with springs and skins, beside plain ones."""
    model, field_ = ReducedModel(full, most=20), field(CENTRE, full.points_m)
    for base in (None, (1e-6, 0.0), (0.0, 1e-6), (2e-6, 2e-6)):
        for skin in (None, (1e-3, 2.0), (1e-3, 8.0)):
            model.add(full.evaluate(field_, base, skin=skin))
    for parameters in drawn(3, 1):
        model.add(solved(full, parameters))
    return model


@pytest.mark.parametrize(("base", "skin"), LAWS)
def test_springs_and_skins_lie_between_the_bounds(full, with_laws, base, skin):
    (parameters,) = CENTRE + 0.05 * (drawn(1, 3) - CENTRE)
    modulus = field(parameters, full.points_m)
    found = answered(with_laws, Body(modulus, base, None, skin))
    expected = full.evaluate(modulus, base, skin=skin)
    plain = full.evaluate(modulus).compliance
    error = expected.compliance / found.compliance - 1
    bound = found.high / found.compliance - 1
    assert np.all(error > -2e-7)
    assert np.all(error < bound + 2e-7)
    assert error.max() < 2e-3
    assert error.max() < 0.1 * np.abs(expected.compliance / plain - 1).max()
    slope = slopes(parameters, full.points_m)
    pairs = [(found.gradient(slope), expected.gradient(slope))]
    pairs += [(getattr(r, name) for r in (found, expected))
              for name in ("support_sensitivity", "skin_sensitivity")]  # fmt: skip
    for near, exact in pairs:
        assert np.all(np.abs(near - exact).max(axis=0) <= 0.15 * np.abs(exact).max(axis=0))


def test_derivatives_by_springs_and_skin_are_those_of_the_reduced_compliance(full, with_laws):
    modulus, base, skin = field(CENTRE + 0.05 * HALF, full.points_m), (1e-6, 5e-7), (1e-3, 4.0)
    found = answered(with_laws, Body(modulus, base, None, skin))
    own = np.hstack([found.support_sensitivity, found.skin_sensitivity])
    law = np.array([*base, *skin])
    for column, step in enumerate(np.diag(1e-3 * law)):
        up, down = (
            answered(
                with_laws, Body(modulus, (law + sign * step)[:2], None, (law + sign * step)[2:])
            )
            for sign in (1, -1)
        )
        quotient = (up.compliance - down.compliance) / (2 * step[column])
        assert np.abs(own[:, column] - quotient).max() < 2e-3 * np.abs(quotient).max()
    stiffer = 1.001 * modulus
    quotient = (
        answered(with_laws, Body(stiffer, base, None, skin)).compliance - found.compliance
    ) / 1e-3
    assert found.gradient(modulus) == pytest.approx(quotient, rel=3e-3)


def test_springs_and_skins_are_exact_at_their_snapshots(full, with_laws):
    modulus = field(CENTRE, full.points_m)
    for base, skin in [((1e-6, 0.0), None), (None, (1e-3, 8.0)), ((2e-6, 2e-6), (1e-3, 2.0))]:
        found = answered(with_laws, Body(modulus, base, None, skin))
        expected = full.evaluate(modulus, base, skin=skin).compliance
        assert found.compliance == pytest.approx(expected, rel=1e-6)
        assert found.error < 1e-5


def test_a_body_without_least_energy_begins_no_basis(full):
    bases, sound = ReducedBases(full), solved(full, CENTRE)
    bases.add(sound)
    far = 5 * CENTRE[1] * (full.points_m[:, 0] > 0.02) + 5e3
    wrong = full.evaluate(far)
    vars(wrong)["sensitivity"] = -wrong.sensitivity
    assert bases.evaluate(Body(far), 1e-5) is None
    bases.add(wrong)
    found = bases.evaluate(Body(field(CENTRE, full.points_m)), 1e-5)
    assert found is not None
    assert found.compliance == pytest.approx(sound.compliance, rel=1e-6)
