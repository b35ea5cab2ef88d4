"""The misfit in words: an error in length that rises, and presses that no map meets."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np

from identify.catalogue import CATALOGUE
from identify.measurement import EffectInModel
from palpmap.result.caveats import starts_beyond
from palpmap.result.explain_words import unreliable, verdict_detail
from palpmap.result.misfit_words import few_presses_words, other_map_sentence, rise_note
from palpmap.result.presses_words import first_readings_sentence
from palpmap.result.records import OtherMapRecord


def step(rms_m: float, chi2: float, noise_m: float, *names: str) -> Any:
    """A step of 100 degrees of freedom."""
    fit = SimpleNamespace(rms_m=rms_m, chi2=chi2, chi2_per_dof=chi2 / 100, effect_names=names)
    return SimpleNamespace(fit=fit, comparison=SimpleNamespace(expected_rms_m=noise_m))


def test_a_better_fit_with_a_larger_error_in_length_says_why():
    before = step(187e-6, 3200.0, 40e-6)
    (note,) = rise_note(before, step(249e-6, 800.0, 61e-6, "strain_stiffening"))
    assert "from 187 µm to 249 µm" in note
    assert "from 5.66 to 2.83 times its noise" in note
    assert "61 µm after 40 µm" in note
    (other,) = rise_note(before, step(249e-6, 800.0, 40e-6, "strain_stiffening"))
    assert "hides most" in other
    assert rise_note(before, step(150e-6, 800.0, 61e-6, "strain_stiffening")) == []
    assert rise_note(before, step(249e-6, 4000.0, 61e-6, "strain_stiffening")) == []


def few_of_twenty(kept: float, on_any_body: float | None = None) -> str:
    """Two hard presses of twenty keep a share of their misfit with a stiffness of their own.

    Another share they keep on any body, under a ball.
    """
    press = np.repeat(np.arange(20), 10)
    residual = np.where(np.isin(press, (3, 11)), 5.0, 1.0)
    squares = np.full(20, 10.0)
    squares[[3, 11]] += kept * 240.0
    least = None
    if on_any_body is not None:
        least = np.full(20, 10.0)
        least[[3, 11]] += on_any_body * 240.0
    law = SimpleNamespace(by_press=(squares, np.full(20, 10)), on_any_body=least)
    compliance = np.where(np.isin(np.arange(20), (3, 11)), 0.25, 1.0)
    fit = SimpleNamespace(
        press_index=press, chi2=float(residual @ residual), dof=200,
        at=SimpleNamespace(residual=residual, compliance=compliance),
    )  # fmt: skip
    presses = [SimpleNamespace(press=100 + j) for j in range(20)]
    return few_presses_words(SimpleNamespace(  # pyright: ignore[reportArgumentType]
        final=SimpleNamespace(fit=fit, comparison=SimpleNamespace(presses=presses)),
        in_few_presses=(3, 11), accepted=[SimpleNamespace(name="touch_threshold", law=law)],
    ))  # fmt: skip


def test_few_presses_that_no_map_meets_are_told():
    says = few_of_twenty(0.9)
    assert "100 % of it, where the body is 4.0 times as hard" in says
    assert "90 % of their misfit remains beside touch_threshold: no map takes it" in says
    assert "no map" not in few_of_twenty(0.3)
    assert (
        "a stiffness and a growth of the contact of its own, 80 % of their misfit remains beside "
        "touch_threshold: no map takes it"
    ) in few_of_twenty(0.9, 0.8)
    assert "the residual of all others is no larger than the noise." in says


def test_few_presses_that_a_sharper_map_would_meet_are_no_other_physics():
    says = few_of_twenty(0.9, 0.1)
    assert "no map" not in says
    assert "leaves 90 % of their misfit beside touch_threshold" in says
    assert "the growing contact leaves 10 %: the body may be hard or soft close below" in says


def test_a_free_map_that_is_too_smooth_leaves_the_question_of_another_map_open():
    tried = {"answer": "undecided", "chi2_per_dof": 2.0, "left": 0.6, "effects": ("play",)}
    says = other_map_sentence(OtherMapRecord(**tried, map_error=0.0, more_evidence=3.0))
    assert "beside play, a free map, which is smooth below a contact, leaves 60 %" in says
    without = other_map_sentence(OtherMapRecord(**tried, map_error=0.0, more_evidence=None))
    assert "the search for a free map did not end." in without


def test_where_few_presses_hold_the_structure_the_map_is_doubtful_under_them_alone():
    records: list[Any] = [SimpleNamespace(few_presses=few) for few in ((), (3, 7))]
    said = [unreliable(record) for record in records]
    assert said[0].startswith("Not to be relied on")
    assert said[1].startswith("Parameters and map come from the other presses")


def test_the_first_readings_tell_the_force_from_which_travel_counts():
    press, travel = np.repeat(np.arange(50), 5), np.tile(np.linspace(0.0, 3e-3, 5), 50)
    noise = 0.012 * np.random.default_rng(0).standard_normal(250)

    def said(travel_m: np.ndarray) -> str:
        used = SimpleNamespace(
            press_index=press, displacement_m=travel_m, force_n=0.085 + 200 * travel + noise
        )
        scan: Any = SimpleNamespace(used=lambda: used)
        return first_readings_sentence(scan)

    assert "median of 50 presses" in said(travel)
    found = float(said(travel).split("have ")[1].split(" mN")[0])
    assert abs(found - 85) < 3 * 1.25 * 12 / np.sqrt(50)
    assert said(travel + 1e-3) == ""


def test_a_start_beyond_what_a_scan_bears_is_said_and_one_within_it_is_not():
    creep = CATALOGUE["local_creep"]
    low, high = np.zeros(3), np.array([0.1, 0.1, 0.05])
    bounds = [
        replace(p, lower=0.0, upper=float(high["xyz".index(p.name[0])]))
        if p.name in ("x_m", "y_m", "z_m")
        else p
        for p in creep.parameters
    ]
    assert "x_m" in [p.name for p in bounds]
    part = EffectInModel(creep, tuple(bounds), {})
    for x_m, said in ((1.05, False), (1.2, True)):  # in a frame whose origin lies 1 m off
        study: Any = SimpleNamespace(
            effects=[SimpleNamespace(name=creep.name, initial={"x_m": x_m})]
        )
        sentences = list(starts_beyond([part], study, low + 1.0))
        assert len(sentences) == said
    assert sentences[0].startswith(
        "The search for local_creep began at x_m = 1.1, as the study's 1.2"
    )


def test_an_effect_of_free_shape_is_said_to_name_a_shape_and_no_cause():
    def said(*added: str) -> str:
        noise = SimpleNamespace(is_noise=True, p_value=0.5, alpha=0.01)
        explained: Any = SimpleNamespace(
            apart=None, added=added, verdict="explained", effect=CATALOGUE.__getitem__,
            final=SimpleNamespace(comparison=noise),
        )  # fmt: skip
        return verdict_detail(explained)

    assert said("hysteresis") == "With hysteresis in the model, the residual is noise."
    loop = said("free_loop", "time_lag")
    assert "free_loop has a free shape" in loop
    assert "such as a tip that sticks" in loop
    assert said("free_saturation").endswith("whatever goes so may be the cause.")
