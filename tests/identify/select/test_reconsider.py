"""Earlier additions are compared with their candidates again, beside what was added since."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.contact_offset import ContactOffset
from identify.fit.joint_fit import fit_jointly
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.forward_selection import forward_selection
from identify.select.reconsider import followed_by_their_own
from identify.select.settings import SELECTION
from identify.select.step import step_of
from tests.identify.select.loop_problem import TRUE, mechanics, model, scan, timing

OFFSET_M = 1e-4
SOFTENING, PRESSES = 0.06, 6.0


@cache
def explained():
    """First touch declared late on a body that softens from press to press, row by row.

    Presses further along y are later ones: at first the two look like a tilted surface.
    """
    press, _, _, force = timing(3)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    softer = 1 + SOFTENING * (1 - np.exp(-press / PRESSES))
    table = scan(compliance[press] * force * softer - OFFSET_M, force, 3)
    names = ("contact_offset", "surface_tilt", "preconditioning", "force_bias")
    steps = []
    found = forward_selection(
        model(table), TRUE, table, [CATALOGUE[name] for name in names], on_step=steps.append
    )
    return found, [step.fit.effect_names for step in steps]


@pytest.mark.slow
def test_what_was_taken_for_another_effect_while_one_was_missing_is_put_right():
    found, steps = explained()
    assert steps[1] == ("surface_tilt",)
    assert found.verdict == "explained"
    assert set(found.added) == {"contact_offset", "preconditioning"}
    assert found.dropped == ("surface_tilt",)
    values = found.final.fit.values
    assert values["contact_offset.offset_m"] == pytest.approx(-OFFSET_M, rel=0.2)
    assert values["preconditioning.p"] == pytest.approx(SOFTENING, rel=0.4)


@pytest.mark.slow
def test_the_ladder_leads_to_the_last_model_step_by_step():
    found, steps = explained()
    ladder = [step.fit.effect_names for step in found.ladder]
    assert ladder == [(), ("contact_offset",), ("contact_offset", "preconditioning")]
    assert steps[-2:] == ladder[-2:]
    chi2 = [step.fit.chi2 for step in found.ladder]
    assert chi2 == sorted(chi2, reverse=True)


@pytest.mark.slow
def test_rivals_are_judged_beside_all_that_is_in_the_last_model():
    found, _ = explained()
    for addition in found.accepted:
        others = set(found.added) - {addition.name}
        for candidate in addition.candidates:
            assert set(candidate.fit.effect_names) == {candidate.name, *others}
    offset = next(a for a in found.accepted if a.name == "contact_offset")
    tilt = next(candidate for candidate in offset.candidates if candidate.name == "surface_tilt")
    own = next(candidate for candidate in offset.candidates if candidate.name == "contact_offset")
    assert (
        tilt.chi2 <= own.chi2 + 0.1
    )  # it contains the offset, and its slopes bring next to nothing
    assert tilt.chi2 > own.chi2 - SELECTION.margin
    before = {candidate.name: candidate.chi2 for candidate in offset.first_candidates}
    assert before["surface_tilt"] < before["contact_offset"] - SELECTION.margin


DRIFT_N_PER_S, LATE_M = 2e-4, 3e-5
ALONG = ("force_drift", "displacement_drift", "contact_offset", "surface_tilt")


@cache
def drifting(late_m=LATE_M):
    """Return a scan with a drift of the force and a late touch."""
    press, time, _, force = timing(6)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    read = force + DRIFT_N_PER_S * (time - time.min())
    return scan(compliance[press] * force - late_m, read, 6)


@cache
def behind_a_drift():
    """Steps of that scan with the drift alone, and with one of the displacement in its place."""
    table = drifting()
    alone = fit_jointly(model(table), TRUE)
    effects = {name: CATALOGUE[name] for name in ALONG}
    drifts = [with_one(alone, name) for name in ALONG[:2]]
    steps = [step_of(fit, table, list(effects.values()), 0, lambda text: None) for fit in drifts]
    return effects, steps


def with_one(fit, name):
    effect = CATALOGUE[name]
    start = {p.name: 0.1 * p.typical for p in effect.parameters}
    return fit_jointly(fit.model.with_effect(effect, start, fit.at.state), fit.map, rounds=0)


@cache
def pair(right=False):
    """Return the fit of the wrong pair of effects, or of the right one."""
    steps = behind_a_drift()[1]
    return with_one(steps[not right].fit, "contact_offset" if right else "surface_tilt")


def followed(fell_behind=True, settings=SELECTION, equal=None, fit=None):
    """Follow an equal, else the drift of the force, of the drift that was accepted."""
    effects, (right, wrong) = behind_a_drift()
    equal, fit, said = equal or right.fit, fit or pair(), []
    name, last = "displacement_drift", "surface_tilt"
    one = Candidate(name, 0.0, 0.0, wrong.fit)
    two = Candidate(equal.effect_names[0], 0.0, 3.0, equal)
    before = AcceptedEffect(name, (one, two), settings=settings)
    after = replace(before, candidates=(one,) if fell_behind else before.candidates)
    second = AcceptedEffect(last, (Candidate(last, 0.0, fit.bic, pair()),), settings=settings)
    found = followed_by_their_own(
        wrong, fit, [after, second], [before], effects, said.append, settings
    )
    return *found, said


@pytest.mark.slow
def test_an_equal_that_fell_behind_takes_over_with_an_effect_of_its_own():
    fit, accepted, exchanged, _ = followed()
    assert exchanged == {"displacement_drift": "force_drift"}
    assert [a.name for a in accepted] == ["force_drift", "contact_offset"]
    assert fit.effect_names == ("force_drift", "contact_offset")
    assert fit.chi2_per_dof < 1.1
    rate = "force_drift.rate_n_per_s"
    assert abs(fit.values[rate] - DRIFT_N_PER_S) < 2.5 * fit.std[rate]
    assert fit.std[rate] < 0.1 * DRIFT_N_PER_S


@pytest.mark.parametrize(("behind", "joins"), [(-5.0, True), (5.0, True), (15.0, False)])
def test_with_its_own_an_equal_joins_the_group_within_the_margin(behind, joins):
    own: Any = SimpleNamespace(bic=pair(right=True).bic - behind)
    fit, accepted, exchanged, _ = followed(fit=own)
    assert not exchanged
    assert fit is own
    assert [a.name for a in accepted] == ["displacement_drift", "surface_tilt"]
    assert ("force_drift" in {c.name for c in accepted[0].candidates}) == joins
    assert ("contact_offset" in accepted[1].group) == joins


def test_equals_that_are_still_equals_or_forms_of_one_cause_are_not_followed():
    right = behind_a_drift()[1][0]
    form = with_one(right.fit, "displacement_jump")
    form = fit_jointly(form.model.without("force_drift"), form.map, rounds=0)
    for asked in ({"fell_behind": False}, {"equal": form}):
        fit, accepted, exchanged, said = followed(**asked)
        assert not exchanged
        assert fit is pair()
        assert len(accepted[1].candidates) == 1
        assert not said


@pytest.mark.slow
def test_the_selection_follows_equals_beside_its_last_effect(monkeypatch):
    effects, table, asked = behind_a_drift()[0], drifting(1e-4), []

    def followed(now, fit, accepted, before, effects, say, settings):
        asked.append((now.fit.effect_names, [a.name for a in accepted], [a.name for a in before]))
        return fit, accepted, {}

    monkeypatch.setattr("identify.select.forward_selection.followed_by_their_own", followed)
    found = forward_selection(model(table), TRUE, table, list(effects.values()))
    assert set(found.added) == {"force_drift", "contact_offset"}
    assert asked[0][0] == ()
    for now, accepted, before in asked:  # of the first step one that is exchanged at the next
        assert accepted[:-1] == before == list(now)
        assert accepted[-1] in ALONG


class LittleOffset(ContactOffset):
    """An offset of which less is possible than the scan asks for."""

    parameters = (replace(ContactOffset.parameters[0], lower=-9.5e-5, upper=9.5e-5),)


def test_an_effect_at_the_bound_of_what_is_possible_is_not_found():
    press, _, _, force = timing(4)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    table = scan(compliance[press] * force - OFFSET_M, force, 4)
    found = forward_selection(model(table), TRUE, table, [LittleOffset()])
    assert found.final.fit.values["contact_offset.offset_m"] == pytest.approx(-9.5e-5)
    assert found.final.comparison.is_noise
    assert found.at_bound == ("contact_offset",)
    assert found.verdict == "ambiguous"
    assert found.added == ()
    free = forward_selection(model(table), TRUE, table, [ContactOffset()])
    assert (free.verdict, free.added, free.at_bound) == ("explained", ("contact_offset",), ())
