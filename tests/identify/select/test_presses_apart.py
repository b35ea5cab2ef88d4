"""Presses that stand apart: how long they are sought, and what is kept meanwhile."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.select import presses_apart
from identify.select.presses_apart import apart, hold_misfit
from identify.select.settings import SELECTION


@pytest.mark.parametrize(
    ("slipped", "rough", "holds"), [((7, 8), 1.0, True), ((7,), 1.5, False), ((), 1.5, False)]
)
def test_presses_are_sought_on_only_while_the_new_ones_hold_half_of_the_misfit(
    slipped, rough, holds
):
    press = np.repeat(np.arange(20), 10)
    residual = rough * np.tile([1.0, -1.0], 100)
    residual[np.isin(press, slipped)] += 3.0
    residual[press < 3] += 20.0  # found before, whatever they hold
    found, again = np.arange(3), np.array([0, 1, 2, *(slipped or (9,))])
    assert hold_misfit(press, residual, found, again, SELECTION.elsewhere) is holds


@pytest.mark.parametrize(
    ("theirs", "sought", "goes_on"),
    [(True, True, True), (False, True, False), (False, False, True)],
)
def test_beside_effects_presses_are_left_out_only_where_they_hold_the_misfit(
    theirs, sought, goes_on, monkeypatch
):
    press, residual, tried = np.repeat(np.arange(20), 10), np.tile([1.2, -1.2], 100), []
    residual[press == 7] *= 10.0 if theirs else 2.0
    fit: Any = SimpleNamespace(
        at=SimpleNamespace(residual=residual),
        model=SimpleNamespace(readings=SimpleNamespace(press=press)),
    )
    start = SimpleNamespace(
        fit=SimpleNamespace(field=None), model=SimpleNamespace(press_error=0.0),
        scan=SimpleNamespace(press_ids=np.arange(20)), joint=None if sought else fit,
    )  # fmt: skip
    others: Any = SimpleNamespace(start=start, settings=SELECTION)
    monkeypatch.setattr(presses_apart, "whitened_fit", lambda *_: None)
    monkeypatch.setattr(
        presses_apart, "compare_residual", lambda *_: SimpleNamespace(bad_presses=(7,))
    )
    monkeypatch.setattr(presses_apart, "presses_apart", lambda *_: np.array([3]))
    monkeypatch.setattr(presses_apart, "_suspected", lambda *_: [np.array([7])])
    monkeypatch.setattr(presses_apart, "_settled", lambda others, found, one: tried.append(one))
    assert apart(others, fit, (True, False)) is None
    assert tried == ([True, False] if goes_on else [])


def test_mechanics_that_forgot_other_maps_answer_as_before():
    mesh = [block_mesh((0.06, 0.06, 0.03), n) for n in ((4, 4, 2), (6, 6, 3))]
    places = np.array([[0.02, 0.02, 0.03], [0.03, 0.04, 0.03]])
    at = Contacts(places, np.array([0.0, 0.0, -1.0]), np.full(2, 0.004))
    coarse, fine = (PalpationModel(one, 0.45, at) for one in mesh)
    mechanics = BodyMechanics.of(coarse, RefinedModel(coarse, fine))
    stiffness = GaussianMap(6e3, (Inclusion(1e4, 0.03, 0.03, 0.02, 0.008),))
    state = mechanics.state().changed(poisson_ratio=0.4, shift_m=(1e-3, 0.0))
    before = mechanics.corrected(stiffness, state).evaluate(stiffness, state).compliance
    mechanics.forget()
    kept = ("_solutions", "_ratios", "_others", "_shifted", "_bases")
    assert not any(getattr(mechanics, name) for name in kept)
    assert not mechanics._corrections._fine
    after = mechanics.corrected(stiffness, state).evaluate(stiffness, state).compliance
    assert after == pytest.approx(before, rel=1e-9)
