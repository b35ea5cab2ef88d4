"""The loop on a small body: nothing missing, one effect, what the model does not know."""

from dataclasses import replace
from itertools import pairwise
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.fit.cross_validation import cross_validate, predicted_error
from identify.fit.joint_fit import fit_jointly
from identify.fit.settings import PRECISE, CrossValidationSettings
from identify.measurement.model import MeasurementModel
from identify.measurement.noise import Noise
from identify.select.accepted_effect import AcceptedEffect
from identify.select.candidates import Candidate, leaving_noise, ranked
from identify.select.forward_selection import Policy, forward_selection
from identify.select.settings import SELECTION
from identify.select.verdicts import refit_numbers
from models import Scan
from sim.body.true_map import Inclusion, TruthMap
from tests.identify.select.loop_problem import (
    NOISE,
    PEAK_N,
    TRUE,
    mechanics,
    model,
    points,
    scan,
    timing,
    true_compliance,
)

QUICK = [CATALOGUE[n] for n in (
    "viscoelasticity", "hysteresis", "force_bias", "contact_offset", "force_drift",
    "tool_compliance", "extra_inclusion", "strain_stiffening",
)]  # fmt: skip


def planted(seed: int, change) -> Scan:
    """A scan on the true body; `change(d, F, t, phase, press)` returns displacement and force."""
    press, time, phase, force = timing(seed)
    travel = true_compliance()[press] * force
    displacement, read = change(travel, force, time, phase, press)
    return scan(displacement, read, seed)


def creeping(g: float, tau_s: float):
    """A change by a Kelvin-Voigt element in steps of a millisecond."""

    def change(d, f, t, phase, press):
        out = np.empty_like(d)
        for j in range(25):
            own = press == j
            fine = np.arange(t[own][0] - 0.125, t[own][-1] + 1e-3, 1e-3)
            u = np.interp(fine, np.r_[t[own][0] - 0.125, t[own]], np.r_[0.0, d[own]])
            z = np.zeros_like(u)
            for i in range(1, len(u)):
                z[i] = z[i - 1] + (u[i] - z[i - 1]) * 1e-3 / tau_s
            out[own] = d[own] + g * np.interp(t[own], fine, z)
        return out, f

    return change


def test_nothing_is_missing_from_a_linear_body():
    table = planted(3, lambda d, f, t, phase, press: (d, f))
    found = forward_selection(model(table), TRUE, table, QUICK)
    assert found.verdict == "nothing_missing"
    assert found.added == ()
    assert found.final.fit.chi2_per_dof == pytest.approx(1, abs=4 * np.sqrt(2 / 540))
    for name, value in zip(TRUE.names, TRUE.values, strict=True):
        assert abs(found.final.fit.values[name] - value) < 4 * found.final.fit.std[name]


def test_an_offset_is_found_and_the_map_recovers():
    table = planted(4, lambda d, f, t, phase, press: (d + 1.5e-4, f))
    found = forward_selection(model(table), TRUE, table, QUICK)
    assert (found.verdict, found.added) == ("explained", ("contact_offset",))
    before, after = found.ladder[0], found.final
    assert after.fit.values["contact_offset.offset_m"] == pytest.approx(1.5e-4, abs=3e-5)
    assert after.fit.rms_m < 0.8 * before.fit.rms_m
    assert after.cross_validation.ratio == pytest.approx(1, abs=0.15)
    assert before.cross_validation.ratio > 1.3
    error = [abs(step.fit.values["background_pa"] - TRUE.background_pa) for step in found.ladder]
    assert error[1] < error[0] / 3


def test_creep_is_found_with_its_time():
    table = planted(5, creeping(0.1, 0.8))
    found = forward_selection(model(table), TRUE, table, QUICK)
    assert (found.verdict, found.added) == ("explained", ("viscoelasticity",))
    own = found.final.fit
    assert own.values["viscoelasticity.g"] == pytest.approx(0.1, abs=0.02)
    assert own.values["viscoelasticity.tau_s"] == pytest.approx(0.8, abs=0.4)


