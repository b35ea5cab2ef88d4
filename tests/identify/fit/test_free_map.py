"""The free map against closed forms, differences, direct formulas and an independent solver."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from benchmarks import free_maps
from fem import Contacts, PalpationModel, block_mesh
from identify.body import BodyMechanics
from identify.effects import Readings
from identify.fit.cross_validation import left_out_residual_m
from identify.fit.free_map.field import fifths
from identify.fit.free_map.field_data import FieldData, PressSums
from identify.fit.free_map.field_evidence import Hyper, best_hyper
from identify.fit.free_map.field_posterior import DrawnField, FieldPosterior
from identify.fit.free_map.settings import FREE_MAP, SPOTS
from identify.fit.free_map_fit import FreeMapFit
from identify.map import FreeMap, Grid, MaternField
from identify.map.parameters import ParameterSpace
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.optimize.result import InadmissibleError
from models import Scan

SIZE_M = (0.06, 0.06, 0.03)
NOISE = Noise(2e-5, 5e-3)
LEVEL = np.log(8e3)
FORCES_N = np.linspace(0.1, 0.8, 8)


def contacts(per_side: int = 5, profile: str = "flat") -> Contacts:
    axis = np.linspace(0.01, 0.05, per_side)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    return Contacts(points, np.tile([0, 0, -1.0], (x.size, 1)), np.full(x.size, 0.004), profile)


@pytest.fixture(scope="module")
def body() -> PalpationModel:
    return PalpationModel(block_mesh(SIZE_M, (5, 5, 3)), 0.45, contacts())


@pytest.fixture(scope="module")
def grid() -> Grid:
    return Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.006)


def readings(presses: Contacts) -> Readings:
    j, k = len(presses), len(FORCES_N)
    press = np.repeat(np.arange(j), k)
    scan = Scan(
        press=press,
        time_s=np.full(j * k, np.nan),
        phase=np.full(j * k, "load"),
        force_n=np.tile(FORCES_N, j),
        displacement_m=np.tile(FORCES_N, j) * 1e-3,
        point_m=presses.points_m[press],
        direction=presses.directions[press],
        probe_radius_m=np.full(j * k, 0.004),
    )
    return Readings.of(scan)


def model_of(body: PalpationModel, grid: Grid, truth: FreeMap, rng) -> MeasurementModel:
    """Readings of a true map, on the same mesh, with noise in both columns."""
    r = readings(body.contacts)
    c = body.evaluate(truth.modulus(body.points_m)).compliance[r.press]
    travel = c * r.force_n + rng.normal(0, NOISE.displacement_m, len(r.press))
    noisy = replace(r, force_n=r.force_n + rng.normal(0, NOISE.force_n, len(r.press)))
    start = FreeMap(grid, np.full(len(grid), LEVEL))
    return MeasurementModel(
        noisy, travel, NOISE, BodyMechanics.of(body), ParameterSpace(start, (), ())
    )


@pytest.fixture(scope="module")
def linear(body, grid):
    """Data of a field around an uneven one, linear."""
    rng = np.random.default_rng(4)
    field = MaternField(grid, 0.02, 0.3).draws(rng, 1)[0]
    model = model_of(body, grid, FreeMap(grid, LEVEL + field), rng)
    here = 0.5 * field
    model = replace(model, space=ParameterSpace(FreeMap(grid, LEVEL + here), (), ()))
    at = model.linearise(np.empty(0))
    sums = PressSums.of(model, at)
    by_field = at.body.by_field()
    return model, at, here, sums, by_field, FieldData.of(sums, by_field, here)


@pytest.mark.slow
@pytest.mark.parametrize("smoothness", [1.5, 0.5])
def test_the_covariance_of_the_prior_is_that_of_its_products_and_draws(smoothness):
    grid = Grid.over(np.array([[0, 0, 0], [0.02, 0.03, 0.01]]), 0.005)
    prior = MaternField(grid, 0.01, 0.7, 2.0, smoothness=smoothness)
    apart = np.linalg.norm(grid.points_m[:, None] - grid.points_m[None], axis=2)
    s = np.sqrt(2 * smoothness) * apart / 0.01
    dense = 0.49 * np.exp(-s) * (1 + s if smoothness == 1.5 else 1.0) + 4.0
    assert prior.product(np.eye(len(grid))) == pytest.approx(dense, abs=1e-12)
    drawn = np.cov(prior.draws(np.random.default_rng(0), 20000).T)
    assert drawn == pytest.approx(dense, abs=0.15)  # 4 sigma of 20,000 draws of variance 4.5


def test_interpolation_is_exact_for_linear_fields_and_keeps_the_edge_beyond():
    grid = Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.01)
    law = np.array([1.0, -2.0, 3.0])
    inside = np.random.default_rng(0).uniform(0, 1, (50, 3)) * SIZE_M
    assert grid.interpolated(grid.points_m @ law, inside) == pytest.approx(inside @ law)
    beyond = grid.interpolated(grid.points_m @ law, np.array([[1.0, 0.0, 0.0]]))
    assert beyond == pytest.approx([SIZE_M[0]])


@pytest.mark.parametrize("count", [1, 3, 25])
def test_a_map_below_presses_has_their_moduli(count):
    grid = Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.0025)
    points = contacts().points_m[:count]
    moduli = np.linspace(4e3, 9e3, count)
    found = FreeMap.below_presses(grid, points, moduli)
    assert found.log_pa.min() >= np.log(moduli.min()) - 1e-12
    assert found.log_pa.max() <= np.log(moduli.max()) + 1e-12
    under = found.modulus(np.array([[0.01, 0.01, SIZE_M[2]]]))
    assert under == pytest.approx(moduli[0], rel=0.1)
    far = np.array([[0.0, 0.06, 0.0], [0.06, 0.06, 0.0]])
    assert np.all(np.abs(np.log(found.modulus(far) / np.median(moduli))) < np.log(2))


def test_derivatives_by_the_field_against_differences(linear):
    model, _, here, _, by_field, _ = linear
    rng = np.random.default_rng(1)
    move = 1e-4 * rng.standard_normal(len(here))
    grid = model.space.start.grid
    sides = []
    for sign in (1, -1):
        space = ParameterSpace(FreeMap(grid, LEVEL + here + sign * move), (), ())
        sides.append(np.log(replace(model, space=space).linearise(np.empty(0)).body.compliance))
    assert by_field @ move == pytest.approx((sides[0] - sides[1]) / 2, rel=1e-4, abs=1e-9)


@pytest.mark.slow
def test_the_data_space_solution_is_that_of_the_model_space(linear, grid):
    _, at, here, _, by_field, data = linear
    prior = MaternField(grid, 0.02, 0.3, 1.0)
    posterior = FieldPosterior(data, prior)
    # Reading by reading, with the whole covariance of the prior
    press = np.repeat(np.arange(len(data.target)), len(FORCES_N))
    own = at.by_compliance * at.body.compliance[press] / at.sigma_m
    jacobian = own[:, None] * by_field[press]
    precision = np.linalg.inv(prior.product(np.eye(len(grid)))) + jacobian.T @ jacobian
    covariance = np.linalg.inv(precision)
    mean = covariance @ (jacobian.T @ (at.residual + jacobian @ here))
    assert posterior.mean == pytest.approx(mean, abs=1e-6)
    assert posterior.sd == pytest.approx(np.sqrt(np.diag(covariance)), rel=1e-5)
    hat = jacobian @ covariance @ jacobian.T
    assert posterior.effective == pytest.approx(np.trace(hat), rel=1e-6)
    drawn = posterior.draws(np.random.default_rng(0), 4000)
    assert drawn.mean(axis=0) == pytest.approx(mean, abs=0.03)
    assert drawn.std(axis=0) == pytest.approx(posterior.sd, rel=0.08)


def test_further_layers_count_alike_in_bands_draws_and_predictions(linear, grid):
    """They widen all of these as much as errors of the mean have them, and move no mean."""
    data = linear[-1]
    prior = MaternField(grid, 0.02, 0.3, 1.0, 0.5, 0.01, 0.5, 0.5)
    found = FieldPosterior(data, prior)
    plain = FieldPosterior(data, replace(prior, untold_spread=0.0))
    assert found.mean == pytest.approx(plain.mean, abs=1e-12)
    assert (found.sd > plain.sd).all()
    errors = found.draws(np.random.default_rng(2), 6000) - found.mean
    assert errors.std(axis=0) == pytest.approx(found.sd, rel=0.06)  # 6 sigma of 6,000
    # Other presses feel layers that these do not; most of all one that feels a single place
    other = np.eye(len(grid))[:: len(grid) // 7][:7]
    none = np.zeros((7, len(data.target)))
    seen, before = (p.predicted_covariance(other, none) for p in (found, plain))
    assert seen == pytest.approx(np.cov((errors @ other.T).T), rel=0.1, abs=0.05 * seen.max())
    assert np.linalg.eigvalsh(seen - before).min() > -1e-12
    assert np.trace(seen) > 1.02 * np.trace(before)


@pytest.mark.parametrize("error", [0.0, 0.02])
def test_the_evidence_against_a_direct_formula(linear, grid, error):
    _, at, here, _, by_field, data = linear
    prior = MaternField(grid, 0.02, 0.3, 1.0)
    press = np.repeat(np.arange(len(data.target)), len(FORCES_N))
    own = at.by_compliance * at.body.compliance[press] / at.sigma_m
    jacobian = own[:, None] * by_field[press]
    alike = np.outer(own, own) * (press[:, None] == press[None]) * error**2
    whole = np.eye(len(press)) + jacobian @ prior.product(jacobian).T + alike
    target = at.residual + jacobian @ here
    direct = multivariate_normal(cov=whole).logpdf(target)
    noise = -0.5 * len(press) * np.log(2 * np.pi)
    found = FieldPosterior(data, prior, error).log_evidence
    assert found == pytest.approx(direct - noise, rel=1e-6)


def test_the_readings_beside_every_map_of_the_prior_against_the_whole_covariance(linear, grid):
    """Residual, further patterns and the best map of a model with an uncertain map, directly."""
    model, at, here, _, by_field, data = linear
    prior = MaternField(grid, 0.02, 0.3, 1.0)
    posterior = FieldPosterior(data, prior, 0.02)
    uncertain = MapUncertainty(
        posterior.of_field, data.error_variance(0.02), by_field @ here, np.ones(len(data.target))
    )
    both = replace(model, map_uncertainty=uncertain).around(at.body, np.empty(0))
    # Linear where each press is most probable
    factor = both.compliance / at.body.compliance
    there = model.around(at.body, np.empty(0), factor)
    offset = by_field @ here + np.log(factor)
    press = np.repeat(np.arange(len(data.target)), len(FORCES_N))
    own = there.by_compliance * both.compliance[press] / there.sigma_m
    jacobian = own[:, None] * by_field[press]
    alike = np.outer(own, own) * (press[:, None] == press[None]) * 0.02**2
    whole = np.eye(len(press)) + jacobian @ prior.product(jacobian).T + alike
    about_mean = there.residual + own * offset[press]
    assert both.chi2 == pytest.approx(about_mean @ np.linalg.solve(whole, about_mean), rel=1e-8)
    assert both.chi2 == pytest.approx(posterior.chi2, rel=1e-2)  # that is linear at the map
    to_press = (prior.product(by_field) @ by_field.T + 0.02**2 * np.eye(len(offset)))[press]
    best = to_press.T @ (own * np.linalg.solve(whole, about_mean))
    assert best == pytest.approx(offset, abs=1e-3)
    pattern = np.random.default_rng(3).standard_normal((len(press), 2)) * at.sigma_m[:, None]
    seen = both.whitened(pattern, press)
    white = pattern / there.sigma_m[:, None]
    assert seen.T @ seen == pytest.approx(white.T @ np.linalg.solve(whole, white), rel=1e-8)
    assert seen.T @ both.residual == pytest.approx(
        white.T @ np.linalg.solve(whole, about_mean), rel=1e-7
    )
    weights = own * np.linalg.solve(whole, about_mean)
    mapped = prior.product(by_field).T @ np.bincount(press, weights)
    moved = by_field @ mapped - offset
    best = there.predicted_m + own * there.sigma_m * moved[press]
    assert both.predicted_m == pytest.approx(best, abs=1e-12)


def test_the_evidence_finds_the_numbers_that_maximise_it(linear, grid):
    _, _, here, sums, by_field, data = linear
    start = Hyper(0.02, 0.3, 0.01)
    flat = replace(FREE_MAP, unsure=(1e6, 1e6, 1e6), smoothest=1.0, least_spread=0.1)
    prior = MaternField(grid, 1, 1, 1.0)
    best = best_hyper(sums, by_field, here, prior, start, (0.01, 0.06), flat)
    cautious = best_hyper(sums, by_field, here, prior, start, (0.01, 0.06))
    assert cautious.length_m <= 1.0001 * FREE_MAP.smoothest * 0.06 < best.length_m
    assert cautious.spread >= 0.9999 * FREE_MAP.least_spread > best.spread

    def evidence(hyper):
        prior = MaternField(grid, hyper.length_m, hyper.spread, 1.0)
        return FieldPosterior(data, prior, hyper.error).log_evidence

    top = evidence(best)
    for length, spread in ((1.4, 1), (0.7, 1), (1, 1.4), (1, 0.7)):
        moved = replace(best, length_m=best.length_m * length, spread=best.spread * spread)
        assert evidence(moved) < top + 0.02


def test_a_damped_step_is_the_field_of_least_misfit_beside_the_cost_of_the_way(linear, grid):
    *_, start, _, by_field, data = linear
    prior = MaternField(grid, 0.02, 0.3, 1.0)
    posterior = FieldPosterior(data, prior, 0.02)
    covariance = prior.product(np.eye(len(grid)))
    here = DrawnField(np.linalg.solve(covariance, start), start)
    assert here.cost == pytest.approx(float(start @ prior.dual(start)), rel=0.01)
    white = data.root.T @ by_field
    noise = np.eye(len(white)) + data.root.T @ (data.error_variance(0.02)[:, None] * data.root)
    for damping in (0.0, 0.1, 3.0):
        share, aim, moved = posterior.damped(damping)
        drawn = here.towards(aim, share)
        field = drawn.field
        assert covariance @ drawn.dual == pytest.approx(field, abs=1e-6)
        # The slope of misfit, cost and the way's cost, times the covariance
        slope = covariance @ white.T @ np.linalg.solve(noise, white @ field - data.target)
        slope += field + damping * (field - here.field)
        assert np.abs(slope).max() < 1e-4 * np.abs(aim.field).max()
        errors = np.linalg.solve(noise, data.target - white @ field)
        own = data.error_variance(0.02) * (data.root @ errors)
        assert moved == pytest.approx(by_field @ field + own - data.offset, abs=1e-6)
    assert posterior.damped(0.0)[1].field == pytest.approx(posterior.mean)


def test_left_out_presses_are_predicted_as_by_a_fit_without_them(linear, grid):
    _, _, here, sums, by_field, data = linear
    prior = MaternField(grid, 0.02, 0.3, 1.0)
    folds = np.arange(len(data.target)) % 5
    found = FieldPosterior(data, prior).left_out(folds)
    out = folds == 2
    rest = FieldData.of(sums.some(np.flatnonzero(~out)), by_field[~out], here)
    mean = FieldPosterior(rest, prior).mean
    own = np.linalg.solve(data.root.T, data.target)
    assert found[out] == pytest.approx((own - by_field @ mean)[out], abs=1e-6)


def test_a_fit_recovers_a_field_where_it_sees_and_says_where_it_does_not(body, grid):
    rng = np.random.default_rng(11)
    true = MaternField(grid, 0.02, 0.4).draws(rng, 1)[0]
    model = model_of(body, grid, FreeMap(grid, LEVEL + 0.5 + true), rng)
    # Its own prior given: by evidence, a single small body may lie in a band 5 % less often
    hyper = Hyper(0.02, 0.4, 0.01, ("length_m", "spread"))
    fit = FreeMapFit(model, hyper, (0.009, 0.06)).run()
    assert fit.success
    at_truth = replace(model, space=ParameterSpace(FreeMap(grid, LEVEL + 0.5 + true), (), ()))
    taken = at_truth.linearise(np.empty(0)).chi2 - np.sum((fit.residual_m / fit.sigma_m) ** 2)
    assert 0 < taken < 2 * fit.field.effective  # the fit follows the noise no further than that
    assert abs(fit.chi2_per_dof - 1) < 3 * np.sqrt(2 / fit.dof)
    # Presses left out: the linear figure, the only one that is shown, is that of a true refit
    assert fit.field is not None
    out = fifths(len(fit.field.left_out)) == 2
    rest = FreeMapFit(model, hyper, (0.009, 0.06), weight=1.0 - out).run()
    rows = out[fit.press_index]
    moved = [(r - fit.residual_m)[rows] for r in
             (left_out_residual_m(fit, fit.field), rest.residual_m)]  # fmt: skip
    assert np.corrcoef(*moved)[0, 1] > 0.95
    assert np.std(moved[0]) == pytest.approx(np.std(moved[1]), rel=0.2)
    assert np.corrcoef(fit.field.press_error[out], fit.field.left_out[out])[0, 1] > 0.5  # one sign
    off = (fit.map.log_pa - LEVEL - 0.5 - true) / fit.field.log_sd
    assert np.mean(np.abs(off) < 1.96) > 0.85
    depth = SIZE_M[2] - grid.points_m[:, 2]
    inner = np.all(np.abs(grid.points_m[:, :2] - 0.03) < 0.02, axis=1)
    shallow, deep = (fit.field.share[inner & at] for at in (depth < 0.007, depth > 0.025))
    assert shallow.mean() > deep.mean() + 0.2
    assert 0.003 < fit.field.sight_m < SIZE_M[2] + 1e-9
    # Table and draws are of the map that is shown
    seen = fit.field.share >= SPOTS.seen
    assert fit.field.log_mean == pytest.approx(fit.map.log_pa[seen].mean(), abs=1e-12)
    shown = fit.history[-1].parameters["mean_pa"]  # in the recording, beside the table's
    assert shown == pytest.approx(np.exp(fit.field.log_mean), rel=1e-9)
    drawn = fit.field.draws(np.random.default_rng(1), 1500)
    assert np.abs(drawn.mean(axis=0) / fit.field.log_sd).max() < 0.15  # 5 sigma
    assert drawn.std(axis=0) == pytest.approx(fit.field.log_sd, rel=0.1)
    with pytest.raises(ValueError, match="read from a file"):
        replace(fit.field, posterior=None).draws(rng, 1)


@pytest.mark.parametrize(
    ("steps", "longest", "ended"), [(1, 0.1, False), (8, FREE_MAP.longest_step, True)]
)
def test_a_search_whose_steps_are_refused_has_ended_only_where_the_presses_feel_none(
    body, grid, steps, longest, ended
):
    class Refused(FreeMapFit):
        taken = 0

        def _stepped(self, point, posterior, pace):
            self.taken += 1
            return super()._stepped(point, posterior, pace) if self.taken <= steps else (point, 0.0)

    rng = np.random.default_rng(11)
    true = MaternField(grid, 0.02, 0.4).draws(rng, 1)[0]
    model = model_of(body, grid, FreeMap(grid, LEVEL + 0.5 + true), rng)
    hyper = Hyper(0.02, 0.4, 0.01, ("length_m", "spread"))
    settings = replace(FREE_MAP, longest_step=longest, settled=0.0)
    fit = Refused(model, hyper, (0.009, 0.06), settings=settings).run()
    assert fit.message == "no step lowers the misfit"
    assert fit.success is ended


def test_a_step_that_is_too_long_is_made_shorter(body, grid):
    """No damping brings a step over a lump as good as rigid below the longest that is taken."""
    rng = np.random.default_rng(11)
    lump = 3.0 * np.exp(-np.sum((grid.points_m - (0.03, 0.03, 0.026)) ** 2, axis=1) / 0.007**2)
    model = model_of(body, grid, FreeMap(grid, LEVEL + lump), rng)
    hyper = Hyper(0.01, 1.5, 0.01, ("length_m", "spread"))
    settings = replace(FREE_MAP, longest_step=0.2, iterations=30)
    fit = FreeMapFit(model, hyper, (0.009, 0.06), settings=settings).run()
    assert fit.success
    assert len(fit.history) > 10
    assert fit.chi2_per_dof < 1.1
    assert fit.field.spots[0].contrast > 5


@pytest.mark.parametrize(("shortest", "ends"), [(FREE_MAP.shortest, True), (0.9, False)])
def test_a_step_that_no_damping_makes_short_enough_is_shortened(body, grid, shortest, ends):
    class Narrow(FreeMapFit):
        at = None

        def _point(self, model, field, u):
            if self.at is not None and np.abs(field - self.at).max() > 0.1:
                raise InadmissibleError("too far")
            self.at = field
            return super()._point(model, field, u)

    rng = np.random.default_rng(11)
    true = MaternField(grid, 0.02, 0.4).draws(rng, 1)[0]
    model = model_of(body, grid, FreeMap(grid, LEVEL + 0.5 + true), rng)
    hyper = Hyper(0.02, 0.4, 0.01, ("length_m", "spread"))
    settings = replace(FREE_MAP, shortest=shortest, iterations=40)
    fit = Narrow(model, hyper, (0.009, 0.06), settings=settings).run()
    assert fit.success is ends


def test_a_search_knows_the_cost_of_a_field_that_its_prior_did_not_draw(body, grid):
    model = model_of(body, grid, FreeMap(grid, np.full(len(grid), LEVEL)), np.random.default_rng(2))
    search = FreeMapFit(model, Hyper(0.02, 0.4, 0.01), (0.009, 0.06))
    field = MaternField(grid, 0.01, 0.5).draws(np.random.default_rng(3), 1)[0]
    covariance = search.prior.product(np.eye(len(grid)))
    cost = field @ np.linalg.solve(covariance, field)
    assert search._drawn_here(field).cost == pytest.approx(cost, rel=0.01)


def test_a_homogeneous_body_has_no_spot(body, grid):
    rng = np.random.default_rng(5)
    model = model_of(body, grid, FreeMap(grid, np.full(len(grid), LEVEL + 0.3)), rng)
    fit = FreeMapFit(model, Hyper(0.015, 0.5, 0.01), (0.009, 0.06)).run()
    assert not any(spot.found for spot in fit.field.spots)
    assert fit.parameters["mean_pa"].lower95 < np.exp(LEVEL + 0.3)
    assert fit.parameters["mean_pa"].upper95 > np.exp(LEVEL + 0.3)


@pytest.mark.slow
def test_a_search_that_did_not_end_has_no_spots(body, grid):
    rng = np.random.default_rng(11)
    bump = 1.5 * np.exp(-np.sum((grid.points_m - (0.03, 0.03, 0.025)) ** 2, axis=1) / 0.008**2)
    model = model_of(body, grid, FreeMap(grid, LEVEL + bump), rng)
    hyper = Hyper(0.015, 0.5, 0.01, ("length_m", "spread"))
    ended, stopped = (
        FreeMapFit(model, hyper, (0.009, 0.06), settings=replace(FREE_MAP, iterations=n)).run()
        for n in (FREE_MAP.iterations, 1)
    )
    assert ended.success
    assert ended.field.spots
    assert not stopped.success
    assert stopped.field.spots == ()


def test_a_search_goes_faster_where_steps_keep_their_promise_and_slower_where_not():
    pace = partial(FreeMapFit._pace, SimpleNamespace(settings=FREE_MAP))
    assert pace(0.2, 0.8) > 0.2  # a share of 0.2 leaves 0.8: as promised
    assert pace(0.2, 0.9) == 0.2
    assert pace(0.2, 1.0) == FREE_MAP.slowest
    assert pace(1.0, 0.9) < 1
    assert pace(1.0, 0.1) == 1


@pytest.mark.slow
@pytest.mark.parametrize("smoothness", [0.5, 1.5])
def test_95_percent_bands_hold_the_truth_on_draws_of_the_prior(body, grid, smoothness):
    """40 bodies, prior as given, layers included: about 95 % of all places lie inside.

    Of the seen ones a little fewer: strong layers bend what the bands take for straight.
    """
    rng, inside, seen = np.random.default_rng(7), [], []
    hyper = Hyper(0.02, 0.4, 0.01, ("length_m", "spread"), smoothness)
    prior = replace(hyper.prior(grid, FREE_MAP), level_spread=0.0)
    for true in prior.draws(rng, 40):
        model = model_of(body, grid, FreeMap(grid, LEVEL + true), rng)
        fit = FreeMapFit(model, hyper, (0.009, 0.06)).run()
        hit = np.abs(fit.map.log_pa - LEVEL - true) < 1.96 * fit.field.log_sd
        inside.append(hit.mean())
        seen.append(hit[fit.field.share > 0.5].mean())
    assert 0.92 < np.mean(inside) < 0.98, np.mean(inside)
    assert 0.88 < np.mean(seen) < 0.98, np.mean(seen)


@pytest.mark.slow
def test_false_spots_on_bodies_without_any(body, grid):
    """20 bodies each, even and with a gradient: at most one of twenty shows a spot."""
    rng, false = np.random.default_rng(8), 0
    for number in range(40):
        slope = 0.0 if number % 2 else 0.5
        true = LEVEL + slope * (grid.points_m[:, 0] / SIZE_M[0] - 0.5)
        model = model_of(body, grid, FreeMap(grid, true), rng)
        fit = FreeMapFit(model, Hyper(0.015, 0.5, 0.01), (0.009, 0.06)).run()
        false += any(spot.found for spot in fit.field.spots)
    assert false <= 2


@pytest.mark.slow
def test_layers_are_alike_at_one_height_with_the_covariance_of_their_own():
    grid = Grid((0.0, 0.0, 0.0), (0.01, 0.01, 0.01), (4, 3, 3))
    prior = MaternField(grid, 0.02, 0.3, 1.0, 0.5, 0.01)
    covariance = prior.product(np.eye(len(grid)))
    layers = replace(prior, spread=1e-9, level_spread=0.0).product(np.eye(len(grid)))
    z = grid.points_m[:, 2]
    s = np.sqrt(3) * np.abs(z[:, None] - z) / 0.01
    assert layers == pytest.approx(0.25 * (1 + s) * np.exp(-s), abs=1e-12)
    draws = prior.draws(np.random.default_rng(4), 20000)
    assert np.cov(draws.T) == pytest.approx(covariance, abs=0.06)


def test_readings_of_presses_that_are_left_out_do_not_count(body, grid):
    model = model_of(body, grid, FreeMap(grid, np.full(len(grid), LEVEL)), np.random.default_rng(1))
    weight = np.ones(model.readings.presses)
    weight[:8] = 0.0
    fit = FreeMapFit(model, Hyper(0.02, 0.3, 0.01), (0.012, 0.06), weight=weight).run()
    assert fit.dof == fit.counted == 17 * len(FORCES_N)
    assert fit.chi2_per_dof == pytest.approx(fit.chi2 / fit.dof)
    assert fit.history[-1].chi2_per_dof == pytest.approx(fit.history[-1].chi2 / fit.dof)
    assert "smaller than the noise" not in fit.message


@pytest.mark.slow
def test_beside_a_steep_wall_the_bands_hold():
    """A prior that changes gradually explains the wall by layers that are not there."""
    job = ("slab", 1)
    gradual, steep = (free_maps.trial((*job, smoothness)) for smoothness in (1.5, 0.5))
    assert steep["success"]
    assert steep["held_seen"] > 0.9 > gradual["held_seen"]
    assert steep["rms_off"] < 0.8 * gradual["rms_off"]
