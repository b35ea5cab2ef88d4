"""Bands of predicted scans: calibrated where model and truth agree, exceeded where they do not."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from identify.body import BodyMechanics
from identify.catalogue import CATALOGUE
from identify.effects import Readings
from identify.fit import FitResult
from identify.fit.free_map.field_evidence import Hyper
from identify.fit.free_map_fit import FreeMapFit
from identify.fit.joint_fit import fit_jointly
from identify.fit.map_fit import fit_scan
from identify.map import FreeMap, GaussianMap, Grid, Inclusion, MaternField
from identify.map.parameters import ParameterSpace, parameter_space
from identify.measurement.experiment import BodyModel, MapGuess, PlacedExperiment
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.residual import Prediction, predict
from identify.residual.fitted_model import fitted_model as model_of_fit
from identify.residual.law_error import _sizes, unevenness
from models import Catalogue, Scan

SIZE_M = (0.06, 0.06, 0.03)
NOISE = Noise(2e-5, 5e-3)
FORCES_N = np.linspace(0.1, 0.8, 8)
TRUTH = GaussianMap(8e3, (Inclusion(12e3, 0.03, 0.035, 0.02, 0.009),))
LEVEL, PRIOR = np.log(8e3), (0.02, 0.3)


def contacts(per_side: int, radius_m: float) -> Contacts:
    axis = np.linspace(0.01, 0.05, per_side)
    x, y = (a.ravel() for a in np.meshgrid(axis, axis))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    return Contacts(points, np.tile([0, 0, -1.0], (x.size, 1)), np.full(x.size, radius_m))


@cache
def model_of(per_side: int, radius_m: float) -> PalpationModel:
    return PalpationModel(block_mesh(SIZE_M, (5, 5, 3)), 0.45, contacts(per_side, radius_m))


def fitted_model() -> PalpationModel:
    return model_of(5, 0.004)


def other_model() -> PalpationModel:
    """Other places, a smaller tip."""
    return model_of(4, 0.003)


def scan_of(model: PalpationModel, truth: GaussianMap, rng, reach: float = 1.0) -> Scan:
    """Noisy readings of a true map on the same mesh: the bands are tested, not the elements."""
    j, k = len(model.contacts), len(FORCES_N)
    press = np.repeat(np.arange(j), k)
    force = reach * np.tile(FORCES_N, j)
    travel = model.evaluate(truth.modulus(model.points_m)).compliance[press] * force
    return Scan(
        press=press, time_s=np.full(j * k, np.nan), phase=np.full(j * k, "load"),
        force_n=force + rng.normal(0, NOISE.force_n, j * k),
        displacement_m=travel + rng.normal(0, NOISE.displacement_m, j * k),
        point_m=model.contacts.points_m[press], direction=model.contacts.directions[press],
        probe_radius_m=model.contacts.radius_m[press],
    )  # fmt: skip


def experiment_of(scan: Scan) -> PlacedExperiment:
    return PlacedExperiment(scan, BodyModel(*3 * [fitted_model()], ""), NOISE, MapGuess(1))


def fitted(scan: Scan) -> FitResult:
    free = ["background_pa", "inclusion_1.weight_pa", "inclusion_1.z_m"]
    model = fitted_model()
    return fit_scan(scan, model, noise=NOISE, fine_model=model, start=TRUTH, free=free)


def predicted(seed: int) -> Prediction:
    rng = np.random.default_rng(seed)
    scan = scan_of(fitted_model(), TRUTH, rng)
    other = scan_of(other_model(), TRUTH, rng, reach=1.5)
    return predict(experiment_of(scan), fitted(scan), CATALOGUE, other, NOISE)


@pytest.mark.slow
def test_bands_of_other_places_a_smaller_tip_and_more_force_are_calibrated():
    found = [predicted(seed) for seed in range(6)]
    squares = np.array([p.chi2 / p.presses for p in found])
    # 96 errors: one standard deviation of the mean is 0.14; spurious errors of laws widen
    assert 0.6 < squares.mean() < 1.3
    assert np.mean([p.within95 for p in found]) > 0.9
    assert all(p.verdict != "too narrow" for p in found)
    near = found[0].scan.near_largest_force
    share = found[0].parts_m["map and effects"][near] / found[0].parts_m["noise"][near]
    assert share.max() > 0.3  # of a part that is there


@pytest.mark.parametrize("seed", [0, pytest.param(1, marks=pytest.mark.slow)])
def test_bands_of_a_free_map_are_calibrated_where_it_is_blind_too(seed):
    rng = np.random.default_rng(seed)
    grid = Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.006)
    field = MaternField(grid, *PRIOR, smoothness=0.5).draws(rng, 1)[0]
    truth = FreeMap(grid, LEVEL + field)
    scan = scan_of(fitted_model(), truth, rng)
    start = FreeMap(grid, np.full(len(grid), LEVEL))
    model = MeasurementModel(
        Readings.of(scan), scan.displacement_m, NOISE, BodyMechanics.of(fitted_model()),
        ParameterSpace(start, (), ()),
    )  # fmt: skip
    hyper = Hyper(*PRIOR, 0.0, ("length_m", "spread"))
    fit = FreeMapFit(model, hyper, (0.01, 0.06)).run()
    found = predict(
        experiment_of(scan), fit, CATALOGUE, scan_of(other_model(), truth, rng, reach=1.5), NOISE
    )
    assert found.verdict == "calibrated"
    assert 0.2 < found.chi2 / found.presses < 2.2  # one standard deviation is 0.35
    near = found.scan.near_largest_force
    assert found.parts_m["map and effects"][near].mean() > found.parts_m["noise"][near].mean()


def test_a_ball_over_something_hard_is_predicted_by_the_contact_of_the_fit():
    """On one mesh alone: the contact grows in the prediction as in the fit, not otherwise."""
    rng, grid = np.random.default_rng(6), Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.006)
    hard_below = FreeMap(grid, LEVEL + 2.0 * (grid.points_m[:, 2] < 0.022))
    ball = replace(contacts(3, 0.004), profile="hertz")
    body = PalpationModel(block_mesh(SIZE_M, (5, 5, 3)), 0.45, ball)
    scan = scan_of(body, hard_below, rng).replace(probe_radius_m=np.full(9 * len(FORCES_N), 0.008))
    start = FreeMap(grid, np.full(len(grid), LEVEL + 0.5))

    def of(scan: Scan, stiffness: FreeMap) -> MeasurementModel:
        space = ParameterSpace(stiffness, (), ())
        parts = Readings.of(scan), scan.displacement_m, NOISE, BodyMechanics.of(body), space
        unit = 1e4 * body.evaluate(1e4).compliance
        return MeasurementModel(*parts, (), unit_compliance=unit)

    true = of(scan, hard_below).corrected(np.empty(0))
    assert np.median(true.mechanics.correction.tip.growth) < -1.1  # a half-space has -1
    travel = true.linearise(np.empty(0)).predicted_m
    scan = scan.replace(displacement_m=travel + rng.normal(0, 2e-5, len(travel)))
    hyper = Hyper(0.012, 1.0, 0.0, ("length_m", "spread"))
    fit = FreeMapFit(of(scan, start), hyper, (0.01, 0.06)).run()
    experiment = PlacedExperiment(scan, BodyModel(*3 * [body], ""), NOISE, MapGuess(1))
    anew = model_of_fit(experiment, fit, CATALOGUE)
    own = replace(fit.model, map_uncertainty=None).linearise(fit.u).predicted_m
    assert fit.success
    off = anew.linearise(np.empty(0)).predicted_m / own - 1
    assert np.abs(off).max() < 1e-6  # 2.5e-2 with the growth of the contact at the map


def test_errors_of_another_body_exceed_the_bands():
    rng = np.random.default_rng(3)
    scan = scan_of(fitted_model(), TRUTH, rng)
    harder = GaussianMap(1.1 * TRUTH.background_pa, TRUTH.inclusions)
    found = predict(
        experiment_of(scan), fitted(scan), CATALOGUE, scan_of(other_model(), harder, rng), NOISE
    )
    assert found.verdict == "too narrow"
    assert np.median(found.force_error_share) == pytest.approx(-0.09, abs=0.03)


def test_a_law_that_fails_deeper_is_foreseen_by_the_fits_own_presses():
    """A body that stiffens: the shallow presses show it less, and the bands count it."""
    rng = np.random.default_rng(4)

    def stiffened(scan: Scan) -> Scan:
        return scan.replace(displacement_m=scan.displacement_m / (1 + scan.displacement_m / 0.02))

    model = fitted_model()
    scan, other = stiffened(scan_of(model, TRUTH, rng)), scan_of(model, TRUTH, rng, reach=1.5)
    deeper = predict(experiment_of(scan), fitted(scan), CATALOGUE, stiffened(other), NOISE)
    again = predict(experiment_of(scan), fitted(scan), CATALOGUE, scan, NOISE)
    laws = [p.parts_m["laws"][p.scan.near_largest_force].mean() for p in (deeper, again)]
    assert laws[0] > 2 * laws[1]
    assert deeper.verdict != "too narrow"
    assert np.sqrt(np.mean(deeper.press_error_m**2)) > 5 * NOISE.displacement_m


def test_readings_no_deeper_than_the_fits_have_the_error_of_its_curves_alone():
    """Of a body that stiffens, deeper presses of the same places, by laws of no other contact."""
    rng, model = np.random.default_rng(4), fitted_model()
    scan, other = scan_of(model, TRUTH, rng), scan_of(model, TRUTH, rng, reach=1.5)
    scan, other = (
        s.replace(displacement_m=s.displacement_m / (1 + s.displacement_m / 0.02))
        for s in (scan, other)
    )
    own = Catalogue(effect for effect in CATALOGUE if "contact" not in effect.hooks)
    fit, experiment = fitted(scan), experiment_of(scan)
    deeper, again = (predict(experiment, fit, own, s, NOISE) for s in (other, scan))
    share, known = (p.parts_m["laws"] / p.scan.displacement_m for p in (deeper, again))
    first = np.unique(scan.press_index, return_index=True)[1]
    known = known[first][other.press_index]
    seen = other.displacement_m < 0.5 * np.median(scan.displacement_m[scan.near_largest_force])
    assert known.max() > 0
    assert share[seen] == pytest.approx(known[seen])
    assert share[other.near_largest_force].mean() > 1.2 * known.mean()


def test_an_effect_that_nobody_knows_is_refused_by_name():
    scan = scan_of(fitted_model(), TRUTH, np.random.default_rng(5))
    fit = fitted(scan)
    known = dict(fit.parameters)
    strange = replace(fit, estimates={**known, "cable.drag_n": known["background_pa"]})
    with pytest.raises(ValueError, match="the effect 'cable', which is not in the catalogue"):
        predict(experiment_of(scan), strange, CATALOGUE, scan, NOISE)


def test_a_sensor_that_saturates_does_so_at_the_force_of_the_scan_that_showed_it():
    """Presses that go to a third of its force lose hardly any; stated anew, a tenth."""
    model, values = fitted_model(), {"loss": 0.1, "sharpness": 2.0}

    def scan(reach: float) -> Scan:
        straight = scan_of(model, TRUTH, np.random.default_rng(3), reach)
        lost = 1 + 0.1 * (straight.force_n / FORCES_N[-1]) ** 2
        return straight.replace(displacement_m=straight.displacement_m * lost)

    seen, lighter = scan(1.0), scan(1 / 3)
    box = np.array([[0, 0, 0], SIZE_M])
    plain = MeasurementModel(
        Readings.of(seen), seen.displacement_m, NOISE, BodyMechanics.of(model),
        parameter_space(TRUTH, box, ["background_pa"]),
    )  # fmt: skip
    effect = CATALOGUE["force_saturation"]
    fit = fit_jointly(plain.with_effect(effect, values, plain.mechanics.state()), TRUTH)
    found = predict(experiment_of(seen), fit, CATALOGUE, lighter, NOISE)
    largest = lighter.near_largest_force
    assert abs(np.mean(found.residual_m[largest] / found.predicted_m[largest])) < 0.01


def test_a_law_that_shallow_presses_cannot_tell_from_the_fits_widens_the_bands_of_deeper_ones():
    """A flat tip whose body stiffens by less than the noise as far as it was pressed."""
    rng, model = np.random.default_rng(7), fitted_model()
    scan = scan_of(model, TRUTH, rng)
    fit, experiment = fitted(scan), experiment_of(scan)
    own = {effect.name: effect for effect in CATALOGUE if "contact" not in effect.hooks}
    found = [
        predict(experiment, fit, known, scan_of(model, TRUTH, rng, reach=reach), NOISE)
        for reach, known in ((2.0, CATALOGUE), (2.0, Catalogue(own.values())), (1.0, CATALOGUE))
    ]
    forms, alone, again = (p.parts_m["laws"][p.scan.near_largest_force].mean() for p in found)
    assert forms > 2 * max(alone, again)
    assert forms > NOISE.displacement_m
    # The band is one error that all presses share, and chi-square sees the rest: noise
    z = found[0].press_error_m / found[0].press_sd_m
    assert np.sqrt(np.mean(z**2)) < 1 / 5
    assert 0.3 < found[0].chi2 / found[0].presses < 2
    assert (found[0].verdict, found[2].verdict) == ("too wide", "calibrated")
    assert found[0].band_over_error > 5 > 1.5 > found[2].band_over_error


@pytest.mark.parametrize(("own", "growth"), [(0.0, 0.0), (0.04, 0.0), (0.0, 0.08)])
def test_sizes_of_an_error_of_laws_are_found_beside_noise(own, growth):
    rng = np.random.default_rng(8)
    noise, uneven = np.full(400, 0.02**2), rng.exponential(0.5, 400)
    sd = np.sqrt(noise + own**2 + (growth * uneven) ** 2)
    found = _sizes(sd * rng.standard_normal(400), noise, uneven)
    assert found == pytest.approx((own, growth), abs=0.015)


def test_a_press_is_uneven_where_its_neighbours_are_of_another_hardness():
    x, y = (a.ravel() for a in np.meshgrid(np.arange(6.0), np.arange(6.0)))
    points, log_c = np.column_stack([x, y, 0 * x]), np.where(x > 2.5, -1.0, 0.0)
    own = unevenness(points, log_c, points, log_c)
    assert set(own[(x == 2) | (x == 3)]) == {1.0}
    assert set(own[(x < 1) | (x > 4)]) == {0.0}
    between = unevenness(np.array([[2.5, 2.5, 0.0]]), np.array([-0.4]), points, log_c)
    assert between == pytest.approx(0.6)
