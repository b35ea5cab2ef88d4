"""Whether an answer holds on some of its readings: only then is it confirmed."""

from dataclasses import replace

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE as BUILT_IN
from identify.select.explanation import Explanation
from identify.select.forward_selection import forward_selection
from identify.select.outlying_presses import confirmed
from identify.select.settings import SELECTION
from tests.identify.select.loop_problem import PEAK_N, TRUE, model, scan, timing, true_compliance

OFFSET_M = 2e-4
CATALOGUE = [BUILT_IN[name] for name in ("contact_offset", "hysteresis", "viscoelasticity")]


def explained(table) -> Explanation:
    return forward_selection(model(table), TRUE, table, CATALOGUE)


def table_with(change_m: np.ndarray, seed: int):
    press, _, _, force = timing(seed)
    return scan(true_compliance()[press] * force + change_m, force, seed)


@pytest.fixture(scope="module")
def late_touch():
    """A scan whose travel counts from too early, and its explanation."""
    table = table_with(np.full(25 * 22, OFFSET_M), 5)
    return table, explained(table)


def test_an_answer_that_all_readings_call_for_holds_on_some_of_them(late_touch):
    table, answer = late_touch
    assert answer.added == ("contact_offset",)
    some = table.time_s % 3 > 1
    others = table.rows(some)
    again = confirmed(answer, model(others), others, some, print)
    assert again is not None
    fit, comparison = again
    assert comparison.is_noise
    assert len(fit.at.residual) == np.count_nonzero(some) < len(table)
    found, std = fit.values["contact_offset.offset_m"], fit.std["contact_offset.offset_m"]
    assert std > answer.final.fit.std["contact_offset.offset_m"]
    assert found == pytest.approx(OFFSET_M, abs=4 * std)


def test_candidates_that_were_fitted_to_fewer_readings_are_compared_on_those(late_touch):
    """As those of an effect that was found without the presses that stand apart."""
    table, answer = late_touch
    some = table.time_s % 3 > 1
    others = table.rows(some)
    (effect,) = explained(others).accepted
    (near, *_), best = effect.candidates, replace(answer.accepted[0], candidates=effect.candidates)
    assert len(near.fit.at.residual) < len(table)
    answer = replace(answer, accepted=(best,))
    assert confirmed(answer, model(others), others, some, print) is not None


def test_an_answer_that_rests_on_a_few_readings_does_not_hold_without_them():
    press, _, phase, force = timing(6)
    loop_m = 0.3 * true_compliance()[press] * force * (1 - force / PEAK_N)
    table = table_with(np.where(phase == "unload", loop_m, 0.0), 6)
    answer = explained(table)
    assert answer.added == ("hysteresis",)
    some = table.phase != "unload"
    others = table.rows(some)
    said = []
    assert confirmed(answer, model(others), others, some, said.append) is None
    assert any(text.startswith("testing the need of") for text in said)


def swaying(table):
    """The table with a slow swing in it, which no effect of this catalogue explains."""
    swing_m = 1e-4 * np.sin(2 * np.pi * table.time_s / 7)
    return table.replace(displacement_m=table.displacement_m + swing_m)


def test_an_answer_beside_which_only_the_other_readings_are_structured_does_not_hold(late_touch):
    table, answer = late_touch
    every = np.ones(len(table), bool)
    other = swaying(table)
    assert confirmed(answer, model(table), table, every, print) is not None
    assert confirmed(answer, model(other), other, every, print) is None


@pytest.mark.slow
def test_where_something_is_left_the_effects_must_still_earn_their_place():
    table = swaying(table_with(np.full(25 * 22, OFFSET_M), 8))
    alone = replace(SELECTION, most_effects=1)  # no cause without a name beside it
    answer = forward_selection(model(table), TRUE, table, CATALOGUE, settings=alone)
    assert answer.verdict == "unexplained"
    assert [addition.name for addition in answer.accepted] == ["contact_offset"]
    some = table.time_s % 3 > 1
    others = table.rows(some)
    again = confirmed(answer, model(others), others, some, print)
    assert again is not None
    assert not again[1].is_noise
    without = others.replace(displacement_m=others.displacement_m - OFFSET_M)
    assert confirmed(answer, model(without), without, some, print) is None
