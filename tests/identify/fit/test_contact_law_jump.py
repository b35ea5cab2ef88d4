"""Jumps in the press curves: their instant lies between two presses, to which no slope leads."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from fem import Contacts
from identify.body.state import BodyState
from identify.catalogue.catalogue import CATALOGUE
from identify.effects.readings import Readings
from identify.fit.contact_law import contact_law
from identify.fit.contact_law_sets import _nearest_shape, well_spread_presses
from identify.fit.free_compliance import FreeCompliance
from identify.fit.settings import CONTACT_LAW, FREE_COMPLIANCE_TRIAL
from identify.measurement.noise import Noise

SIDE, PACE_S, TIP_M, NU = 12, 6.0, 5e-3, 0.45
PRESSES = SIDE**2
NOISE = Noise(1e-5, 2e-3)
JUMP = CATALOGUE["force_jump"]
EFFECTS = [CATALOGUE[n] for n in ("force_jump", "displacement_jump", "displacement_wander")]


@cache
def jumped(number: int, zero_n: float) -> FreeCompliance:
    """Presses of a body of random stiffness; the force jumps before one of them."""
    rng = np.random.default_rng(number)
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0.012, 0.084, SIDE)] * 2))
    share = np.r_[np.linspace(0.2, 1, 7), np.linspace(0.8, 0.3, 3)]
    press, force = np.repeat(np.arange(PRESSES), 10), 0.3 * np.tile(share, PRESSES)
    time = PACE_S * press + np.tile(np.linspace(0, 3, 10), PRESSES)
    point = np.column_stack([x, y, np.full(PRESSES, 0.048)])[press]
    read = force + zero_n * (press >= number) + rng.normal(0, NOISE.force_n, len(press))
    c = 2e-3 * np.exp(rng.normal(0, 0.1, PRESSES))
    readings = Readings(
        press, np.arange(PRESSES), time, np.tile(np.repeat(["load", "unload"], (7, 3)), PRESSES),
        point, np.tile([0.0, 0.0, -1.0], (len(press), 1)), read, np.full(len(press), TIP_M),
    )  # fmt: skip
    return FreeCompliance(
        readings, c[press] * force + rng.normal(0, NOISE.displacement_m, len(press)), NOISE,
        Contacts(point[readings.first], np.array([0.0, 0.0, -1.0]), TIP_M), NU,
        np.full(PRESSES, (1 - NU) / (2 * TIP_M)), BodyState(((0, 0, 0), (0.096, 0.096, 0.048)), NU),
    )  # fmt: skip


@pytest.mark.parametrize(
    ("number", "zero_n"), [(20, 0.1), (30, 0.1), (45, -0.1), (90, 0.1), (120, -0.03)]
)
def test_the_instant_of_a_jump_is_found_to_the_press(number, zero_n):
    law = contact_law(jumped(number, zero_n), EFFECTS)
    assert law.names == ("force_jump",)
    assert law.found.chi2_per_dof < 1.1
    found = law.found.values["force_jump"]
    assert found["zero_n"] == pytest.approx(zero_n, abs=2e-3)
    assert PACE_S * (number - 1) + 3 < found["at_s"] < PACE_S * number + 0.1


def test_all_presses_are_fitted_within_bounds_of_their_own():
    own = jumped(4, 0.1)
    some = replace(CONTACT_LAW, searched=24)
    few = well_spread_presses(own, some.searched)
    _, narrow = JUMP.bounded(few.readings, own.state)
    assert narrow.lower > PACE_S * 4
    law = contact_law(own, EFFECTS, settings=some)
    assert law.names == ("force_jump",)
    assert law.found.values["force_jump"]["at_s"] < PACE_S * 4
    for part in law.found.parts:
        assert part.parameters == JUMP.bounded(own.readings, own.state)


def test_a_step_that_no_slope_leads_to_does_not_hold_up_the_others():
    own = replace(jumped(90, -0.1), settings=FREE_COMPLIANCE_TRIAL)
    shape = {"at_s": PACE_S * 90 - 1.5}
    found = own.fit([own.part(JUMP, {**shape, "zero_n": 0.0})]).values["force_jump"]
    assert found["zero_n"] < -0.05  # in steps of one hundredth
    assert found["at_s"] == shape["at_s"]


@pytest.mark.parametrize("best", [0, 1, 57, 138])
def test_the_nearest_of_many_shapes_is_found_in_few_evaluations(best):
    shapes, asked = [{"at_s": float(i)} for i in range(139)], []

    def score(shape):
        asked.append(shape)
        return -abs(shape["at_s"] - best)

    assert _nearest_shape(shapes, 12, score) == {"at_s": best}
    assert len(asked) <= 40
