"""A lag between the channels that is known to some accuracy only: an error of all readings."""

from dataclasses import replace

import numpy as np
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.body.mechanics import BodyMechanics
from identify.catalogue.time_lag import TimeLag
from identify.effects.readings import Readings
from identify.map.gaussian_map import GaussianMap
from identify.map.parameters import parameter_space
from identify.measurement.map_uncertainty import MapUncertainty
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.measurement.shared_error import lag_error_m
from identify.residual.whitened import shared_errors
from models.scan import Scan

SIZE = (0.06, 0.06, 0.03)
SPEED_IN, SPEED_OUT = 4e-3, 6e-3
LOAD_S, HOLD_S, UNLOAD_S = np.arange(1, 6) / 5, [1.15, 1.3, 1.45], 1.6 + np.arange(1, 5) / 8
AFTER_TOUCH = np.concatenate([LOAD_S, HOLD_S, UNLOAD_S])
PHASE = np.repeat(["load", "hold", "unload"], [5, 3, 4])
NOISE = Noise(2e-5, 1e-3, lag_s=0.006)


def travel(after_touch):
    into = SPEED_IN * np.clip(after_touch, 0, 1)
    return into - SPEED_OUT * np.clip(after_touch - 1.6, 0, None)


def model_of(lag_s=0.0, noise=NOISE):
    """Three presses whose travel was read `lag_s` late, first touch included."""
    points = np.array([[0.02, 0.03, 0.03], [0.03, 0.025, 0.03], [0.04, 0.03, 0.03]])
    contacts = Contacts(points, [0.0, 0.0, -1.0], [0.004, 0.004, 0.006], "flat")
    body = PalpationModel(block_mesh(SIZE, (3, 3, 2), order=2), 0.45, contacts, near_field=False)
    start = GaussianMap(6000.0)
    press, rows = np.repeat(range(3), 12), np.tile(AFTER_TOUCH, 3)
    force = travel(rows) / compliance(body, start)[press]
    depth = travel(rows + lag_s) - travel(np.array(lag_s))
    scan = Scan(
        press, 5.0 * press + rows, np.tile(PHASE, 3), points[press], np.tile([0, 0, -1.0], (36, 1)),
        force, depth, contacts.radius_m[press],
    )  # fmt: skip
    space = parameter_space(start, body.mesh.box_m)
    model = MeasurementModel(Readings.of(scan), depth, noise, BodyMechanics.of(body), space)
    return model, model.start(start)


def test_the_error_is_the_change_of_the_travel_by_a_late_clock():
    model, _ = model_of()
    moved = model_of(NOISE.lag_s)[0].displacement_m - model.displacement_m
    corners = np.tile(AFTER_TOUCH == 1.0, 3)  # there the phase begins a lag early
    found = lag_error_m(NOISE, model.readings, model.displacement_m)
    assert_allclose(found[~corners], moved[~corners], atol=1e-12)
    assert_allclose(moved[5:8], -NOISE.lag_s * SPEED_IN)
    assert_allclose(moved[8:12], -NOISE.lag_s * (SPEED_IN + SPEED_OUT))
    planned = replace(model.readings, travel_from="plane")  # there the touch is no zero
    found = lag_error_m(NOISE, planned, model.displacement_m)
    assert_allclose(found[:4], NOISE.lag_s * SPEED_IN)


def test_a_misfit_is_weighed_with_the_covariance_of_all_readings():
    model, u = model_of(0.016)
    at = model.linearise(u)
    error = lag_error_m(NOISE, model.readings, model.displacement_m)
    covariance = np.diag(at.sigma_m**2) + np.outer(error, error)
    off = model.displacement_m - at.predicted_m
    assert_allclose(at.residual @ at.residual, off @ np.linalg.solve(covariance, off), rtol=1e-9)
    sharp = replace(model, noise=NOISE.of_readings).linearise(u)
    assert at.chi2 < 0.1 * sharp.chi2


def test_a_lag_within_its_error_is_no_structure_and_no_effect():
    model, u = model_of(NOISE.lag_s)
    plain = replace(model, noise=NOISE.of_readings)
    lag = TimeLag()
    scores = []
    for each in (plain, model):
        beside = each.with_effect(lag, {"lag_s": 0.0}, each.mechanics.state())
        at = beside.linearise(np.append(u, 0.0))
        slope = at.jacobian[:, -1] - at.jacobian[:, :-1] @ np.linalg.lstsq(
            at.jacobian[:, :-1], at.jacobian[:, -1], rcond=None
        )[0]  # fmt: skip
        scores.append((slope @ at.residual) ** 2 / (slope @ slope))
    assert scores[0] > 25
    assert scores[1] < 2
    shared, rms = shared_errors(NOISE, model.readings, model.displacement_m, at.sigma_m)
    error = lag_error_m(NOISE, model.readings, model.displacement_m)
    assert shared is not None
    off = model.displacement_m - at.predicted_m
    assert_allclose(shared.whitened(off / at.sigma_m), at.residual, atol=1e-9)
    assert_allclose(rms, np.sqrt(np.mean(error**2)))


def test_beside_an_uncertain_map_each_press_has_its_own_error_of_the_lag():
    model, u = model_of(0.016)
    uncertain = MapUncertainty(np.zeros((3, 3)), np.zeros(3), np.zeros(3), np.ones(3))
    at = replace(model, map_uncertainty=uncertain).linearise(u)
    error = lag_error_m(NOISE, model.readings, model.displacement_m)
    press = model.readings.press
    covariance = np.diag(at.sigma_m**2)
    covariance += np.outer(error, error) * (press[:, None] == press)
    off = model.displacement_m - at.predicted_m
    assert_allclose(at.chi2, off @ np.linalg.solve(covariance, off), rtol=1e-6)
