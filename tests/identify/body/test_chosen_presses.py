"""Presses chosen among solved ones answer as a model of their own contacts does."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import PalpationModel, block_mesh
from identify.body import BodyMechanics, ChosenMechanics
from identify.map.gaussian_map import GaussianMap, Inclusion
from tests.identify.select.loop_problem import NU, SIZE, TRUE, contacts, uncorrected

CHOSEN = np.array([7, 3, 3, 24, 0])
ELSEWHERE = GaussianMap(6000.0, (Inclusion(9000.0, 0.03, 0.03, 0.02, 0.009),))


@pytest.fixture(scope="module")
def whole():
    return uncorrected()


@pytest.fixture(scope="module")
def chosen(whole):
    return ChosenMechanics.among(whole.evaluate(TRUE, whole.state()), CHOSEN)


@pytest.mark.parametrize("stiffness", [TRUE, ELSEWHERE])
def test_they_answer_as_a_model_of_their_own_contacts(whole, chosen, stiffness):
    """Near fields depend a little on the contacts beside them, by some 1e-4."""
    own = whole.under(contacts().some(CHOSEN))
    state = whole.state()
    expected, found = (m.evaluate(stiffness, state) for m in (own, chosen))
    assert_allclose(found.compliance, expected.compliance, rtol=5e-4)
    by_map, own_by_map = (r.by_map * stiffness.values / r.compliance[:, None]
                          for r in (found, expected))  # fmt: skip
    assert_allclose(by_map, own_by_map, atol=2e-3)
    assert_allclose(found.local_modulus, expected.local_modulus)
    assert_allclose(found.local_by_map, expected.local_by_map)
    for changed in (
        state.changed(poisson_ratio=0.44),
        state.changed(shift_m=(0.001, 0.0)),
        state.changed(skin_thickness_m=0.001, skin_factor=1.5),
    ):
        for way in ("change", "exact_change"):
            c, e = getattr(found, way)(changed)
            own_c, own_e = getattr(expected, way)(changed)
            assert_allclose(c / found.compliance, own_c / expected.compliance, atol=2e-4)
            assert_allclose(e, own_e, rtol=1e-6, atol=1e-9)


def test_presses_chosen_among_chosen_ones_are_those_of_the_whole(whole, chosen):
    known = chosen.evaluate(TRUE, whole.state())
    again = ChosenMechanics.among(known, np.array([1, 4]))
    assert again.known is chosen.known
    assert again.chosen.tolist() == [3, 0]
    assert_allclose(again.contacts.points_m, contacts().points_m[[3, 0]])
    assert_allclose(again.evaluate(TRUE, whole.state()).compliance, known.compliance[[1, 4]])


def test_what_is_known_is_not_solved_again(whole, chosen, monkeypatch):
    monkeypatch.setattr(type(whole), "solve", lambda *_: pytest.fail("a solution of what is known"))
    assert len(chosen.evaluate(TRUE, whole.state()).compliance) == len(CHOSEN)


def test_the_growth_of_a_balls_contact_is_that_of_each_press():
    ball = replace(contacts(), profile="hertz")
    mesh = block_mesh(SIZE, (5, 5, 3))
    whole = BodyMechanics.of(PalpationModel(mesh, NU, ball)).following_growth()
    known = whole.evaluate(TRUE, whole.state())
    found = ChosenMechanics.among(known, CHOSEN).evaluate(TRUE, whole.state())
    assert known.growth is not None
    assert np.ptp(known.growth[CHOSEN]) > 1e-3
    assert_allclose(found.growth, known.growth[CHOSEN])
    assert_allclose(found.growth_by_map, known.growth_by_map[CHOSEN])
    changed = whole.state().changed(skin_thickness_m=0.001, skin_factor=1.5)
    assert_allclose(found.growth_change(changed), known.growth_change(changed)[CHOSEN])
