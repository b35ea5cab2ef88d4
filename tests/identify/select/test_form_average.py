"""Intervals of the map count the form of an effect where the scan leaves it open."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.stats import norm

from identify.catalogue.catalogue import CATALOGUE
from identify.fit.result import Estimate
from identify.select.form_average import (
    Form,
    _beside_other_laws,
    _quantile,
    averaged,
    forms_of,
    log_evidence,
)
from identify.select.forward_selection import forward_selection
from tests.identify.select.loop_problem import TRUE, model
from tests.identify.select.test_families import three_times
from tests.identify.select.test_forward_selection import planted

CREEP = ("viscoelasticity", "two_time_creep", "power_law_creep")


@pytest.fixture(scope="module")
def crept():
    table = planted(8, three_times)
    names = (*CREEP, "contact_offset")
    return forward_selection(model(table), TRUE, table, [CATALOGUE[name] for name in names])


@pytest.mark.slow
def test_the_interval_of_the_stiffness_holds_where_one_time_stands_for_three(crept):
    forms = forms_of(crept)
    assert forms[0].effect == ""
    assert {form.name for form in forms[1:]} <= set(CREEP)
    assert sum(form.weight for form in forms) == pytest.approx(1, abs=0.02)
    alone, counted = crept.final.fit.parameters["background_pa"], averaged(crept, forms)
    # Creep faster than the readings is elastic for one law and creep for the next
    assert not alone.lower95 <= 5000 <= alone.upper95
    assert counted["background_pa"].lower95 <= 5000 <= counted["background_pa"].upper95
    assert counted["background_pa"].value == alone.value
    name = f"{crept.added[0]}.g"
    assert counted[name] == crept.final.fit.parameters[name]


def test_an_effect_is_averaged_over_the_forms_of_the_others_alone(crept):
    """Two forms of half the evidence each: the interval reaches from the one to the other."""
    fit, sd = crept.final.fit, 1e-3
    (effect,) = fit.model.effects
    key, unshared = (f"{effect.effect.name}.{p.name}" for p in effect.parameters[:2])
    names = fit.model.names
    mean = fit.u[names.index(key)]
    own = Form("", "", 0.5, {n: (u, sd**2) for n, u in zip(names, fit.u, strict=True)})
    other = Form("another", "its form", 0.5, {key: (mean + 2.0, sd**2)})
    counted = averaged(crept, (own, other))
    p = next(p for p in fit.model.unknowns.unknowns if p.name == key)
    expected = p.to_value(mean + 2.0 + sd * norm.ppf(0.95))
    assert counted[key].upper95 == pytest.approx(expected, rel=1e-5)
    assert counted[key].lower95 < fit.parameters[key].value
    assert counted[unshared] == fit.parameters[unshared]
    assert counted["background_pa"] == fit.parameters["background_pa"]


def test_laws_that_are_equal_for_the_presses_have_equal_weights(crept):
    """Their joint fits tell no more than the laws are right to: not 99 % for one of them."""
    (effect,) = crept.accepted
    other = replace(effect.candidates[0], name="another law")
    called = replace(effect, candidates=(*effect.candidates, other), shown_by_presses=True)
    forms = forms_of(replace(crept, accepted=(called,)))
    assert len(forms) > 1
    assert [form.weight for form in forms] == pytest.approx([1 / len(forms)] * len(forms))


def test_a_structured_residual_averages_nothing(crept):
    left = replace(crept, verdict="unexplained")
    assert forms_of(left) == ()
    assert averaged(left, ()) == dict(crept.final.fit.parameters)


def test_a_parameter_that_the_scan_does_not_show_costs_no_evidence(crept):
    """The evidence of a Gaussian posterior in closed form: with an amplitude without any effect it
    is the same as without the amplitude."""
    fit = crept.final.fit
    jacobian = fit.at.jacobian.copy()
    jacobian[:, -2:] = 0.0  # neither amplitude nor shape shows
    blind = replace(fit.solution, at=replace(fit.at, jacobian=jacobian), u=_at_prior(fit))
    seen = log_evidence(replace(fit, solution=blind))
    information = jacobian[:, :-2].T @ jacobian[:, :-2]
    alone = -0.5 * (fit.chi2 + np.linalg.slogdet(information)[1])
    assert seen == pytest.approx(alone, abs=1e-3)


def _at_prior(fit):
    """Scaled unknowns of a fit with those of its effect at the centre of their prior."""
    u = fit.u.copy()
    shape = fit.model.effects[0].parameters[1]
    u[-2:] = 0.0, (shape.to_scaled(shape.lower) + shape.to_scaled(shape.upper)) / 2
    return u


def test_a_large_amplitude_is_no_argument_against_a_model(crept):
    """A base without friction is thousands of typical sizes away from none."""
    fit = crept.final.fit
    (part,) = fit.model.effects
    g = part.parameters[0]
    small = replace(part, parameters=(replace(g, typical=g.typical / 1000), part.parameters[1]))
    u = fit.u.copy()
    u[-2] *= 1000
    jacobian = fit.at.jacobian.copy()
    jacobian[:, -2] /= 1000
    model = replace(fit.model, effects=(small,))
    scaled = replace(fit.solution, model=model, at=replace(fit.at, jacobian=jacobian), u=u)
    assert log_evidence(replace(fit, solution=scaled)) == pytest.approx(log_evidence(fit), abs=3)


def test_quantiles_of_a_mixture():
    one = np.array([1.0])
    assert _quantile(0.975, one, np.array([2.0]), one, 3 * one) == pytest.approx(2 + 3 * 1.959964)
    assert _quantile(0.025, one, np.array([2.0]), one, 3 * one) == pytest.approx(2 - 1.959964)
    half, apart, wide = np.array([0.5, 0.5]), np.array([0.0, 100.0]), np.array([1.0, 1.0])
    expected = 100 + norm.ppf(0.95)
    assert _quantile(0.975, half, apart, wide, wide) == pytest.approx(expected)


def test_intervals_beside_other_laws_of_contact_end_at_the_bounds():
    p = SimpleNamespace(name="spherical_tip.share", lower=0.0, upper=1.0)
    unknowns = SimpleNamespace(unknowns=[p])
    fit = SimpleNamespace(model=SimpleNamespace(unknowns=unknowns))
    effect = SimpleNamespace(name="spherical_tip", range_of={"share": (-0.3, 0.3)})
    explained: Any = SimpleNamespace(final=SimpleNamespace(fit=fit), accepted=[effect])
    own = Estimate(0.85, 0.05, "1", 0.75, 0.95, free=True)
    (wider,) = _beside_other_laws(explained, {p.name: own}).values()
    assert (wider.lower95, wider.upper95) == (pytest.approx(0.45), 1.0)
