"""Least misfit of a ball's presses on a body of any kind, and the small problems behind it."""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts
from identify.body.state import BodyState
from identify.effects.readings import Readings
from identify.fit.free_compliance import FreeCompliance
from identify.fit.free_compliance_start import on_any_body
from identify.measurement.chain import OperatingPoint
from identify.measurement.noise import Noise
from identify.optimize.side_by_side import minimize_side_by_side
from models import Scan

NOISE, BALL_M, NU, E = Noise(2e-5, 2e-3), 4e-3, 0.45, 2e4
PRESSES, READINGS = 9, 14
LUMP, SLIP, EVEN = (1, 4), 6, (0, 2, 3, 5, 7, 8)  # kinds of presses
GROWTH = -1.07


def contacts(profile: str) -> Contacts:
    x = 0.01 * np.arange(PRESSES)
    points = np.column_stack([x, 0 * x, 0 * x])
    down = np.tile([0, 0, -1.0], (PRESSES, 1))
    radius = 0.6 * BALL_M if profile == "hertz" else BALL_M
    return Contacts(points, down, np.full(PRESSES, radius), profile)


def pressed(profile: str) -> FreeCompliance:
    """Presses on an even body; two above a hard lump under a thin layer, and one that slips."""
    at, press = contacts(profile), np.repeat(np.arange(PRESSES), READINGS)
    force = np.tile(np.linspace(0.02, 0.6, READINGS), PRESSES)
    scan = Scan(
        press=press, time_s=np.full(len(press), np.nan), phase=np.full(len(press), "load"),
        point_m=at.points_m[press], direction=at.directions[press], force_n=force,
        displacement_m=force, probe_radius_m=np.full(len(press), BALL_M),
    )  # fmt: skip
    unit = np.full(PRESSES, 0.6 * (1 - NU**2) / (0.6 * BALL_M))
    state = BodyState(((-0.05, -0.05, -0.03), (0.13, 0.05, 0.0)), NU)
    growth = np.full(PRESSES, GROWTH) if profile == "hertz" else None
    made = FreeCompliance(Readings.of(scan), force, NOISE, at, NU, unit, state, growth)
    hard = np.isin(np.arange(PRESSES), LUMP)
    chain = replace(made.chain([]), growth=None if growth is None else np.where(hard, -2.8, growth))
    point = OperatingPoint(unit / E * np.where(hard, 0.25, 1.0), np.full(PRESSES, E), force, {})
    travel = chain.predict(point)
    travel = travel + 4e-4 * ((press == SLIP) & (np.arange(len(press)) % READINGS > 8))
    rng = np.random.default_rng(11)
    noisy = scan.replace(force_n=force + NOISE.force_n * rng.standard_normal(len(force)))
    travel = travel + NOISE.displacement_m * rng.standard_normal(len(force))
    return replace(made, readings=Readings.of(noisy), displacement_m=travel)


def test_a_balls_curve_above_a_hard_lump_is_that_of_some_body_and_a_slip_is_not():
    presses = pressed("hertz")
    found = presses.fit(())
    least = on_any_body(presses, found).on_any_body
    assert least is not None
    own, _ = found.by_press
    off = [*LUMP, SLIP]
    assert (own[off] > 100).all()
    assert (least[list(LUMP)] < 25).all()  # eleven degrees of freedom
    assert least[SLIP] > 100
    assert np.array_equal(least[list(EVEN)], own[list(EVEN)])
    assert (least <= own).all()


def test_the_middle_press_is_noise_beside_a_lump_and_a_slip_but_not_where_all_have_a_cause():
    presses = pressed("hertz")
    found = on_any_body(presses, presses.fit(()))
    assert found.noise_share < 0.8
    assert found.middle_misfit == pytest.approx(1, abs=0.25)  # nine presses of 13 numbers
    wave = 6e-5 * np.sin(np.arange(len(presses.readings)))
    waved = replace(presses, displacement_m=presses.displacement_m + wave)
    assert on_any_body(waved, waved.fit(())).middle_misfit > 1.5


def test_a_flat_tip_feels_no_more_than_a_compliance():
    presses = pressed("flat")
    found = presses.fit(())
    assert found.by_press[0][SLIP] > 100
    assert np.array_equal(on_any_body(presses, found).on_any_body, found.by_press[0])


def test_small_problems_are_solved_side_by_side_each_within_its_bounds():
    owner = np.repeat(np.arange(3), 8)
    t = np.tile(np.linspace(0.1, 2.0, 8), 3)
    true = np.array([[1.0, 2.0, 0.5], [0.7, 1.5, 3.0]])

    def residuals(x: np.ndarray) -> np.ndarray:
        with np.errstate(over="ignore"):
            return x[0][owner] * np.exp(-x[1][owner] * t) - true[0][owner] * np.exp(
                -true[1][owner] * t
            )

    low, high = np.full((2, 3), 0.1), np.full((2, 3), 5.0)
    high[1, 2] = 2.0
    found, squares = minimize_side_by_side(
        residuals, owner, np.full((2, 3), 1.0), (low, high), np.full(2, 1e-6), rounds=60
    )
    assert found[:, :2] == pytest.approx(true[:, :2], rel=1e-4)
    assert squares[:2] == pytest.approx(0.0, abs=1e-9)
    assert found[1, 2] == pytest.approx(2.0)
    assert squares[2] > 1e-4
