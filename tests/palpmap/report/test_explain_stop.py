"""When the loop stops: a trace beside what was explained is no call for another effect."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.select.candidates import best_candidates
from identify.select.diagnosis import Diagnosis
from identify.select.explanation import is_more_missing, verdict_of
from identify.select.model_error import confounded
from identify.select.score_test import Score


@pytest.fixture(scope="module")
def rungs(explained_case):
    return explained_case.explained.ladder, explained_case.explained.accepted


def significant(rung, share: float, explained: float):
    """The rung with its best effect made significant, at a share of the explained chi-square."""
    best = replace(rung.diagnosis.scores[0], statistic=share * explained)
    diagnosis = replace(
        rung.diagnosis,
        scores=(best, *rung.diagnosis.scores[1:]),
        significant=frozenset([best.name]),
    )
    return replace(rung, diagnosis=diagnosis)


@pytest.mark.parametrize(("share", "goes_on"), [(0.01, False), (0.05, True)])
def test_a_trace_beside_a_noise_like_residual_ends_the_loop(rungs, share, goes_on):
    (first, last), additions = rungs
    explained = first.fit.chi2 - last.fit.chi2
    assert last.comparison.is_noise
    assert is_more_missing((first, significant(last, share, explained)), additions) is goes_on


def test_the_smallest_significant_effect_counts_where_nothing_was_added(rungs):
    (first, _), _ = rungs
    assert is_more_missing((significant(first, 1e-6, first.fit.chi2),), ())


def test_a_structured_residual_calls_for_more_whatever_was_explained(rungs):
    (first, last), additions = rungs
    explained = first.fit.chi2 - last.fit.chi2
    structured = replace(significant(last, 0.001, explained), comparison=first.comparison)
    assert is_more_missing((first, structured), additions)


@pytest.mark.parametrize("error", [0.0, 0.002])
def test_compliances_beside_a_free_map_that_errs_in_each_call_for_no_effect(rungs, error):
    """The prior decides there which of them are improbable; a course within a press is another."""
    (first, last), additions = rungs
    at, press = last.fit.at, last.fit.model.readings.press
    of_press = np.random.default_rng(3).standard_normal(press.max() + 1)[press]
    compliances = at.whitened(at.by_compliance, press) * of_press
    course = np.random.default_rng(4).standard_normal(len(press))
    field: Any = SimpleNamespace(hyper=SimpleNamespace(error=error))
    for pattern, counts in ((compliances, error == 0), (course, True)):
        step = significant(last, 0.05, first.fit.chi2 - last.fit.chi2)
        best = replace(step.diagnosis.scores[0], beyond=pattern[:, None])
        diagnosis = replace(step.diagnosis, scores=(best, *step.diagnosis.scores[1:]))
        fit = replace(last.fit, field=field)
        step = replace(step, diagnosis=diagnosis, fit=fit)
        assert step.comparison.is_noise
        assert is_more_missing((first, step), additions) == counts
        structured = replace(step, comparison=first.comparison)
        assert is_more_missing((first, structured), additions)
    assert is_more_missing((first, replace(step, fit=last.fit)), additions)


def test_what_an_ambiguous_group_leaves_may_be_the_difference_of_its_members(rungs):
    (first, last), (addition,) = rungs
    explained = first.fit.chi2 - last.fit.chi2
    rival = addition.candidates[0]
    group = replace(addition, candidates=(rival, replace(rival, name="another")))
    ladder = (first, significant(last, 0.05, explained))
    assert is_more_missing(ladder, (addition,))
    assert not is_more_missing(ladder, (group,))


@pytest.mark.parametrize(
    ("behind", "priced", "alike"), [(3, 11, True), (7, 11, False), (7, 9, True)]
)
def test_a_rival_is_beaten_by_the_data_and_not_by_its_price_alone(rungs, behind, priced, alike):
    (addition,) = rungs[1]
    best = addition.candidates[0]
    other = replace(
        best, name="another", chi2=best.chi2 + behind, criterion=best.criterion + priced
    )
    assert (
        replace(addition, candidates=(best, other)).equivalents == (best.name, "another")
    ) is alike


def test_a_residual_that_is_noise_settles_what_no_effect_does_better(rungs):
    (first, last), _ = rungs
    quiet = replace(significant(first, 0.01, first.fit.chi2), comparison=last.comparison)
    assert verdict_of(quiet, (), further=first.diagnosis.scores[0].name) == "ambiguous"
    assert verdict_of(quiet, ()) == "nothing_missing"
    assert verdict_of(first, ()) == "unexplained"


@pytest.mark.parametrize(
    ("chance", "noise_like", "is_enough"),
    [(5e-4, True, True), (5e-3, True, False), (5e-4, False, True), (5e-3, False, False)],
)
def test_beside_noise_and_structure_only_a_score_that_chance_does_not_give_is_an_answer(
    rungs, chance, noise_like, is_enough
):
    (first, last), _ = rungs
    tested = sum(score.untestable is None for score in first.diagnosis.scores)
    best = replace(first.diagnosis.scores[0], log_p=np.log(chance / tested))
    others = tuple(replace(score, log_p=0.0) for score in first.diagnosis.scores[1:])
    diagnosis = replace(first.diagnosis, scores=(best, *others), significant=frozenset([best.name]))
    comparison = last.comparison if noise_like else first.comparison
    rung = replace(first, diagnosis=diagnosis, comparison=comparison)
    effects = {best.name: CATALOGUE[best.name]}
    assert bool(best_candidates(rung, effects, str, ())) is is_enough


def test_nothing_significant_ends_the_loop(rungs):
    ladder, additions = rungs
    assert not is_more_missing(ladder, additions)


@pytest.mark.parametrize(("cosine", "beside"), [(0.97, ("mesh_error",)), (0.6, ())])
def test_what_looks_like_the_models_own_error_is_not_told_from_it(cosine, beside):
    def score(name: str, pattern: list[float]) -> Score:
        basis = np.array(pattern)[:, None]
        return Score(name, 100.0, -50.0, {}, np.ones(1), np.ones(1), 0.3, basis, 1e-5)

    scores = (
        score("mesh_error", [1.0, 0.0]),
        score("poisson_ratio", [cosine, float(np.sqrt(1 - cosine**2))]),
    )
    diagnosis = Diagnosis(scores, frozenset({"poisson_ratio"}), 200.0)
    rung: Any = SimpleNamespace(diagnosis=diagnosis)
    assert confounded(rung, "poisson_ratio") == beside
