"""The uncertainty of a map in two numbers of each press: its compliance, and a ball's contrast."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.effects.readings import Readings
from identify.map import FreeMap, Grid, MaternField
from identify.map.parameters import ParameterSpace
from identify.measurement.chain import OperatingPoint
from identify.measurement.map_uncertainty import MapUncertainty, MarginalMap
from identify.measurement.model import MeasurementModel
from tests.identify.select.loop_problem import NOISE, NU, SIZE, points, scan, timing

NONE = np.empty(0)
LEVEL = np.log(6000.0)


@pytest.fixture(scope="module")
def ball() -> MeasurementModel:
    """25 presses with a ball beside an even map, without an error of that map."""
    down = np.tile([0.0, 0.0, -1.0], (25, 1))
    contacts = Contacts(points(), down, np.full(25, 0.002), "hertz")
    mesh = block_mesh(SIZE, (5, 5, 3))
    body = PalpationModel(mesh, NU, contacts)
    grid = Grid.over(np.array([[0, 0, 0], SIZE]), 0.006)
    even = FreeMap(grid, np.full(len(grid), LEVEL))
    unit = 6000.0 * body.evaluate(6000.0).compliance
    press, _, _, force = timing(0)
    table = scan(0 * force, force, 0).replace(probe_radius_m=np.full(len(press), 0.004))
    mechanics = BodyMechanics(body, None, lambda nu: PalpationModel(mesh, nu, contacts))
    space = ParameterSpace(even, (), ())
    return MeasurementModel(
        Readings.of(table), 0 * force, NOISE, mechanics, space, unit_compliance=unit
    )


def under(model: MeasurementModel, contrast: float) -> MeasurementModel:
    """Readings with noise over a body whose modulus under each tip is another one."""
    rng = np.random.default_rng(1)
    press, _, _, true_n = timing(0)
    c = model.body(NONE).compliance
    assert model.unit_compliance is not None
    point = OperatingPoint(c, contrast * model.unit_compliance / c, true_n, {})
    travel = model.chain.predict(point) + rng.normal(0, NOISE.displacement_m, len(press))
    return replace(model, displacement_m=travel)


def beside(model: MeasurementModel, numbers: int) -> MeasurementModel:
    """The model beside every map of a prior, in so many numbers of each press."""
    by_field = model.body(NONE).numbers_by_field()[: 25 * numbers]
    start = model.space.start
    assert isinstance(start, FreeMap)
    prior = MaternField(start.grid, 0.02, 0.5, 2.0)
    error = np.full(25, 0.02**2)
    uncertain = MapUncertainty.of(prior.product, by_field, error, 0.0, np.ones(25))
    return replace(model, map_uncertainty=uncertain)


def test_two_numbers_of_a_press_against_the_whole_covariance():
    rng = np.random.default_rng(0)
    press, root = np.repeat(np.arange(4), 6), rng.standard_normal((8, 8))
    own, offset = rng.uniform(0, 1, 8), rng.standard_normal(8)
    uncertain = MapUncertainty(root @ root.T, own, offset, np.ones(4))
    columns = rng.standard_normal((2, 24))
    marginal = MarginalMap(uncertain, columns, press)
    spread = np.hstack([columns[a][:, None] * np.eye(4)[press] for a in range(2)])
    whole = np.eye(24) + spread @ (root @ root.T + np.diag(own)) @ spread.T
    x = rng.standard_normal((24, 3))
    white = marginal.whitened(x)
    assert white.T @ white == pytest.approx(x.T @ np.linalg.solve(whole, x), rel=1e-9)
    assert marginal.whitened(x[:, 0]) == pytest.approx(white[:, 0])
    about_mean = marginal.about_mean(x[:, 0])
    assert about_mean == pytest.approx(x[:, 0] + spread @ offset)
    best = root @ root.T @ spread.T @ np.linalg.solve(whole, about_mean) - offset
    assert marginal.moved(about_mean) == pytest.approx(best, abs=1e-9)


def test_derivatives_of_a_ball_s_numbers_by_the_field(ball):
    """An even change leaves no contrast; a stiffer surface alone gives one below its own change."""
    by_field, start = ball.body(NONE).numbers_by_field(), ball.space.start
    even = by_field @ np.ones(by_field.shape[1])
    assert even[:25] == pytest.approx(-1, abs=1e-3)
    assert even[25:] == pytest.approx(0, abs=1e-3)
    top = start.grid.points_m[:, 2] > SIZE[2] - 0.007
    contrast = by_field[25:] @ top
    assert np.all((contrast > 0.1) & (contrast < 0.9))


def test_a_modulus_of_its_own_under_a_ball_is_no_effect(ball):
    """A surface softer or stiffer than the depth bends all curves, as a map of the prior does."""
    for contrast in (0.75, 1.3):
        bent = under(ball, contrast)
        count = len(bent.displacement_m)
        one, two = (beside(bent, numbers).linearise(NONE) for numbers in (1, 2))
        assert two.chi2 < count + 2 * np.sqrt(2 * count)
        assert one.chi2 > two.chi2 + 50
    plain = under(ball, 1.0)
    assert beside(plain, 2).linearise(NONE).chi2 == pytest.approx(count, abs=3 * np.sqrt(2 * count))
