"""The form of an effect as a curve: its course by the law, its band by the fit's covariance."""

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.fit.joint_fit import fit_jointly
from identify.select.form_average import posterior_covariance
from identify.select.form_curve import form_curves
from tests.identify.select.loop_problem import SIZE, TRUE, model, points
from tests.identify.select.test_forward_selection import creeping, planted


def fitted(change, name, **start):
    table = planted(3, change)
    plain = model(table)
    state = plain.mechanics.state()
    return fit_jointly(plain.with_effect(CATALOGUE[name], start, state), TRUE, rounds=0)


def test_the_course_of_a_drift_is_a_line_with_a_band_that_opens():
    fit = fitted(lambda d, f, t, phase, press: (d, f + 2e-4 * (t - t.min())), "force_drift",
                 rate_n_per_s=1e-4)  # fmt: skip
    (curve,) = form_curves(fit)
    assert (curve.unit, curve.at_unit) == ("N", "s")
    at, rate = np.array(curve.at), fit.values["force_drift.rate_n_per_s"]
    np.testing.assert_allclose(curve.value, rate * at, atol=1e-9)
    assert rate == pytest.approx(2e-4, rel=0.1)
    assert fit.solution is not None
    (rate_p,) = fit.model.effects[0].parameters
    reach = 1.959964 * np.sqrt(fit.solution.noise_covariance[-1, -1]) * rate_p.typical * at
    np.testing.assert_allclose(np.subtract(curve.upper95, curve.value), reach, rtol=0.02, atol=1e-9)
    np.testing.assert_allclose(np.subtract(curve.value, curve.lower95), reach, rtol=0.02, atol=1e-9)


def test_creep_is_drawn_within_the_press_to_which_it_adds_most():
    fit = fitted(creeping(0.1, 0.7), "viscoelasticity", g=0.05, tau_s=1.0)
    (curve,) = form_curves(fit)
    assert curve.unit == "1"
    assert len(curve.at) == 22
    assert 0.07 < max(curve.value) < 0.13
    assert np.all(np.array(curve.lower95) <= curve.value)
    assert np.all(np.array(curve.upper95) >= curve.value)
    assert np.all(np.linalg.eigvalsh(posterior_covariance(fit)) > 0)


def test_a_bent_law_is_drawn_along_the_force():
    fit = fitted(lambda d, f, t, phase, press: (d, f / (1 + 0.2 * f / 0.3)), "force_saturation",
                 loss=0.1, sharpness=1.0)  # fmt: skip
    (curve,) = form_curves(fit)
    assert (curve.along, curve.at_unit, curve.unit) == ("force, in one press", "N", "1")
    assert np.all(np.diff(curve.at) >= 0)
    force = np.array(curve.at)
    lost = force / (1 - 0.2 * force / 0.3) - force  # of a reading F / (1 + 0.2 F / 0.3)
    wanted = lost / (0.3 / 1.2)
    assert np.all(wanted > np.array(curve.lower95) - 0.01)
    assert np.all(wanted < np.array(curve.upper95) + 0.01)
    assert 0.01 < max(np.subtract(curve.upper95, curve.lower95)) < 0.2


def test_an_effect_without_a_course_has_no_curve():
    fit = fitted(lambda d, f, t, phase, press: (d + 1e-4, f), "contact_offset", offset_m=5e-5)
    assert form_curves(fit) == ()


def test_an_uneven_surface_is_drawn_over_the_contact_points():
    high = 1e-4 * (points()[:, 0] - 0.5 * SIZE[0]) / SIZE[0]  # a plane along x

    def raised(d, f, t, phase, press):
        return d + high[press], f

    fit = fitted(raised, "surface_tilt", offset_m=1e-5, slope_x=0.0, slope_y=0.0)
    (curve,) = form_curves(fit)
    assert (curve.unit, curve.of) == ("m", "added to the displacement")
    np.testing.assert_allclose(curve.places_m, points())
    off = np.subtract(curve.value, high)
    reach = np.subtract(curve.upper95, curve.value)
    assert np.abs(off).max() < 2e-5
    assert np.mean(np.abs(off) < reach) > 0.8
    assert 1e-6 < reach.min() < reach.max() < 4e-5