def test_a_small_effect_is_found_beside_noise_that_is_less_than_stated():
    """Its chi-square is below the readings' number, so that no share of an excess can be told."""
    table = planted(4, lambda d, f, t, phase, press: (d + 6e-5, f))
    louder = Noise(1.1 * NOISE.displacement_m, 1.1 * NOISE.force_n)
    found = forward_selection(replace(model(table), noise=louder), TRUE, table, QUICK)
    first = found.ladder[0]
    assert first.fit.chi2_per_dof < 1
    assert not first.comparison.is_noise
    assert "contact_offset" in (
        *found.added,
        *(name for group in found.ambiguous for name in group),
    )


@pytest.mark.slow
def test_a_ball_is_told_from_a_rigid_tip_by_fits_that_ended():
    """By few evaluations each, both do as well: a map that ended as a hard grain goes far back."""
    (spot,) = TRUE.inclusions
    ball = Inclusion(spot.weight_pa, (spot.x_m, spot.y_m, spot.z_m), spot.radius_m, ball_share=0.85)
    compliance = true_compliance(TruthMap(TRUE.background_pa, (ball,)))
    press, _, _, force = timing(8)
    table = scan(compliance[press] * 4 * force, 4 * force, 8)
    catalogue = [*QUICK, *(CATALOGUE[n] for n in ("inclusion_edge", "rigid_tip"))]
    body = mechanics.__wrapped__()  # without the reduced bases that other tests have grown
    found = forward_selection(model(table, body), TRUE, table, catalogue)
    assert found.ladder[0].fit.values["inclusion_1.weight_pa"] > 3 * spot.weight_pa
    (accepted,) = found.accepted
    chi2 = {c.name: c.chi2 for c in accepted.first_candidates}
    assert chi2["rigid_tip"] < chi2["inclusion_edge"] + SELECTION.margin
    assert (found.verdict, found.added) == ("explained", ("inclusion_edge",))
    for key in ("weight_pa", "z_m", "radius_m"):
        own = found.final.fit.parameters[f"inclusion_1.{key}"]
        assert own.lower95 < getattr(spot, key) < own.upper95
    assert found.final.fit.chi2_per_dof == pytest.approx(1, abs=0.2)
    told = refit_numbers("inclusion_edge", found)  # what the report says in place of the score
    assert told is not None
    score, p_value, explained_fraction = told
    assert score > 50
    assert p_value < 1e-9
    assert 0.3 < explained_fraction <= 1
    assert refit_numbers("breathing", found) is None


def late(d, f, t, phase, press):
    measured = np.empty_like(f)
    for j in range(25):
        own = press == j
        times = np.r_[t[own][0] - 0.125, t[own]]
        measured[own] = np.interp(t[own] - 0.08, times, np.r_[0.0, f[own]])
    return d, measured


ALIKE = ("time_lag", "filtered_force", "guide_friction", "backlash", "free_loop")
"""Effects that turn with the way."""


def test_a_late_force_channel_is_named_with_its_lag():
    table = planted(6, late)
    catalogue = {e.name: e for e in (*QUICK, *(CATALOGUE[name] for name in ALIKE))}
    found = forward_selection(model(table), TRUE, table, list(catalogue.values()))
    assert (found.verdict, found.added) == ("explained", ("time_lag",))
    assert found.final.fit.values["time_lag.lag_s"] == pytest.approx(0.08, abs=0.003)


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_a_late_force_channel_is_explained_by_no_other_name(whole):
    table = planted(6, late)
    others = [effect for effect in (CATALOGUE if whole else QUICK) if effect.name not in ALIKE]
    found = forward_selection(model(table), TRUE, table, others)
    assert found.verdict == "unexplained"
    assert found.added == ()
    law = found.final.comparison.law
    assert law is not None
    assert law.name == "speed"  # the lead to it: as if the force lagged by 80 ms
    assert law.value == pytest.approx(0.08, rel=0.15)
    # Beside so much that is unknown much is significant, and takes next to nothing of it
    assert found.final.diagnosis.significant
    for before, after in pairwise(found.ladder):
        fell = (before.fit.chi2 - after.fit.chi2) / (before.fit.chi2 - before.fit.dof)
        assert fell > 0.1


