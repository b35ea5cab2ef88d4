"""Earlier additions are compared with their candidates again, beside what was added since."""

from dataclasses import replace
from functools import cache

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
def behind_a_drift():
    """A drift of the force and a late touch; the drift taken for one of the displacement.

    The step with that alone, and the fit with the tilt that the rest was taken for.
    """
    press, time, _, force = timing(6)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    read = force + DRIFT_N_PER_S * (time - time.min())
    table = scan(compliance[press] * force - LATE_M, read, 6)
    alone = fit_jointly(model(table), TRUE)
    effects = {name: CATALOGUE[name] for name in ALONG}
    drifts = [with_one(alone, name) for name in ALONG[:2]]
    step = step_of(drifts[1], table, list(effects.values()), 0, lambda text: None)
    return effects, drifts, step, with_one(drifts[1], "surface_tilt")


def with_one(fit, name):
    effect = CATALOGUE[name]
    start = {p.name: 0.1 * p.typical for p in effect.parameters}
    return fit_jointly(fit.model.with_effect(effect, start, fit.at.state), fit.map, rounds=0)


def followed(fell_behind=True, settings=SELECTION):
    """Return what stands for the drift of the displacement and the tilt, and the fit's effects."""
    effects, (right, wrong), step, fit = behind_a_drift()
    own = Candidate("displacement_drift", wrong.chi2, 0.0, wrong)
    equal = Candidate("force_drift", right.chi2, 3.0, right)
    before = AcceptedEffect("displacement_drift", (own, equal), settings=settings)
    after = replace(before, candidates=(own,) if fell_behind else before.candidates)
    last = AcceptedEffect(
        "surface_tilt", (Candidate("surface_tilt", fit.chi2, fit.bic, fit),), settings=settings
    )
    return followed_by_their_own(
        step, fit, [after, last], [before], effects, lambda text: None, settings
    )


def test_an_equal_that_fell_behind_takes_over_with_an_effect_of_its_own():
    fit, accepted, exchanged = followed()
    assert exchanged == {"displacement_drift": "force_drift"}
    assert [a.name for a in accepted] == ["force_drift", "contact_offset"]
    assert fit.effect_names == ("force_drift", "contact_offset")
    assert fit.chi2_per_dof < 1.1
    rate = "force_drift.rate_n_per_s"
    assert abs(fit.values[rate] - DRIFT_N_PER_S) < 2.5 * fit.std[rate]
    assert fit.std[rate] < 0.1 * DRIFT_N_PER_S


def test_with_an_effect_of_its_own_an_equal_that_does_as_well_joins_the_group():
    wide = replace(SELECTION, margin=1e6)
    fit, accepted, exchanged = followed(settings=wide)
    assert not exchanged
    assert fit is behind_a_drift()[3]
    assert [a.name for a in accepted] == ["displacement_drift", "surface_tilt"]
    assert set(accepted[0].group) == {"displacement_drift", "force_drift"}
    assert {"surface_tilt", "contact_offset"} <= {c.name for c in accepted[1].candidates}


def test_equals_that_are_still_equals_are_not_followed():
    fit, accepted, exchanged = followed(fell_behind=False)
    assert not exchanged
    assert fit is behind_a_drift()[3]
    assert len(accepted[1].candidates) == 1


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
