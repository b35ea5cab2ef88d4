"""A large effect that is missing misfits as grossly as a wrong map; a bound holds no residual."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.contact_offset import ContactOffset
from identify.fit.joint_fit import fit_jointly
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.residual.compare import compare_residual
from identify.residual.whitened import whitened
from identify.select import explain, explanation, forward_selection, model_error, outlying_presses
from identify.select.first_step import with_exact_map
from identify.select.settings import SELECTION
from identify.select.start_fit import StartFit
from identify.select.step import whitened_fit
from models import Catalogue
from tests.identify.select.loop_problem import TRUE, mechanics, model, scan, timing

NAMES = ("breathing", "hysteresis", "contact_offset")


def begun(rough: float) -> StartFit:
    """Return the start of a breathing body whose presses have compliances off by `rough`."""
    press, time, _, force = timing(7)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    off = np.exp(rough * np.random.default_rng(3).standard_normal(len(compliance)))
    moved = 6e-4 * np.sin(2 * np.pi * 0.31 * time)
    table = scan((compliance * off)[press] * force + moved, force, 7)
    known = replace(model(table), press_error=0.05)
    told: Any = SimpleNamespace(scan=table, say=lambda text: None)
    fit = fit_jointly(known, TRUE)
    return StartFit(told, Catalogue(CATALOGUE[n] for n in NAMES), fit, known, TRUE, presses(30.0))


def presses(chi2_per_dof: float) -> Any:
    """Return a law of the presses alone that calls for no effect."""
    found = SimpleNamespace(chi2_per_dof=chi2_per_dof)
    return SimpleNamespace(names=(), partial=None, found=found)


@pytest.fixture(scope="module")
def breathing():
    start = begun(rough=0.0)
    return start, with_exact_map(start, 0, SELECTION)


def test_a_large_effect_is_found_where_the_map_was_thought_to_be_wrong(breathing):
    start, found = breathing
    explained, exact = found
    assert explained.ladder[0].fit.chi2_per_dof > max(25, start.fit.chi2_per_dof)
    assert (explained.verdict, explained.added) == ("explained", ("breathing",))
    assert exact.model.press_error == explained.map_error == 0.0
    assert explained.final.fit.values["breathing.frequency_hz"] == pytest.approx(0.31, abs=1e-3)


def test_without_an_effect_that_takes_half_of_the_misfit_none_is_sought(breathing):
    start, _ = breathing
    fewer = replace(start, catalogue=Catalogue(CATALOGUE[n] for n in NAMES[1:]))
    assert with_exact_map(fewer, 0, SELECTION) is None
    all_of_it = replace(SELECTION, elsewhere=1.1)
    assert with_exact_map(start, 0, all_of_it) is None


def test_where_the_presses_alone_are_met_the_map_is_wrong_and_no_effect_is_sought(breathing):
    start, _ = breathing
    assert with_exact_map(replace(start, law=presses(9.0)), 0, SELECTION) is None


@pytest.mark.slow
def test_beside_a_map_that_is_wrong_as_well_nothing_is_named():
    start = begun(rough=0.05)
    assert with_exact_map(start, 0, SELECTION) is None


class HalfAnOffset(ContactOffset):
    """An offset of which half of what the scan asks for is possible."""

    parameters = (replace(ContactOffset.parameters[0], lower=-5e-5, upper=5e-5),)


def test_what_lies_beyond_a_bound_of_the_search_is_left_in_the_residual():
    press, _, _, force = timing(4)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    table = scan(compliance[press] * force - 1e-4, force, 4)
    plain = model(table)
    held = plain.with_effect(HalfAnOffset(), {"offset_m": -4e-5}, plain.mechanics.state())
    fit = fit_jointly(held, TRUE)
    assert fit.at_bound == ("contact_offset.offset_m",)
    absorbed = whitened_fit(fit, table).absorbed
    assert absorbed.shape[1] == whitened(fit, table).absorbed.shape[1] == len(fit.u) - 1
    for tested in (whitened_fit(fit, table), whitened(fit, table)):
        assert not compare_residual(tested).is_noise


def ladder(*chi2: float, names: tuple[str, ...]) -> Any:
    """Steps with one effect of the catalogue more each."""
    return [
        SimpleNamespace(
            fit=SimpleNamespace(
                chi2=one,
                effect_names=names[:count],
                model=SimpleNamespace(
                    effects=[SimpleNamespace(effect=CATALOGUE[n]) for n in names[:count]]
                ),
            )
        )
        for count, one in enumerate(chi2)
    ]


@pytest.mark.parametrize(
    ("chi2", "names", "pressed", "residues"),
    [
        ((9000, 955, 834), ("side_gradient", "anisotropy"), "", ("anisotropy",)),
        ((9000, 1100, 834), ("side_gradient", "anisotropy"), "", ()),  # 3.3 %
        ((9000, 955, 834), ("contact_offset", "anisotropy"), "", ()),  # an offset has one form
        ((9000, 955, 834), ("side_gradient", "force_drift"), "", ()),
        ((9000, 955, 834), ("side_gradient", "anisotropy"), "anisotropy", ()),
        ((9000, 834), ("anisotropy",), "", ()),
    ],
)
def test_a_trace_beside_an_effect_of_the_body_may_be_of_its_form(chi2, names, pressed, residues):
    accepted: Any = [SimpleNamespace(name=n, shown_by_presses=n == pressed) for n in names]
    steps = ladder(*chi2, names=names)
    assert model_error.residues(steps, accepted, SELECTION) == residues


@pytest.mark.parametrize(
    ("held", "doubted"),
    [
        (("inclusion_1.x_m",), ("side_gradient",)),
        (("inclusion_2.y_m", "inclusion_1.z_m"), ("side_gradient",)),
        (("inclusion_1.z_m", "inclusion_1.weight_pa"), ()),  # a shallow one, or a rigid one
        (("body_shift.x_m",), ()),
        ((), ()),
    ],
)
def test_an_inclusion_at_a_side_of_the_body_stands_for_another_cause(held, doubted):
    names = ("side_gradient", "force_drift")
    (step,) = ladder(1.0, names=names)[-1:]
    fit: Any = step.fit
    fit.at_bound, fit.map = held, GaussianMap(1.0, (Inclusion(1, 0, 0, 0, 1),) * 2)
    fit.model.effects = [SimpleNamespace(effect=CATALOGUE[n]) for n in names]
    accepted: Any = [SimpleNamespace(name=n, shown_by_presses=False) for n in names]
    assert model_error.beside_edge(fit, accepted) == doubted


def test_the_answer_of_explain_is_the_one_beside_the_exact_map(breathing, monkeypatch):
    asked: list[Any] = []
    monkeypatch.setattr(outlying_presses, "without_suspects", lambda start, *_: asked.append(start))
    start, _ = breathing
    steps: list[Any] = []
    explained, _, answered = explain(start, on_step=steps.append)
    assert explained.added == ("breathing",)
    assert asked == [answered]
    assert answered.model.press_error == 0.0
    assert steps == list(explained.ladder)


@pytest.mark.parametrize("doubt", ["beside_edge", "residues"])
def test_an_effect_whose_form_is_in_doubt_is_not_named_alone(doubt, monkeypatch):
    press, _, _, force = timing(4)
    compliance = mechanics().evaluate(TRUE, mechanics().state()).compliance
    table = scan(compliance[press] * force - 1e-4, force, 4)
    for module in (explanation, forward_selection):
        monkeypatch.setattr(module, doubt, lambda *_: ("contact_offset",))
    found = forward_selection.forward_selection(model(table), TRUE, table, [ContactOffset()])
    assert (found.verdict, found.added) == ("ambiguous", ())
    assert found.ambiguous == (("contact_offset", explanation.OTHER_CAUSE),)
