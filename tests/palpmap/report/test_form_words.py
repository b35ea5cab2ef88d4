"""What terminal and report say of the form of a cause, and of where the travel counts from."""

from types import SimpleNamespace
from typing import Any

from identify.catalogue.catalogue import CATALOGUE
from palpmap.result.doubts import counting_notes, form_notes


def candidate(name: str, chi2: float, criterion: float, parameters: int) -> Any:
    return SimpleNamespace(name=name, family=CATALOGUE[name].family, chi2=chi2, criterion=criterion,
                           fit=SimpleNamespace(u=[0.0] * parameters))  # fmt: skip


def explained(candidates: list[Any], travel_from: str = "") -> Any:
    names = [c.name for c in candidates[:1]]
    parts = [SimpleNamespace(effect=CATALOGUE[name]) for name in names]
    readings = SimpleNamespace(travel_from=travel_from)
    model = SimpleNamespace(readings=readings, effects=parts)
    accepted = SimpleNamespace(name=names[0], candidates=tuple(candidates))
    return SimpleNamespace(accepted=(accepted,), added=tuple(names),
                           final=SimpleNamespace(fit=SimpleNamespace(model=model)))  # fmt: skip


ALONE: Any = SimpleNamespace(forms=())


def test_the_next_form_of_the_cause_is_named_with_its_distance():
    found = explained([
        candidate("play", 500.0, 550.0, 8), candidate("several_plays", 497.0, 563.0, 10),
        candidate("free_loop", 540.0, 606.0, 10), candidate("time_lag", 505.0, 549.0, 7),
    ])  # fmt: skip
    assert form_notes(ALONE, found) == [
        "Of the forms of this cause play fits best for its number of parameters. The next, "
        "several_plays, has a chi-square 3 lower with 2 more parameters."
    ]
    assert form_notes(ALONE, explained([candidate("time_lag", 5.0, 9.0, 7)])) == []


def test_a_larger_law_with_more_evidence_is_said_to_need_parameters_that_nothing_calls_for():
    found = explained([
        candidate("viscoelasticity", 500.0, 550.0, 8), candidate("local_creep", 490.0, 570.0, 11),
    ])  # fmt: skip
    found.final.fit.parameters = {}
    found.final.fit.map = SimpleNamespace(names=())

    def shares(last: float, other: float) -> Any:
        form = SimpleNamespace(in_place_of="viscoelasticity", effect="local_creep", weight=other)
        return SimpleNamespace(
            forms=(SimpleNamespace(in_place_of="", effect="", weight=last), form)
        )

    (says,) = form_notes(shares(0.2, 0.8), found)
    named = "viscoelasticity is named, as it does without 3 parameters of local_creep"
    assert named in says
    (says,) = form_notes(shares(0.8, 0.2), found)
    assert named not in says


def test_where_the_travel_counts_from_is_said_where_it_is_not_stated():
    swings = [candidate("breathing_from_touch", 1.0, 2.0, 9)]
    (says,) = counting_notes(explained(swings))
    assert "counts from each press's own touch, as breathing_from_touch shows" in says
    assert 'travel_from = "touch" under [study]' in says
    assert counting_notes(explained(swings, "touch")) == []
    assert counting_notes(explained([candidate("force_bias", 1.0, 2.0, 7)])) == []