def test_a_parameter_at_a_bound_does_not_follow_the_rows_left_out():
    """A line whose slope a bound holds at zero: each reading is predicted by the others' mean."""
    rng, x = np.random.default_rng(1), np.linspace(-1, 1, 12)
    y, jacobian = rng.standard_normal(12), np.column_stack([np.ones(12), x])
    fit: Any = SimpleNamespace(
        at=SimpleNamespace(jacobian=jacobian, residual=y - y.mean()), u=np.zeros(2),
        covariance_names=("offset", "slope"), at_bound=("slope",),
        model=SimpleNamespace(
            space=SimpleNamespace(names=()),
            unknowns=SimpleNamespace(longest_step=lambda u: np.full(2, 9.0), slope=np.ones_like),
        ),
    )  # fmt: skip
    out = np.arange(12) < 3
    assert predicted_error(fit, out) == pytest.approx(y[out] - y[~out].mean())


def test_presses_left_out_are_those_of_a_fit_without_them(monkeypatch):
    table = planted(7, lambda d, f, t, phase, press: (d, f))
    at_the_minimum = replace(PRECISE, rounds=0, ftol=1e-8)
    model(table).mechanics.forget()  # with the bases of other tests the refit ends elsewhere
    fit = fit_jointly(model(table), TRUE, settings=at_the_minimum)
    out = table.press_index == 12
    rest = table.rows(~out)
    # The same model, fitted to the others only, predicts the press that was left out
    weights = model(table)
    other = fit_without(weights, out)
    at = weights.linearise(other)
    # in the noise of the fit, as predictions are: the slopes of the other change it by 0.3 %
    direct = (at.residual * at.sigma_m / fit.at.sigma_m)[out]
    assert predicted_error(fit, out) == pytest.approx(direct, abs=0.002 * np.abs(direct).max())
    assert len(rest.used()) == 528
    assert cross_validate(fit).ratio == pytest.approx(1, abs=0.15)
    # Too long a step for a linear prediction: the others are fitted anew, in shorter ones
    own = fit.at.residual[out]
    short = CrossValidationSettings(longest_step=0.2 * np.abs(other - fit.u).max(), ftol=1e-8)
    asked = []
    linearise = MeasurementModel.linearise
    monkeypatch.setattr(
        MeasurementModel, "linearise", lambda *a, **k: asked.append(a) or linearise(*a, **k)
    )
    again = predicted_error(fit, out, short)
    assert len(asked) > 5
    moved = np.abs(direct - own).max()
    assert again == pytest.approx(direct, abs=0.01 * moved)


def fit_without(whole, out):
    """Scaled unknowns of a fit that does not see the rows `out`."""
    from identify.optimize.gauss_newton import minimize_gauss_newton

    def residuals(u):
        at = whole.linearise(u)
        keep = (~out).astype(float)
        return keep * at.residual, -keep[:, None] * at.jacobian

    start = whole.start(TRUE)
    return minimize_gauss_newton(residuals, start, bounds=whole.bounds, ftol=1e-8).x


def test_the_problem_presses_where_it_says():
    assert len(points()) == 25
    assert timing(0)[3].max() == PEAK_N


