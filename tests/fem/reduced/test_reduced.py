"""The reduced model against full solutions of the same mesh, near fields included."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, SolverError, Support, block_mesh
from fem.reduced.model import ReducedModel

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


def drawn(count: int, seed: int) -> np.ndarray:
    moved = np.random.default_rng(seed).uniform(-1, 1, (count, 6))
    return CENTRE + HALF * moved


@pytest.fixture(scope="module", params=[True, False], ids=["near fields", "bare mesh"])
def full(request):
    return PalpationModel(
        block_mesh((0.04, 0.04, 0.024), (3, 3, 2)), 0.45, contacts(), near_field=request.param
    )


@pytest.fixture(scope="module")
def training(full):
    parameters = np.vstack([CENTRE, drawn(150, 1)])
    return np.array([field(one, full.points_m) for one in parameters])


@pytest.fixture(scope="module")
def reduced(full, training):
    return ReducedModel(full, training, 6)


def compliances(model, parameters) -> np.ndarray:
    return np.array([model.evaluate(field(one, model.points_m)).compliance for one in parameters])


def test_the_basis_is_exact_at_its_snapshots(full, training, reduced):
    for modulus in training[:6]:
        expected = full.evaluate(modulus).compliance
        found = reduced.evaluate(modulus[reduced.modes.points]).compliance
        assert found == pytest.approx(expected, rel=3e-5)


def test_errors_fall_with_the_number_of_snapshots_and_lie_below(full, training):
    parameters = drawn(5, 2)
    expected = compliances(full, parameters)
    errors = np.array(
        [
            compliances(ReducedModel(full, training, m), parameters) / expected - 1
            for m in (1, 4, 10)
        ]
    )
    assert errors.max() < 1e-4  # from below, but for the modes of the modulus
    assert np.all(np.diff(errors, axis=0) > -1e-4)  # nested spaces
    rms = np.sqrt((errors**2).mean(axis=(1, 2)))
    assert rms[0] > 3 * rms[1] > 9 * rms[2]
    assert np.abs(errors[2]).max() < 5e-4


def test_the_gradient_is_that_of_the_reduced_compliance_and_near_the_full_one(full, reduced):
    steps = 1e-4 * HALF

    def derivative(points: np.ndarray) -> np.ndarray:
        moved = [CENTRE + sign * step for step in np.diag(steps) for sign in (1, -1)]
        up, down = np.array([field(one, points) for one in moved]).reshape(6, 2, -1).swapaxes(0, 1)
        return ((up - down) / (2 * steps[:, None])).T

    at_centre = CENTRE + 0.3 * HALF
    response = reduced.evaluate(field(at_centre, reduced.points_m))
    direction = field(at_centre, reduced.points_m)[:, None] * [1.0, 0.0] + [0.0, 1.0]
    found = response.gradient(direction)
    for column in range(2):
        step = 1e-5 * direction[:, column] * (1.0 if column == 0 else 1e3)
        modulus = field(at_centre, reduced.points_m)
        up, down = (reduced.evaluate(modulus + s * step).compliance for s in (1, -1))
        scale = 2e-5 * (1.0 if column == 0 else 1e3)
        assert found[:, column] == pytest.approx((up - down) / scale, rel=1e-5)
    assert response.sensitivity @ direction == pytest.approx(found, rel=1e-9)
    own = reduced.evaluate(field(CENTRE, reduced.points_m)).gradient(derivative(reduced.points_m))
    other = full.evaluate(field(CENTRE, full.points_m)).gradient(derivative(full.points_m))
    assert np.all(np.abs(own - other).max(axis=0) < 5e-3 * np.abs(other).max(axis=0))


def test_the_full_compliance_lies_between_the_bounds(full, reduced):
    reference = field(CENTRE, full.points_m)
    for parameters in drawn(4, 3):
        modulus = field(parameters, full.points_m)
        low, high = reduced.bounds(modulus)
        error, bound = full.evaluate(modulus).compliance - low, high - low
        assert np.all(error > 0)
        ratio = modulus / reference
        assert np.all(bound >= error)
        assert np.all(bound <= 1.1 * ratio.max() / ratio.min() * error)


def test_the_basis_grows_where_it_is_not_trusted_and_only_there(full, training):
    model = ReducedModel(full, training, 6)
    away = field(CENTRE + 3 * HALF * [0, 1, 1, -1, 0, 0], full.points_m)
    assert not model.grow(training[1], 1e-3)
    assert model.snapshots == 6
    assert model.grow(away, 1e-3)
    assert model.snapshots == 7
    found = model.evaluate(away[model.modes.points]).compliance
    assert found == pytest.approx(full.evaluate(away).compliance, rel=1e-3)
    assert not model.grow(away, 1e-3)


def test_what_a_reduced_model_cannot_take_is_refused(full, training, reduced):
    with pytest.raises(SolverError, match=r"must be \(\d+,\)"):
        reduced.evaluate(np.ones(3))
    with pytest.raises(SolverError, match="positive and finite"):
        reduced.evaluate(-np.ones(len(reduced.points_m)))
    with pytest.raises(SolverError, match="snapshots must be between"):
        ReducedModel(full, training, 0)
    soft = PalpationModel(
        full.mesh, 0.45, contacts(), near_field=False, support=Support("base", normal=1e-6)
    )
    with pytest.raises(SolverError, match="bonded support"):
        ReducedModel(soft, training, 2)
