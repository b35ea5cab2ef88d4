"""Proposed presses: as few as are needed, and what they promise is what they bring when made."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from fem import Contacts, PalpationModel, RefinedModel, block_mesh
from identify.body.mechanics import BodyMechanics
from identify.catalogue.catalogue import CATALOGUE
from identify.design import assessment
from identify.design.assessment import _settings
from identify.design.next_presses import _Planned, _Present, next_presses
from identify.design.scan_variants import (
    Design,
    mixed,
    presses_of,
    readings_of,
    variations,
)
from identify.design.settings import PLAN
from identify.effects.readings import Readings
from identify.fit.joint_fit import fit_jointly
from identify.fit.settings import CONTACT_LAW
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from models.scan import Scan
from tests.identify.select.loop_problem import (
    NU,
    SIZE,
    TRUE,
    contacts,
    model,
    scan,
    timing,
    true_compliance,
)

OFFSET_M = 8e-5
RIVALS = {  # with where their fits begin
    "contact_offset": {"offset_m": 2e-5},
    "force_bias": {"bias_n": -2e-3},
    "spherical_tip": {"share": 0.05},
}
SEED = 6


@pytest.fixture(scope="module")
def table() -> Scan:
    """A scan whose travels are all too large by the same.

    Without noise, as what is promised is the difference that noise comes on top of.
    """
    press, _, _, force = timing(SEED)
    travel = true_compliance()[press] * force + OFFSET_M
    return scan(travel, force, SEED).replace(displacement_m=travel, force_n=force)


def fits(of_scan: Scan, body: BodyMechanics | None = None):
    plain = model(of_scan, body)
    state = fit_jointly(plain, TRUE).at.state
    return [
        (name, fit_jointly(plain.with_effect(CATALOGUE[name], start, state), TRUE))
        for name, start in RIVALS.items()
    ]


@pytest.fixture(scope="module")
def candidates(table):
    return fits(table)


@pytest.fixture(scope="module")
def proposals(candidates):
    readings = candidates[0][1].model.readings
    return next_presses(candidates[:2], list(variations(presses_of(readings), True)))


@pytest.mark.slow
def test_what_tells_rivals_apart_comes_first_and_the_quickest_of_it(proposals):
    told = [len(p.separated) for p in proposals]
    assert told == sorted(told, reverse=True)
    durations = [p.design.presses.duration_s for p in proposals if p.separated]
    assert durations == sorted(durations)
    assert all(p.discrimination >= PLAN.needed for p in proposals if p.separated)
    assert all(p.discrimination < PLAN.needed for p in proposals if not p.separated)
    others = [p.discrimination for p in proposals if not p.separated]
    assert others == sorted(others, reverse=True)


@pytest.mark.slow
def test_only_as_many_presses_are_asked_for_as_are_needed(proposals, candidates):
    best = next(p for p in proposals if p.design.name == "two_radii")
    whole = next(d for d in variations(presses_of(candidates[0][1].model.readings), True)
                 if d.name == "two_radii").presses  # fmt: skip
    count = len(best.design.presses)
    assert PLAN.fewest <= count < len(whole)
    assert PLAN.aim <= best.discrimination < 2 * PLAN.aim
    asked = [tuple(point) for point in best.design.presses.point_m]
    order = [tuple(point) for point in whole.point_m]
    chosen = list(map(order.index, asked))
    assert chosen == sorted(chosen)
    # As many of the others, filled up with the least telling of the chosen ones, would not do
    planned = _Planned(_Present.of(candidates[:2]), replace(best.design, presses=whole))
    (pair,) = best.separated
    least = planned.most_telling_first(pair)[::-1][:count]
    assert planned.worth(least)[pair] < 0.8 * PLAN.aim


def test_a_mixed_scan_has_the_same_places_a_rest_and_every_tip_at_every_force(candidates):
    presses = presses_of(candidates[0][1].model.readings)
    other = mixed(presses, most_force_n=10.0).presses
    places = np.lexsort(presses.point_m.T), np.lexsort(other.point_m.T)
    assert np.array_equal(presses.point_m[places[0]], other.point_m[places[1]])
    assert not np.array_equal(presses.point_m, other.point_m)
    assert other.duration_s == pytest.approx(9 / 8 * presses.duration_s)
    small = other.radius_m == other.radius_m.min()
    by_radius = other.force_n / other.radius_m / (presses.force_n[0] / presses.radius_m[0])
    for tip in (small, ~small):
        values, counts = np.unique(np.round(by_radius[tip], 9), return_counts=True)
        assert values.tolist() == [0.5, 1.5]
        assert counts.min() >= 6


@pytest.mark.slow
def test_presses_that_are_made_bring_what_was_promised(candidates):
    """All presses are made, without noise, and both candidates are refitted to all of them.

    A refit may follow the bend of the map's valley, along which the promise goes straight.
    """
    designs = variations(presses_of(candidates[0][1].model.readings), True)
    presses = next(d for d in designs if d.name == "two_radii").presses
    now = contacts()
    every = Contacts(
        np.vstack([now.points_m, presses.point_m]),
        np.vstack([now.directions, presses.direction]),
        np.append(now.radius_m, presses.radius_m),
    )
    coarse, fine = (PalpationModel(block_mesh(SIZE, n), NU, every) for n in ((5, 5, 3), (8, 8, 5)))
    body = BodyMechanics(
        coarse, RefinedModel(coarse, fine), lambda nu: PalpationModel(coarse.mesh, nu, every)
    )
    body = body.corrected(TRUE, body.state())
    felt = body.evaluate(TRUE, body.state()).compliance

    press, time_s, phase, force = timing(SEED)
    planned = readings_of(presses, True, Readings.of(scan(force, force, SEED)))
    assert planned.time_s is not None
    number = np.concatenate([press, planned.press + 25])
    both = Scan(
        press=number,
        time_s=np.concatenate([time_s, planned.time_s]),
        phase=np.concatenate([phase, planned.phase]),
        point_m=every.points_m[number],
        direction=every.directions[number],
        force_n=np.concatenate([force, planned.force_n]),
        displacement_m=felt[number] * np.concatenate([force, planned.force_n]) + OFFSET_M,
        probe_radius_m=every.radius_m[number],
    )
    first = fits(both.rows(number < 25))[:2]
    design = Design("two_radii", "", presses)
    promised = _Planned(_Present.of(first), design).worth_in_order(np.arange(25))
    (right, wrong), (right_now, wrong_now) = ([f.chi2 for _, f in some] for some in (
        first, fits(both, body)[:2]))  # fmt: skip
    gained = (wrong_now - right_now) - (wrong - right)
    assert 0.5 < gained / promised["contact_offset", "force_bias"] < 1.05


def test_pairs_that_would_stay_alike_are_said(candidates):
    readings = candidates[0][1].model.readings
    designs = [d for d in variations(presses_of(readings), True) if d.name == "same"]
    (proposal,) = next_presses(candidates, designs)
    assert {*proposal.separated, *proposal.alike} == {
        ("contact_offset", "force_bias"),
        ("contact_offset", "spherical_tip"),
        ("force_bias", "spherical_tip"),
    }
    assert proposal.pair in (proposal.separated or proposal.alike)


def test_a_further_scan_goes_on_in_time_and_order(candidates):
    present = candidates[0][1].model.readings
    further = readings_of(presses_of(present), True, present)
    assert further.time_s is not None
    assert present.time_s is not None
    assert further.time_s[0] > present.time_s[-1] + PLAN.between_scans_s
    assert_array_equal(further.order, present.order + 25)


@pytest.fixture(scope="module")
def softening():
    """A body that softens over the first presses, and the two laws that say so, fitted."""
    press, _, _, force = timing(SEED)
    soft = 1 + 0.05 * (1 - np.exp(-np.arange(25) / 5))
    travel = (true_compliance() * soft)[press] * force
    table = scan(travel, force, SEED)
    state = fit_jointly(model(table), TRUE).at.state
    courses = {
        "preconditioning": {"p": 0.04, "k0": 6.0},
        "sensitivity_wander": dict.fromkeys((f"gain_{k}" for k in range(20, 120, 20)), -0.03),
    }
    return [
        (name, fit_jointly(model(table).with_effect(CATALOGUE[name], at, state), TRUE))
        for name, at in courses.items()
    ]


def test_a_course_in_time_may_go_on_in_any_way_after_the_scan(softening):
    """Later presses tell it from no settled law, as a refit to both scans is free there."""
    presses = presses_of(softening[0][1].model.readings)
    (same,) = (d for d in variations(presses, True) if d.name == "same")
    told = _Planned(_Present.of(softening), same).worth_in_order(np.arange(25))
    assert told["preconditioning", "sensitivity_wander"] < 0.5 * PLAN.needed


def test_laws_of_the_presses_are_separated_beyond_what_they_are_right_to():
    """They are equal within 1 % of the excess, of both scans together 2 % of one's."""
    alone = SimpleNamespace(chi2=4000.0, dof=1000)
    explained: Any = SimpleNamespace(ladder=[SimpleNamespace(fit=alone)])
    law, score = (AcceptedEffect("play", (), shown_by_presses=shown) for shown in (True, False))
    assert _settings(explained, score) is PLAN
    wider = _settings(explained, law)
    assert wider.needed - PLAN.needed == pytest.approx(2 * CONTACT_LAW.equal * 3000)
    assert wider.aim - PLAN.aim == wider.needed - PLAN.needed


@pytest.mark.parametrize("shown", [True, False])
def test_laws_of_the_presses_are_planned_for_their_own_judge(monkeypatch, shown, candidates):
    """Places with a compliance of their own, and their chi-square."""
    (one, fit), (other, _) = candidates[:2]
    pair = tuple(Candidate(name, chi2, 9.0, fit) for name, chi2 in ((one, 7.0), (other, 8.0)))
    accepted = AcceptedEffect(one, pair, shown_by_presses=shown)
    explained: Any = SimpleNamespace(
        ambiguous=[accepted.group], accepted=[accepted], ladder=[SimpleNamespace(fit=fit)],
        final=SimpleNamespace(fit=fit),
    )  # fmt: skip
    given: list[Any] = []
    monkeypatch.setattr(assessment, "designs_on_body", lambda *_: ())
    monkeypatch.setattr(assessment, "next_presses", lambda *args: given.append(args))
    assessment._next_presses(explained, list(CATALOGUE), lambda text: None, None)
    ((planned, *_, by_law),) = given
    assert [name for name, _ in planned] == [one, other]
    assert by_law == ({one: 7.0, other: 8.0} if shown else None)