@pytest.mark.parametrize(
    ("behind", "sized", "first"),
    [
        (8.0, True, "viscoelasticity"),
        (8.0, False, "side_creep"),  # whose size may be anything
        (12.0, True, "side_creep"),  # clearly worse
    ],
)
def test_of_forms_that_do_as_well_a_special_case_comes_first(behind, sized, first):
    """Nobody is told on which side a body creeps that may creep as a whole."""

    def candidate(name: str, criterion: float, sized: bool = True) -> Candidate:
        effect, key = CATALOGUE[name], f"{name}.g"
        model = SimpleNamespace(effects=(SimpleNamespace(effect=effect),))
        fit: Any = SimpleNamespace(model=model, values={key: 0.1}, std={key: 0.01 if sized else 1})
        return Candidate(name, criterion, criterion, fit)

    forms = candidate("viscoelasticity", 500 + behind, sized), candidate("side_creep", 500.0)
    assert ranked(forms)[0].name == first


@pytest.mark.parametrize(("price", "equal"), [(30.0, True), (50.0, False)])
def test_equal_chi_square_makes_an_equivalent_unless_the_price_decides(price, equal):
    """A Bayes factor of exp(-25) does."""
    fit: Any = SimpleNamespace(model=SimpleNamespace(effects=()))
    best = Candidate("force_warm_up", 500.0, 520.0, fit)
    other = Candidate("uneven_surface", 501.0, 520.0 + price, fit)
    effect = AcceptedEffect("force_warm_up", (best, other))
    assert ("uneven_surface" in effect.equivalents) == equal
    assert effect.decided == (not equal)


@pytest.mark.parametrize(("gain", "equal"), [(45.0, True), (35.0, False)])
def test_a_dearer_effect_that_gains_more_than_chance_is_an_equivalent(gain, equal):
    """A raised rim was "explained" by a force bias, 45 worse than a surface of 14 further terms."""

    def candidate(name: str, chi2: float, terms: int) -> Candidate:
        fit: Any = SimpleNamespace(model=SimpleNamespace(effects=()), u=np.zeros(6 + terms))
        return Candidate(name, chi2, chi2 + 7.5 * (6 + terms), fit)

    best, other = candidate("force_bias", 1760.0, 1), candidate("uneven_surface", 1760.0 - gain, 15)
    effect = AcceptedEffect("force_bias", (best, other))
    assert ("uneven_surface" in effect.equivalents) == equal
    assert effect.decided == (not equal)


def test_an_accepted_effect_that_is_behind_the_best_stands_in_its_own_group():
    """It leaves noise where a simpler form is cheaper: neither is then decided."""
    fit: Any = SimpleNamespace(model=SimpleNamespace(effects=()))
    best = Candidate("contact_offset", 560.0, 580.0, fit)
    between = Candidate("displacement_drift", 545.0, 600.0, fit)
    own = Candidate("uneven_surface", 500.0, 620.0, fit)
    effect = AcceptedEffect("uneven_surface", (own, best, between))
    assert effect.equivalents == ("uneven_surface", "contact_offset", "displacement_drift")
    assert not effect.decided


@pytest.mark.parametrize(("gain", "first"), [(35.0, "uneven_surface"), (20.0, "curved_surface")])
def test_a_form_that_contains_the_best_and_leaves_noise_comes_first_if_chance_gains_less(
    gain, first
):
    """By nine parameters, of which each costs 7 in the criterion: 28 has a p-value of 0.001."""

    def candidate(name: str, chi2: float) -> Candidate:
        effect = CATALOGUE[name]
        model = SimpleNamespace(effects=(SimpleNamespace(effect=effect),))
        fit: Any = SimpleNamespace(model=model, u=np.zeros(6 + len(effect.parameters)))
        return Candidate(name, chi2, chi2 + 7.0 * len(fit.u), fit)

    two = candidate("curved_surface", 1000.0), candidate("uneven_surface", 1000.0 - gain)
    assert leaving_noise(two, lambda fit: fit is two[1].fit)[0].name == first
    assert leaving_noise(two, lambda fit: True)[0].name == "curved_surface"
    assert leaving_noise(two, lambda fit: False)[0].name == "curved_surface"


