"""A free form gives way to the special case that does as well once the other causes are found."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.fit.joint_fit import fit_jointly
from identify.select import reconsider
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate
from identify.select.forward_selection import Policy, forward_selection
from identify.select.reconsider import as_special_cases
from identify.select.settings import SELECTION
from identify.select.step import step_of
from tests.identify.select.loop_problem import TRUE, mechanics, model, points, scan, timing

OFFSET_M, SLOPE, DRIFT_N_PER_S = 1e-4, 0.01, 2e-4
NAMES = ("force_drift", "curved_surface", "surface_tilt", "contact_offset")
EFFECTS = {name: CATALOGUE[name] for name in NAMES}


@cache
def beside_a_drift(slope=0.0, offset_m=OFFSET_M, drift_n_per_s=DRIFT_N_PER_S):
    """Return the step of a drifting scan with an offset, and the fit with a surface beside it."""
    press, time, _, force = timing(6)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    touch = offset_m + slope * (points()[:, 0] - points()[:, 0].mean())
    read = force + drift_n_per_s * (time - time.min())
    table = scan(compliance[press] * force - touch[press], read, 6)
    drift = with_one(fit_jointly(model(table), TRUE), "force_drift")
    step = step_of(drift, table, list(EFFECTS.values()), 0, lambda text: None)
    return table, step, with_one(drift, "curved_surface")


def with_one(fit, name):
    effect = CATALOGUE[name]
    start = {p.name: 0.1 * p.typical for p in effect.parameters}
    return fit_jointly(fit.model.with_effect(effect, start, fit.at.state), fit.map, rounds=0)


def surface(fit, candidates=()):
    own = Candidate("curved_surface", fit.chi2, fit.bic, fit)
    return AcceptedEffect("curved_surface", (own, *candidates), chi2_before=np.inf)


def simplified(effect, step, fit, effects=None):
    said = []
    found = as_special_cases(step, fit, [effect], EFFECTS if effects is None else effects,
                             said.append)  # fmt: skip
    return *found, said


def test_an_offset_takes_the_place_of_a_surface_that_contains_it():
    _, step, fit = beside_a_drift()
    simpler, accepted, exchanged, _ = simplified(surface(fit), step, fit)
    assert exchanged == {"curved_surface": "contact_offset"}
    assert set(simpler.effect_names) == {"force_drift", "contact_offset"}
    assert simpler.bic < fit.bic
    offset = "contact_offset.offset_m"
    assert abs(simpler.values[offset] + OFFSET_M) < 3 * simpler.std[offset]
    (one,) = accepted
    assert (one.name, one.group) == ("contact_offset", ("contact_offset",))
    assert {"curved_surface", "surface_tilt"} <= {c.name for c in one.candidates}
    assert [c.name for c in one.first_candidates] == ["curved_surface"]


def test_special_cases_are_scored_with_the_seed_of_the_step(monkeypatch):
    _, step, fit = beside_a_drift()
    seeds = []

    def diagnose(*given, seed, settings):
        seeds.append(seed)
        return scored(*given, seed=seed, settings=settings)

    scored = reconsider.diagnose
    monkeypatch.setattr(reconsider, "diagnose", diagnose)
    seeded = replace(step, diagnosis=replace(step.diagnosis, seed=7))
    simplified(surface(fit), seeded, fit)
    assert step.diagnosis.seed == 0
    assert seeds == [7]


def test_a_tilt_is_found_in_a_surface_and_no_more_than_a_tilt():
    _, step, fit = beside_a_drift(SLOPE)
    _, accepted, exchanged, _ = simplified(surface(fit), step, fit)
    assert exchanged == {"curved_surface": "surface_tilt"}
    assert accepted[0].name == "surface_tilt"


def test_a_surface_stays_where_no_special_case_does_as_well():
    _, step, fit = beside_a_drift(SLOPE)
    only = {name: EFFECTS[name] for name in ("force_drift", "curved_surface", "contact_offset")}
    same, accepted, exchanged, said = simplified(surface(fit), step, fit, only)
    assert same is fit
    assert not exchanged
    assert accepted == [surface(fit)]
    assert said[0] == "trying contact_offset"


@pytest.mark.parametrize("why", ["compared", "by the presses", "not in the catalogue"])
def test_special_cases_are_not_tried_where_they_are_known_or_not_asked_for(why):
    _, step, fit = beside_a_drift()
    effect, effects = surface(fit), EFFECTS
    if why == "compared":
        others = [Candidate(name, fit.chi2, fit.bic + 20, fit) for name in NAMES[2:]]
        effect = surface(fit, others)
    elif why == "by the presses":
        effect = replace(effect, shown_by_presses=True)
    else:
        effects = {name: EFFECTS[name] for name in NAMES[:2]}
    same, accepted, exchanged, said = simplified(effect, step, fit, effects)
    assert same is fit
    assert accepted == [effect]
    assert not exchanged
    assert not said


@pytest.mark.slow
@pytest.mark.parametrize("unneeded", ["force_drift", "contact_offset"])
def test_after_an_exchange_every_effect_must_be_needed_again(unneeded):
    hidden = {"offset_m": 0.0} if unneeded == "contact_offset" else {"drift_n_per_s": 0.0}
    table, step, both = beside_a_drift(**hidden)
    alone = fit_jointly(model(table), TRUE)
    fits = {"curved_surface": with_one(alone, "curved_surface"), "force_drift": both}
    right = with_one(step.fit, "contact_offset")
    asked = []

    def proposed(now, effects, say, exclude, settings):
        name = list(fits)[len(now.fit.effect_names)]
        return (
            ()
            if name in exclude
            else (Candidate(name, fits[name].chi2, fits[name].bic, fits[name]),)
        )

    def compared(fit, accepted, say, last_too, settings):
        if len(accepted) < 2:
            return fit, accepted, {}
        own = Candidate("contact_offset", right.chi2, right.bic, right)
        first = replace(accepted[0], name="contact_offset", candidates=(own,))
        return right, [first, accepted[1]], {"curved_surface": "contact_offset"}

    def pruned(fit, names, say, settings):
        asked.append(tuple(names))
        if len(names) < 2:
            return fit, []
        return fit_jointly(fit.model.without(unneeded), fit.map), [unneeded]

    policy = Policy(propose=proposed, worthwhile=lambda *_: True, prune=pruned, compare=compared,
                    goes_on=lambda ladder, *_: len(ladder) < 3)  # fmt: skip
    found = forward_selection(model(table), TRUE, table, list(EFFECTS.values()), policy=policy)
    kept = {"force_drift": "contact_offset", "contact_offset": "force_drift"}[unneeded]
    assert asked == [(), ("curved_surface",), ("contact_offset", "force_drift")]
    assert [a.name for a in found.accepted] == [kept]
    assert found.final.fit.effect_names == (kept,)
    assert {"curved_surface", unneeded} <= set(found.dropped)


@pytest.mark.slow
def test_the_ladder_leads_to_a_special_case_of_what_took_an_effect_s_place():
    table, step, _ = beside_a_drift()
    alone = fit_jointly(model(table), TRUE)
    fits = {"surface_tilt": with_one(alone, "surface_tilt"), "force_drift": None}
    fits["force_drift"] = with_one(step.fit, "surface_tilt")
    curved = with_one(step.fit, "curved_surface")

    def proposed(now, effects, say, exclude, settings):
        name = list(fits)[len(now.fit.effect_names)]
        return (Candidate(name, fits[name].chi2, fits[name].bic, fits[name]),)

    def compared(fit, accepted, say, last_too, settings):
        if len(accepted) < 2:
            return fit, accepted, {}
        return curved, [surface(curved), accepted[1]], {"surface_tilt": "curved_surface"}

    policy = Policy(propose=proposed, worthwhile=lambda *_: True, compare=compared,
                    goes_on=lambda ladder, *_: len(ladder) < 3)  # fmt: skip
    few = [EFFECTS[name] for name in ("force_drift", "curved_surface", "contact_offset")]
    found = forward_selection(
        model(table), TRUE, table, [*few, EFFECTS["surface_tilt"]], policy=policy
    )
    assert set(found.final.fit.effect_names) == {"force_drift", "contact_offset"}
    assert found.ladder[1].fit.effect_names == ("contact_offset",)
    assert {"surface_tilt", "curved_surface"} <= set(found.dropped)


@pytest.mark.slow
def test_of_three_effects_beside_structure_a_quarter_is_asked_for_and_none_is_compared_again():
    """Beside structure none is named: imitations of an unknown cause follow each other cheaply."""
    table, *_ = beside_a_drift(slope=SLOPE)
    swing_m = 1e-4 * np.sin(2 * np.pi * table.time_s / 7)
    table = table.replace(displacement_m=table.displacement_m + swing_m)
    order, least, compared = ("force_drift", "contact_offset", "surface_tilt"), [], []

    def proposed(now, effects, say, exclude, settings):
        fit = with_one(now.fit, order[len(now.fit.effect_names)])
        return (Candidate(fit.effect_names[-1], fit.chi2, fit.bic, fit),)

    def asked(before, after, share):
        least.append(share)
        return True

    def looked(fit, accepted, say, last_too, settings):
        compared.append(len(accepted))
        return fit, list(accepted), {}

    policy = Policy(propose=proposed, worthwhile=asked, prune=lambda fit, *_: (fit, []),
                    compare=looked, goes_on=lambda ladder, *_: len(ladder) < 4)  # fmt: skip
    found = forward_selection(model(table), TRUE, table, list(EFFECTS.values()), policy=policy)
    assert not found.final.comparison.is_noise
    assert len(found.accepted) == 3 or found.unknown
    assert least[:3] == [SELECTION.worthwhile, SELECTION.worthwhile, SELECTION.third_worthwhile]
    assert compared[:2] == [1, 2]
    assert 3 not in compared
