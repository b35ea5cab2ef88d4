"""Planned scans are predicted as scans that were made are."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, block_mesh
from fem.near_field import enrichment
from identify.body.mechanics import BodyMechanics
from identify.catalogue.catalogue import CATALOGUE
from identify.design.detection_limits import detection_limits
from identify.design.predicted_limits import designs_on_body, improvements, planned
from identify.design.scan_variants import mixed, presses_of, readings_of, variations
from identify.design.settings import PLAN
from identify.effects.readings import Readings
from identify.fit.cross_validation import folds
from identify.fit.joint_fit import fit_jointly
from tests.identify.select.loop_problem import NU, SIZE, TRUE, model, scan, timing, true_compliance


@pytest.fixture(scope="module")
def fit():
    press, _, _, force = timing(0)
    table = scan(true_compliance()[press] * force, force, 0)
    return fit_jointly(model(table), TRUE)


def design(fit, name):
    designs = variations(presses_of(fit.model.readings), True)
    return next(d for d in designs if d.name == name)


@pytest.mark.slow
def test_the_same_scan_once_more_has_the_limits_of_the_scan_that_was_made(fit):
    now = {limit.name: limit.smallest_share for limit in detection_limits(fit, CATALOGUE)}
    (same,) = improvements(fit, CATALOGUE, [design(fit, "same")])
    again = {limit.name: limit.smallest_share for limit in same.limits}
    told = [name for name, share in now.items() if share is not None]
    assert len(told) > 15
    for name in told:
        # The pauses are others, and readings are where forces are set, not where noise puts them
        assert again[name] == pytest.approx(now[name], rel=0.25), name
    ratios = np.array([again[name] / now[name] for name in told])
    assert np.median(ratios) == pytest.approx(1, abs=0.03)


@pytest.mark.slow
def test_how_effects_bend_in_the_present_scan_serves_one_with_its_tips(fit):
    body = [effect for effect in CATALOGUE if effect.link == "body"]
    shuffled = [design(fit, "shuffled")]
    (own,) = improvements(fit, body, shuffled)
    (quick,) = improvements(fit, body, shuffled, limits=detection_limits(fit, body))
    told = [
        (one.smallest_share, other.smallest_share, other.bend)
        for one, other in zip(own.limits, quick.limits, strict=True)
        if one.smallest_share and other.smallest_share
    ]
    assert len(told) > 5
    found, taken, bend = np.array(told).T
    assert_allclose(taken, found, rtol=0.3)
    assert np.abs(np.log(bend)).max() > 0.3  # the pattern at the null alone would not do


def test_the_clock_and_the_count_of_a_further_scan_go_on(fit):
    present = fit.model.readings
    presses = presses_of(present)
    further = readings_of(presses, True, present)
    assert further.elapsed_s[0] > present.elapsed_s[-1] + PLAN.between_scans_s
    assert further.order.tolist() == list(range(25, 50))
    alone = readings_of(presses, True)
    assert alone.elapsed_s[0] == 0


def test_presses_are_found_among_others_by_place_direction_and_tip(fit):
    presses = presses_of(fit.model.readings)
    order = np.array([4, 0, 4, 24])
    some = replace(presses.taken(order), force_n=np.ones(4))
    found = some.places_among(presses)
    assert found is not None
    assert found.tolist() == order.tolist()
    assert replace(some, radius_m=1.1 * some.radius_m).places_among(presses) is None
    mechanics = planned(fit, replace(design(fit, "same"), presses=some))[0].mechanics
    assert_allclose(mechanics.contacts.points_m, some.point_m)


@pytest.mark.parametrize("most", [None, 0.35, 10.0])
def test_no_planned_press_is_harder_than_is_borne(fit, most):
    """No harder than any press of the scan, and than its own place was pressed, unless asked."""
    presses = presses_of(fit.model.readings)
    presses = replace(presses, force_n=np.linspace(0.1, 0.3, len(presses)))
    known = {
        tuple(point): force for point, force in zip(presses.point_m, presses.force_n, strict=True)
    }
    for design in (*variations(presses, True, most), mixed(presses, most)):
        planned = design.presses
        assert planned.force_n.max() <= (most or 0.3) + 1e-12, design.name
        if most is None:
            own = np.array([known[tuple(point)] for point in planned.point_m])
            share = planned.force_n / own / (planned.radius_m / presses.radius_m[0])
            assert share.max() <= 1 + 1e-12, design.name
    (two,) = (d for d in variations(presses, True, most) if d.name == "two_forces")
    soft, hard = (two.presses.force_n / presses.force_n)[:2]
    assert hard / soft == pytest.approx(3)
    words = {None: "a third as hard", 0.35: "0.39 times as hard and 1.2 times as hard"}
    assert two.change.endswith(words.get(most, "half as hard and 1.5 times as hard"))


def test_a_rest_parts_the_count_of_presses_from_time(fit):
    presses = presses_of(fit.model.readings)
    (rested,) = (d for d in variations(presses, True) if d.name == "rested")
    more = rested.presses.pause_s - presses.pause_s
    assert np.flatnonzero(more).tolist() == [len(presses) // 8]
    assert more.max() == pytest.approx(presses.duration_s / 8)
    assert (
        rested.change
        == f"with a rest of {more.max() + presses.pause_s[3]:.0f} s after the first 3 presses"
    )
    assert [d.name for d in variations(presses, timed=False)] == ["two_radii", "same", "two_forces"]
    at_once = mixed(presses).presses
    assert np.flatnonzero(at_once.pause_s > 2).tolist() == [len(presses) // 8]


def test_places_too_near_an_edge_for_a_larger_tip_are_left_out_of_its_scan(fit):
    # Tips of 4 mm, 5 mm from the sides; with 8 mm only the inner nine places are left to them
    presses = presses_of(fit.model.readings)
    near = replace(presses, point_m=presses.point_m + np.array([-0.004, 0, 0]))
    two = replace(design(fit, "two_radii"), presses=replace(near, radius_m=np.full(25, 0.008)))
    same = replace(design(fit, "same"), presses=presses)
    (fitting, unchanged) = designs_on_body(fit, [two, same])
    assert unchanged is same
    assert len(fitting.presses) == 20
    assert fitting.presses.point_m[:, 0].min() > 0.008
    assert fitting.change.endswith("(without the 5 places too near an edge for the tip)")
    planned(fit, fitting)  # meshes and solves
    beside = replace(two, presses=replace(near, radius_m=np.full(25, 0.05)))
    assert designs_on_body(fit, [beside]) == ()


@pytest.mark.slow
def test_near_fields_of_a_scan_with_the_same_tips_serve_the_next(fit, monkeypatch):
    two, there = design(fit, "two_radii"), (1e-3, 0.0)
    order = np.random.default_rng(0).permutation(len(two.presses))
    first = planned(fit, two)[0].mechanics
    known = first.shifted.coarse_at(there).evaluate(5e3).compliance
    computed, integrals = [], enrichment._integrals

    def counted(stiffness, place, cells, *rest):
        computed.append(len(cells))
        return integrals(stiffness, place, cells, *rest)

    monkeypatch.setattr(enrichment, "_integrals", counted)
    shuffled = replace(two, presses=two.presses.taken(order))
    again = planned(fit, shuffled, like=first)[0].mechanics
    moved = again.shifted.coarse_at(there).evaluate(5e3).compliance
    assert computed
    assert not any(computed)
    assert_allclose(moved, known[order], rtol=1e-9)


@pytest.mark.slow
def test_what_the_meshes_are_off_by_is_off_under_another_tip_as_well(fit):
    own = fit.model.mechanics
    model_at, at = planned(fit, design(fit, "two_radii"))
    error = model_at.mechanics.correction.model_error
    now = fit.at.body.compliance
    assert_allclose(error * at.body.compliance, own.correction.model_error * now, rtol=1e-9)
    # Their own estimate for the other tip, from meshes made for it, is of that size
    every = own.coarse.contacts
    radius = design(fit, "two_radii").presses.radius_m
    contacts = Contacts(every.points_m, every.directions, radius)
    pair = [PalpationModel(block_mesh(SIZE, n), NU, contacts) for n in ((5, 5, 3), (8, 8, 5))]
    from fem import RefinedModel

    made = BodyMechanics(
        pair[0], RefinedModel(*pair), lambda nu: PalpationModel(pair[0].mesh, nu, contacts)
    ).corrected(fit.map, fit.at.state)
    ratio = np.linalg.norm(error) / np.linalg.norm(made.correction.model_error)
    assert 0.5 < ratio < 2


def test_effects_act_in_the_order_of_the_catalogue_whenever_they_were_added(fit):
    named = {effect.name: effect for effect in CATALOGUE}
    values = {
        "hysteresis": {"loss": 0.2},
        "viscoelasticity": {"g": 0.3, "tau_s": 1.0},
    }
    chains = []
    for names in (tuple(values), tuple(reversed(values))):
        own = fit.model
        for name in names:
            start = {**named[name].null, **{p.name: p.typical for p in named[name].parameters}}
            own = own.with_effect(named[name], start, fit.at.state)
        at = own.linearise(own.start(fit.map))
        chains.append(at.predicted_m)
    assert_allclose(chains[0], chains[1], rtol=0, atol=1e-15)
    assert np.abs(chains[0] - fit.at.predicted_m).max() > 1e-5


def test_presses_that_are_left_out_still_count_in_the_order():
    press, _, _, force = timing(0)
    table = scan(true_compliance()[press] * force, force, 0)
    few = table.rows(np.isin(table.press, [0, 4, 8, 20]))
    assert Readings.of(few).order.tolist() == [0, 4, 8, 20]
    assert Readings.of(few).presses_made == 21
    later = few.replace(press=few.press + 7)
    assert Readings.of(later).order.tolist() == [0, 4, 8, 20]
    stamps = few.replace(press=1_700_000_000 + 90 * few.press)
    assert Readings.of(stamps).order.tolist() == [0, 1, 2, 3]


def test_presses_left_out_together_are_no_lines_of_a_grid():
    fold = folds(81)
    assert np.bincount(fold).tolist() == [9] * 9
    for number in range(9):
        row, column = np.divmod(np.flatnonzero(fold == number), 9)
        assert min(len(np.unique(row)), len(np.unique(column))) > 3
    assert folds(5).tolist() != sorted(folds(5).tolist())
    assert sorted(folds(5).tolist()) == [0, 1, 2, 3, 4]