@pytest.mark.parametrize(
    ("quiet", "criteria", "first"),
    [
        ({"b"}, (100.0, 101.0), "b"),  # as good, and the residual is noise beside it alone
        ({"a", "b"}, (100.0, 101.0), "a"),
        (set(), (100.0, 101.0), "a"),
        ({"b"}, (100.0, 120.0), "a"),  # clearly worse
    ],
)
def test_of_candidates_that_do_as_well_one_that_leaves_noise_comes_first(quiet, criteria, first):
    fits: Any = [SimpleNamespace(name=name, model=SimpleNamespace(effects=())) for name in "ab"]
    candidates = tuple(
        Candidate(fit.name, value, value, fit) for fit, value in zip(fits, criteria, strict=True)
    )

    def leaves_noise(fit: Any) -> bool:
        return fit.name in quiet

    ordered = leaving_noise(candidates, leaves_noise)
    assert ordered[0].name == first
    assert {c.name for c in ordered} == {"a", "b"}


@pytest.mark.slow
@pytest.mark.parametrize("of_left", [SELECTION.of_left, 2.0])
def test_a_small_third_cause_is_named_as_it_takes_what_the_others_left(of_left):
    """Were it said to mend the others' fit, whatever it takes, none of the three had a name."""
    press, time, phase, force = timing(6)
    body = true_compliance()[press] * force
    loop = np.where(phase == "unload", 0.6 * body * (1 - force / PEAK_N), 0)
    table = scan(body + 6e-4 + loop + 2e-4 * time / time[-1], force, 6)
    names = ("contact_offset", "hysteresis", "displacement_drift")
    found = forward_selection(
        model(table),
        TRUE,
        table,
        [CATALOGUE[name] for name in names],
        settings=replace(SELECTION, of_left=of_left),
    )
    assert {effect.name for effect in found.accepted} == set(names)
    chi2 = [step.fit.chi2 for step in found.ladder]
    assert chi2[-2] - chi2[-1] < SELECTION.of_mend * (chi2[0] - chi2[-1])
    named = of_left == SELECTION.of_left
    assert set(found.added) == (set(names) if named else set())
    assert found.verdict == ("explained" if named else "ambiguous")


def test_an_effect_that_raises_the_error_of_presses_left_out_is_not_added():
    """Here it falls to 0.68: not enough where a fall to a half is asked for."""
    press, _, _, force = timing(5)
    table = scan(true_compliance()[press] * force + 2e-4, force, 5)
    offset = [CATALOGUE["contact_offset"]]
    asked = replace(SELECTION, foretold_rise=0.5)
    found = [
        forward_selection(model(table), TRUE, table, offset, settings=settings)
        for settings in (SELECTION, asked)
    ]
    assert [answer.verdict for answer in found] == ["explained", "unexplained"]
    assert [answer.added for answer in found] == [("contact_offset",), ()]
    alone, with_it = (step.cross_validation.rms_m for step in found[0].ladder)
    assert 0.5 * alone < with_it < 0.8 * alone


def test_beside_a_first_step_of_laws_nothing_is_sought_unless_something_is_missing():
    press, _, _, force = timing(5)
    table = scan(true_compliance()[press] * force + 2e-4, force, 5)
    offset = [CATALOGUE["contact_offset"]]
    known = forward_selection(model(table), TRUE, table, offset)

    def from_laws(step, say):
        return known.final.fit, list(known.accepted)

    asked = []

    def nothing(*_):
        asked.append("proposed")
        return ()

    for goes_on in (False, True):
        policy = Policy(first=from_laws, propose=nothing, goes_on=lambda *_, on=goes_on: on)
        found = forward_selection(model(table), TRUE, table, offset, policy=policy)
        assert found.added == ("contact_offset",)
        assert asked == ["proposed"] * goes_on
