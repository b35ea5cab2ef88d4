"""What is not sure is not said: effects that rest on single presses, at a bound, or doubted."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.viscoelasticity import Viscoelasticity
from identify.design.assessment import assess
from identify.design.undetected_bias import UndetectedBias
from identify.effects.base import Advice
from identify.fit.joint_fit import fit_jointly
from identify.select import candidates as candidates
from identify.select import explanation as explanation
from identify.select import forward_selection as explain
from identify.select import outlying_presses as suspects
from identify.select.accepted_effect import AcceptedEffect, undetermined
from identify.select.explanation import OTHER_CAUSE, SUSPECT_PRESSES, Explanation
from identify.select.outlying_presses import WithoutSuspects, suspects_left, weighed
from identify.select.reconsider import with_exchanged
from identify.select.settings import SELECTION
from identify.select.step import foretells_worse, whitened_fit
from identify.select.verdicts import effect_verdict
from models.errors import InputError
from palpmap.result.doubts import doubts, unseen_effects, without_suspects
from palpmap.result.explain_record import explain_record
from palpmap.result.explain_words import (
    _name_notes,
    _way_out,
    headline,
    step_notes,
    verdict_detail,
)
from palpmap.result.records import ExplainRecord, ParameterRecord, WithoutSuspectsRecord
from tests.palpmap.report.test_explain_report import grouped


@pytest.mark.slow
def test_what_is_told_from_its_rivals_only_by_presses_that_stand_out_rests_on_them(explained_case):
    explained = explained_case.explained
    (name,) = explained.added
    tied = grouped(explained, "hysteresis")
    found = weighed(explained, WithoutSuspects.of((3, 8), tied))
    assert found.verdict == "ambiguous"
    assert found.ambiguous == ((name, SUSPECT_PRESSES),)
    record = effect_verdict(CATALOGUE[name], found)
    assert record.verdict == "indistinguishable"
    assert record.confused_with == (SUSPECT_PRESSES,)
    (note,) = _name_notes(found, name)
    assert "only with outlying presses" in note


def bad(step, *presses):
    marked = tuple(replace(p, bad=p.press in presses) for p in step.comparison.presses)
    return replace(step, comparison=replace(step.comparison, presses=marked))


@pytest.mark.slow
def test_too_few_presses_without_the_suspects_do_not_lose_the_answer(explained_case, monkeypatch):
    explained = explained_case.explained
    one, two = (p.press for p in explained.ladder[0].comparison.presses[2:4])
    ladder = (bad(explained.ladder[0], one, two), *explained.ladder[1:-1],
              bad(explained.ladder[-1], two))  # fmt: skip
    suspected = replace(explained, ladder=ladder)

    def refused(*_, **__):
        raise InputError("found 10 different presses")

    monkeypatch.setattr(suspects, "_same_answer", lambda *_: None)
    monkeypatch.setattr(suspects, "start_fit", refused)
    found = suspects.without_suspects(explained_case.problem, 0, suspected)
    assert found is None
    assert weighed(suspected, found) is suspected
    # Nobody has looked: the press that still stands out is said to do so
    assert suspects_left(suspected, None) == (two,)
    problem = explained_case.problem
    assessment = assess(suspected, problem.catalogue)
    record = explain_record(suspected, problem, assessment)
    told = " ".join(doubts(record, suspected))
    assert f"Outlying presses: {two}." in told
    assert "not for the last model" not in told


@pytest.mark.slow
@pytest.mark.parametrize("theirs", [True, False])
def test_an_unexplained_scan_is_explained_again_only_without_presses_that_hold_its_misfit(
    theirs, explained_case, monkeypatch
):
    case, rough = explained_case.problem, explained_case.explained.ladder[0]
    press = rough.fit.model.readings.press
    excess = np.bincount(press, rough.fit.at.residual**2 - 1)
    order = np.argsort(excess)[::-1]
    held = np.cumsum(excess[order]) / excess.sum()
    most = order[: 1 + int(np.argmax(held > 0.6))] if theirs else order[:1]
    ids = tuple(np.asarray(case.scan.press_ids)[most].tolist())
    explained = replace(
        explained_case.explained, verdict="unexplained", ladder=(bad(rough, *ids), rough)
    )
    assert explained.added == ()
    assert not rough.comparison.is_noise
    again = []

    def started(*_, **__):
        again.append(True)
        raise InputError("far enough")

    monkeypatch.setattr(suspects, "_same_answer", lambda *_: None)
    monkeypatch.setattr(suspects, "start_fit", started)
    assert suspects.without_suspects(case, 0, explained) is None
    assert bool(again) == theirs


def test_structure_that_a_law_of_contact_may_leave_makes_its_cause_doubtful(
    explained_case, monkeypatch
):
    explained = explained_case.explained
    (name,) = explained.added
    rough, noise = explained.ladder[0], explained.final.comparison
    assert not rough.comparison.is_noise
    left = replace(explained.final, comparison=rough.comparison)
    assert explain.verdict_of(left, explained.accepted) == "unexplained"
    assert explain.verdict_of(left, explained.accepted, within=True) == "ambiguous"
    assert noise.is_noise  # then nothing is left for a law
    assert explain.verdict_of(explained.final, explained.accepted, within=True) == "explained"
    monkeypatch.setattr(Explanation, "within_laws", True)
    found = replace(explained, verdict="ambiguous", ladder=(rough, left))
    assert (found.added, found.ambiguous) == ((), ((name, OTHER_CAUSE),))
    assert effect_verdict(CATALOGUE[name], found).confused_with == (OTHER_CAUSE,)
    assert "error of contact laws" in headline(found)
    for excess, said in ((9.0, " % of the misfit is left"), (-9.0, "but its pattern is left")):
        fit = replace(left.fit, chi2=left.fit.dof + excess)
        there = replace(found, ladder=(rough, replace(left, fit=fit)))
        assert said in verdict_detail(there)


def steps(*chi2: float, noise: bool = False) -> Any:
    """A ladder of steps with one effect more each: a, b, ..., of which the last one is noise."""
    names = [tuple("abcdef"[:k]) for k in range(len(chi2))]
    return [
        SimpleNamespace(
            fit=SimpleNamespace(chi2=one, effect_names=has, field=None, dof=900),
            comparison=SimpleNamespace(is_noise=noise or len(has) == len(chi2) - 1),
        )
        for one, has in zip(chi2, names, strict=True)
    ]


@pytest.mark.parametrize(
    ("ladder", "pressed", "suspected"),
    [
        (steps(2000, 1500, 1040, 1010), "", ("a", "b", "c")),
        (steps(2000, 1500, 1040, 1010), "b", ("a", "c")),  # the single presses call for it
        (steps(2000, 1080, 1040, 1010), "", ("b", "c")),  # the first takes 93 % by itself
        (steps(2000, 1500, 1140, 1010), "", ()),  # the last takes an eighth
        (steps(2000, 1500, 940, 910), "", ()),  # and nearly all that the others left
        (steps(2000, 1500, 1040, 1010, noise=True), "", ()),  # nothing was left to be mended
        (steps(2000, 1030, 1010), "", ()),  # two causes may be of such different sizes
    ],
)
def test_effects_whose_last_one_only_mends_their_fit_may_imitate_another_cause(
    ladder, pressed, suspected
):
    names = ladder[-1].fit.effect_names
    accepted: Any = [SimpleNamespace(name=n, shown_by_presses=n == pressed) for n in names]
    assert explain.mended(ladder, accepted, SELECTION) == suspected


@pytest.mark.parametrize(("score", "more"), [(30.0, False), (20.0, True)])
def test_beside_noise_another_form_of_what_is_there_calls_for_nothing_further(score, more):
    """A wave of the surface that a bow nearly meets left a breath of 36, and as much unevenness."""
    scores = {
        "breathing": SimpleNamespace(name="breathing", family="breathing", statistic=36.0),
        "uneven_surface": SimpleNamespace(
            name="uneven_surface", family="surface_tilt", statistic=score
        ),
    }

    class Scores(dict):
        significant = frozenset(scores)

    bow: Any = AcceptedEffect("curved_surface", (effect_candidate("curved_surface"),))
    ladder: Any = [
        SimpleNamespace(fit=SimpleNamespace(chi2=2000.0)),
        SimpleNamespace(
            fit=SimpleNamespace(chi2=800.0, field=None),
            comparison=SimpleNamespace(is_noise=True),
            diagnosis=Scores(scores),
        ),
    ]
    assert explanation.is_more_missing(ladder, [bow]) == more


def effect_candidate(name: str) -> Any:
    model = SimpleNamespace(effects=(SimpleNamespace(effect=CATALOGUE[name]),))
    fit: Any = SimpleNamespace(model=model, effect_names=(name,))
    return candidates.Candidate(name, 800.0, 800.0, fit)


def test_effects_that_may_imitate_another_cause_are_not_offered_by_name(
    explained_case, monkeypatch
):
    explained = explained_case.explained
    (name,) = explained.added
    verdict = explain.verdict_of(explained.final, explained.accepted, mended=(name,))
    assert verdict == "ambiguous"
    monkeypatch.setattr(Explanation, "mended", (name,))
    found = replace(explained, verdict=verdict)
    assert (found.added, found.ambiguous) == ((), ((name, OTHER_CAUSE),))
    assert "imitate one unknown cause" in headline(found)
    assert f"Without {name}, structure is left." in verdict_detail(found)
    assert any("one unknown cause" in note for note in step_notes(found, 1))


def test_values_that_are_not_to_be_believed_are_not_offered(explained_case, monkeypatch):
    explained = explained_case.explained
    (name,) = explained.added
    assert name == "viscoelasticity"
    assert explain.verdict_of(explained.final, explained.accepted) == "explained"
    why = "it keeps step with the presses"

    class Doubted(Advice, Viscoelasticity):
        def doubt(self, values, readings):
            return why

    monkeypatch.setattr(CATALOGUE[name], "__class__", Doubted)
    assert candidates.is_implausible(explained.final.fit, name)
    # The model fits: the residual is noise, and the cause is doubtful
    assert explain.verdict_of(explained.final, explained.accepted) == "ambiguous"
    found = replace(explained, verdict="ambiguous")
    assert found.added == ()
    assert found.ambiguous == ((name, OTHER_CAUSE),)
    assert "doubtful" in headline(found)
    assert verdict_detail(found) == f"{name} or another_cause."
    assert why in " ".join(_name_notes(found, name))
    record = effect_verdict(CATALOGUE[name], found)
    assert (record.verdict, record.confused_with) == ("indistinguishable", (OTHER_CAUSE,))
    # Beside a structured residual it is no answer at all
    left = replace(found, verdict="unexplained")
    assert (left.added, left.ambiguous) == ((), ())
    assert "a help, not the answer" in verdict_detail(left)
    assert effect_verdict(CATALOGUE[name], left).verdict == "not_seen"
    # Nor is it a candidate of anything else
    tried = candidates.compare_candidates(
        explained.ladder[0], {name: CATALOGUE[name]}, lambda text: None, [name]
    )
    assert tried == ()


def test_the_same_answer_is_one_with_the_same_verdict():
    other = WithoutSuspectsRecord(
        verdict="explained", added=("breathing",), ambiguous=(), chi2_per_dof=1.0, parameters={},
        residual="",
    )  # fmt: skip
    record = ExplainRecord(
        verdict="explained", added=("breathing",), ambiguous=(), without_suspects=other
    )
    assert "is the same" in without_suspects(record)
    doubted = other.changed(verdict="ambiguous", added=("local_creep",))
    beside = record.changed(verdict="unexplained", reliable=False, without_suspects=doubted)
    assert "local_creep" not in without_suspects(beside)
    structured = record.changed(verdict="unexplained")
    assert "is breathing" in without_suspects(structured)
    left = other.changed(verdict="unexplained")
    assert "too" not in without_suspects(record.changed(without_suspects=left))
    assert "too" in without_suspects(structured.changed(without_suspects=left))


@pytest.mark.parametrize(("radii", "says"), [((5e-3, 5e-3), True), ((3e-3, 10e-3), False)])
def test_two_radii_are_advised_where_there_is_one(radii, says):
    readings = SimpleNamespace(radius_m=np.array(radii))
    model = SimpleNamespace(readings=readings)
    explained: Any = SimpleNamespace(final=SimpleNamespace(fit=SimpleNamespace(model=model)))
    assert ("two radii" in _way_out(explained)) is says


def test_effects_that_the_scan_shows_nothing_of_are_named_beside_the_shifts():
    background = ParameterRecord(
        value=5e3, std=10.0, lower95=4980.0, upper95=5020.0, unit="Pa", at_bound=False
    )
    record = ExplainRecord(
        verdict="explained", added=(), ambiguous=(),
        parameters={"background_pa": background},
        unseen_shifts={"background_pa": UndetectedBias(80.0, "tool_compliance", 0.03)},
        not_counted=("breathing", "force_drift"),
    )  # fmt: skip
    readings = SimpleNamespace(radius_m=np.array([0.003, 0.005]))
    fit = SimpleNamespace(field=None, model=SimpleNamespace(readings=readings))
    told = SimpleNamespace(final=SimpleNamespace(fit=fit))
    assert "nothing of them: breathing and force_drift." in unseen_effects(record, told)
    assert "Not counted" not in unseen_effects(record.changed(not_counted=()), told)


def test_an_earlier_model_that_had_both_gets_the_effect_that_stays_once(explained_case):
    last = explained_case.explained.final.fit
    (part,) = last.model.effects
    twin = replace(part, effect=CATALOGUE["hysteresis"], start={"loss": 0.01},
                   parameters=CATALOGUE["hysteresis"].parameters)  # fmt: skip
    model = replace(last.model, effects=(part, twin))
    both = replace(last, solution=replace(last.solution, model=model))
    now = with_exchanged(both, {"hysteresis": "viscoelasticity"}, last)
    assert now.model.effect_names == ("viscoelasticity",)


def test_the_newest_addition_is_compared_again_once_an_earlier_one_is_lost(explained_case):
    asked = []
    case = explained_case
    best = case.explained.accepted[0].candidates[0]
    first = AcceptedEffect("hysteresis", (replace(best, name="hysteresis"),))

    def started(step, say):
        return case.explained.ladder[0].fit, [first]

    def lost(fit, names, say, settings):
        return fit, list(names)

    def looked(fit, accepted, say, last_too, settings):
        asked.append(last_too)
        return fit, list(accepted), {}

    policy = explain.Policy(
        first=started,
        propose=lambda *_: (best,),
        worthwhile=lambda *_: True,
        prune=lost,
        compare=looked,
        goes_on=lambda *_: not asked,
    )
    found = explain.forward_selection(case.problem.model, case.problem.start, case.problem.scan,
                                      case.problem.catalogue, policy=policy)  # fmt: skip
    assert [a.name for a in found.accepted] == [best.name]
    assert found.dropped == ("hysteresis",)
    assert asked == [True]


def test_an_effect_that_brings_nothing_at_the_end_of_its_fit_is_not_added(explained_case):
    case, last = explained_case, explained_case.explained.final.fit
    effect = CATALOGUE["hysteresis"]
    model = last.model.with_effect(effect, effect.null, last.at.state)
    fit = fit_jointly(model, last.map)
    assert fit.bic > last.bic
    promised = candidates.Candidate("hysteresis", last.chi2 - 50, last.bic - 40, fit)
    excluded = []

    def proposed(step, effects, say, exclude, settings):
        excluded.append(list(exclude))
        return () if "hysteresis" in exclude else (promised,)

    policy = explain.Policy(propose=proposed, worthwhile=lambda *_: True, goes_on=lambda *_: True)
    found = explain.forward_selection(
        last.model, last.map, case.problem.scan, case.problem.catalogue, policy=policy, first=last
    )
    assert excluded[:2] == [[], ["hysteresis"]]
    assert (len(found.ladder), found.accepted, found.dropped) == (1, (), ())


def test_what_the_map_s_own_error_absorbs_is_compared_in_units_of_the_noise_alone(explained_case):
    """Residual and derivatives that `compare` gets are both whitened with the noise alone."""
    model = explained_case.explained.ladder[0].fit.model
    rough = fit_jointly(replace(model, press_error=0.05), explained_case.problem.start)
    whitened = whitened_fit(rough, explained_case.problem.scan)
    exact = replace(rough.model, press_error=0.0).linearise(rough.u)
    assert not np.allclose(rough.at.jacobian, whitened.absorbed, rtol=1e-2)
    np.testing.assert_allclose(whitened.absorbed, exact.jacobian, rtol=1e-9, atol=1e-9)


def with_covariance(step, covariance):
    fit = replace(step.fit, solution=replace(step.fit.solution, covariance=covariance))
    return replace(step, fit=fit)


def test_an_effect_whose_interval_is_its_whole_bound_is_no_explanation(explained_case):
    explained = explained_case.explained
    (name,) = explained.added
    assert explained.undetermined == ()
    last = explained.final
    names, (low, high) = last.fit.model.names, last.fit.model.bounds
    wide = last.fit.covariance_scaled.copy()
    (part,) = (part for part in last.fit.model.effects if part.effect.name == name)
    for amplitude in part.effect.amplitudes:
        row = names.index(f"{name}.{amplitude.name}")
        wide[row, row] = (high[row] - low[row]) ** 2
    ladder = (*explained.ladder[:-1], with_covariance(last, wide))
    assert explain.verdict_of(ladder[-1], explained.accepted) == "ambiguous"
    found = replace(explained, verdict="ambiguous", ladder=ladder)
    assert found.undetermined == (name,)
    assert found.added == ()
    assert found.ambiguous == ((name, OTHER_CAUSE),)
    assert "doubtful" in headline(found)
    assert "does not determine the size of" in " ".join(_name_notes(found, name))
    assert effect_verdict(CATALOGUE[name], found).verdict == "indistinguishable"


def test_two_effects_of_which_only_a_sum_is_determined_are_both_undetermined(explained_case):
    fit = explained_case.explained.final.fit
    (name,) = explained_case.explained.added
    (part,) = (part for part in fit.model.effects if part.effect.name == name)
    row = fit.model.names.index(f"{name}.{part.effect.amplitudes[0].name}")
    twin = next(k for k in range(len(fit.u)) if k != row)  # a map's parameter plays the other
    effect = SimpleNamespace(name="twin", null={"size": 0.0})
    parameters = [replace(fit.model.unknowns.unknowns[row], name="twin.size")] * len(fit.u)
    parameters[row] = fit.model.unknowns.unknowns[row]
    names = tuple("twin.size" if k == twin else n for k, n in enumerate(fit.model.names))
    ones = np.ones(len(fit.u))

    def judged(correlation: float, std: float) -> tuple[str, ...]:
        covariance = np.eye(len(fit.u)) * std**2
        covariance[row, twin] = covariance[twin, row] = correlation * std**2
        model = SimpleNamespace(
            effects=(part, SimpleNamespace(effect=effect)), names=names,
            unknowns=SimpleNamespace(unknowns=parameters, at_natural_end=lambda u: u == 0),
            bounds=(-1e6 * ones, 1e6 * ones),
        )  # fmt: skip
        made: Any = SimpleNamespace(model=model, u=ones, covariance_scaled=covariance)
        return undetermined(made, [name, "twin"])

    assert judged(-0.999, 10.0) == (name, "twin")
    assert judged(-0.9, 10.0) == ()  # the data tell them apart
    assert judged(-0.999, 0.1) == ()  # both are there whatever their sum


@pytest.mark.parametrize(
    ("field", "rise"), [(None, "foretold_rise"), (1, "foretold_rise_beside_field")]
)
def test_an_effect_may_raise_the_error_of_presses_left_out_more_beside_a_free_map(field, rise):
    def step(error: float) -> Any:
        validated = SimpleNamespace(rms_m=error)
        return SimpleNamespace(fit=SimpleNamespace(field=field), cross_validation=validated)

    most = getattr(SELECTION, rise)
    assert foretells_worse(step(1.0), step(1.01 * most), SELECTION)
    assert not foretells_worse(step(1.0), step(0.99 * most), SELECTION)
