"""Creep, relaxation and the retarded response to a history, against closed forms."""

import numpy as np
import pytest
from scipy.integrate import quad

from fem.errors import SolverError
from tests.fem.reference.prony import Creep, Relaxation, respond, retarded

CREEP = Creep([0.3, 0.05, 0.8], [0.2, 1.5, 30.0])
ONE = np.zeros(400, int)


def trapezoid_press(t: np.ndarray) -> np.ndarray:
    return np.interp(t, [0.0, 0.5, 2.0, 2.3, 9.0], [0.0, 3.0, 3.0, 0.4, 0.4])


def test_one_term_is_the_standard_linear_solid():
    creep = Relaxation([0.4], [2.0]).creep()
    np.testing.assert_allclose(creep.amplitudes, 0.4 / 0.6, rtol=1e-14)
    np.testing.assert_allclose(creep.times_s, 2.0 / 0.6, rtol=1e-14)
    back = creep.relaxation()
    np.testing.assert_allclose([*back.amplitudes, *back.times_s], [0.4, 2.0], rtol=1e-14)


def test_creep_and_relaxation_of_one_material_convolve_to_the_time():
    relaxation = CREEP.relaxation()
    for t in (0.01, 0.4, 3.0, 80.0):
        value, _ = quad(lambda s, t=t: float(relaxation(t - s) * CREEP(s)), 0, t, limit=400,
                        points=[min(0.3, t / 2), min(3.0, t / 1.5)], epsabs=1e-10)  # fmt: skip
        np.testing.assert_allclose(value, t, rtol=1e-8)


def test_conversion_there_and_back_keeps_every_term():
    back = CREEP.relaxation().creep()
    order = np.argsort(back.times_s)
    np.testing.assert_allclose(back.times_s[order], CREEP.times_s, rtol=1e-10)
    np.testing.assert_allclose(back.amplitudes[order], CREEP.amplitudes, rtol=1e-10)


def test_a_term_without_amplitude_stays_without_and_no_terms_are_elastic():
    creep = Relaxation([0.0, 0.2], [5.0, 1.0]).creep()
    order = np.argsort(creep.times_s)
    np.testing.assert_allclose(creep.amplitudes[order], [0.25, 0.0], atol=1e-15)
    history = trapezoid_press(np.linspace(0, 9, 400))
    still = respond(Creep([], []), history, np.linspace(0, 9, 400), ONE)
    np.testing.assert_array_equal(still, history)


def test_a_step_gives_the_creep_function_itself():
    times = np.concatenate([[0.0], np.geomspace(1e-6, 300, 300)])
    response = respond(CREEP, np.full(301, 2.5), times, np.zeros(301, int))
    np.testing.assert_allclose(response, 2.5 * CREEP(times), rtol=1e-13)


def test_a_ramp_gives_the_integral_of_the_creep_function():
    times = np.array([0.0, 1e-9, 0.3, 0.31, 4.0, 70.0])
    response = respond(CREEP, 0.7 * times, times, np.zeros(6, int))
    j, kappa = CREEP.amplitudes, CREEP.times_s
    exact = [t + np.sum(j * (t + kappa * np.expm1(-t / kappa))) for t in times]
    np.testing.assert_allclose(response, 0.7 * np.array(exact), rtol=1e-12, atol=1e-20)


def test_a_piecewise_linear_history_needs_only_its_corners():
    corners = np.array([0.0, 0.5, 2.0, 2.3, 9.0])
    fine = np.union1d(corners, np.linspace(0, 9, 1000))
    coarse = respond(CREEP, trapezoid_press(corners), corners, np.zeros(5, int))
    dense = respond(CREEP, trapezoid_press(fine), fine, np.zeros(len(fine), int))
    np.testing.assert_allclose(dense[np.isin(fine, corners)], coarse, rtol=1e-12, atol=1e-13)


def test_relaxation_undoes_creep_as_the_steps_shrink():
    errors = []
    for count in (400, 800):
        times = np.linspace(0, 9, count + 1)
        press = np.zeros(len(times), int)
        force = np.sin(times) ** 2
        creep = respond(CREEP, force, times, press)
        back = respond(CREEP.relaxation(), creep, times, press)
        errors.append(np.abs(back - force).max())
    assert errors[0] < 1e-3
    assert np.log2(errors[0] / errors[1]) == pytest.approx(2, abs=0.2)


def test_presses_have_their_own_histories_and_remember_at_the_same_place():
    times = np.linspace(0, 9, 60)
    first, second = trapezoid_press(times), 2 * np.sqrt(times)
    rows = np.stack([first, second], axis=1).ravel()  # row by row in turn
    mixed = respond(CREEP, rows, np.repeat(times, 2), np.tile([0, 1], 60))
    for place, alone in enumerate((first, second)):
        expected = respond(CREEP, alone, times, np.zeros(60, int))
        np.testing.assert_allclose(mixed[place::2], expected, rtol=1e-13)
    again = respond(CREEP, [1.0, 1.0, 0.0, 0.0], [0.0, 1.0, 1.0, 3.0], np.zeros(4, int))
    np.testing.assert_allclose(again[3], CREEP(3.0) - CREEP(2.0), rtol=1e-13)


def test_derivatives_by_the_times_are_those_of_differences():
    rng = np.random.default_rng(5)
    times = np.sort(rng.uniform(0, 5, 50))
    times[20] = times[19]
    press = rng.integers(0, 3, 50)
    history = rng.normal(size=(50, 2))
    tau, step = np.array([0.02, 0.9, 4e5]), 1e-5
    exact = retarded(history, times, press, tau).by_time
    up, down = (retarded(history, times, press, tau * (1 + s)).parts for s in (step, -step))
    for i, t in enumerate(tau):
        central = (up[i] - down[i]) / (2 * step * t)
        np.testing.assert_allclose(exact[i], central, atol=1e-8 * np.abs(central).max())


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Relaxation([0.6, 0.4], [1, 2]), "sum to less than 1"),
        (lambda: Creep([-0.1], [1.0]), "not be negative"),
        (lambda: Creep([0.1], [0.0]), "positive"),
        (lambda: Creep([0.1, 0.2], [1.0]), "one time for each"),
        (lambda: Creep([np.nan], [1.0]), "finite"),
        (lambda: respond(CREEP, [1.0, 2.0], [1.0, 0.5], np.zeros(2, int)), "row 1: time runs"),
        (lambda: respond(CREEP, [1.0], [1.0, 0.5], np.zeros(2, int)), "each row"),
        (lambda: respond(CREEP, [1.0], [1.0], np.zeros(1)), "whole"),
    ],
)
def test_what_cannot_be_computed_with_is_refused(make, message):
    with pytest.raises(SolverError, match=message):
        make()
