"""Which refitted effects may be added: those whose expected travel fits better, not whose noise."""

from dataclasses import replace

import numpy as np
import pytest

from fem import PalpationModel, RefinedModel, block_mesh
from identify.body.correction import Corrections
from identify.body.mechanics import BodyMechanics
from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.contact_offset import ContactOffset
from identify.fit.joint_fit import fit_jointly, try_fit
from identify.select import candidates as candidates
from identify.select.candidates import (
    compare_candidates,
    fit_with,
    predicted_share,
    refit_further,
    shortlist,
)
from identify.select.score_test import fitted_basis, score_effect
from identify.select.settings import SELECTION
from identify.select.step import step_of
from tests.identify.select.loop_problem import (  # fmt: skip
    NOISE,
    NU,
    PEAK_N,
    SIZE,
    TRUE,
    contacts,
    mechanics,
    model,
    scan,
    timing,
    true_compliance,
)

LOSS, SHARPNESS, SEED = 0.02, 8.0, 4


LAWS = [
    CATALOGUE[name]
    for name in (
        "force_saturation", "strain_stiffening", "finite_strain", "spherical_tip", "force_bias",
        "contact_offset", "hysteresis", "skin_layer",
    )
]  # fmt: skip
"""Effects whose travel grows with the force in another way than its own."""


@pytest.fixture(scope="module")
def saturated():
    """A step of the map alone, of a scan whose sensor loses 2 % at its largest force."""
    press, _, _, force = timing(SEED)
    read = force * (1 - LOSS * (force / PEAK_N) ** SHARPNESS)
    table = scan(true_compliance()[press] * force, read, SEED)
    return step_of(fit_jointly(model(table), TRUE), table, LAWS, 0, lambda text: None)


@pytest.mark.slow
def test_a_law_that_passes_more_noise_on_is_a_rival_if_it_is_right(saturated):
    effect = CATALOGUE["force_saturation"]
    fit = fit_with(saturated.fit, effect, saturated.diagnosis["force_saturation"])
    assert fit is not None
    assert fit.chi2 < saturated.fit.chi2 - 20
    assert fit.rms_m > 1.002 * saturated.fit.rms_m  # at the forces as they were read
    assert predicted_share(saturated.fit, fit) == pytest.approx(1, abs=0.3)
    candidates = compare_candidates(
        saturated, {e.name: e for e in LAWS}, str, shortlist(saturated.diagnosis)
    )
    assert candidates[0].name == "force_saturation"


class Sawtooth(ContactOffset):
    """Wrong, but so steep in the force that its noise would excuse any misfit."""

    name = "sawtooth"

    def reading(self, readings, force_n, travel_m, *, offset_m):
        return travel_m + offset_m * (force_n / 1e-3 % 1 - 0.5)


def test_a_law_that_only_allows_more_noise_has_no_predicted_share(saturated):
    before = saturated.fit
    steep = before.model.with_effect(Sawtooth(), {"offset_m": 2e-5}, before.at.state)
    after = fit_jointly(steep, before.map, rounds=0, max_evaluations=1)
    assert after.chi2 < 0.9 * before.chi2
    assert predicted_share(before, after) < 0.1


@pytest.mark.slow
def test_a_refit_from_beyond_where_a_law_levels_off_begins_again_nearer():
    compliance = 8e-6  # m/Pa of a base that slides
    pair = [
        PalpationModel(block_mesh(SIZE, n, split="alternating"), NU, contacts())
        for n in ((6, 6, 4), (10, 10, 6))
    ]
    body = RefinedModel(*pair)
    modulus = TRUE.modulus(body.points_m)
    felt = body.evaluate(modulus, support_compliance=(0.0, compliance)).compliance
    press, _, _, force = timing(3)
    fit = fit_jointly(model(scan(felt[press] * force, force, 3)), TRUE)
    effect = CATALOGUE["base_sliding"]
    (amplitude,) = effect.amplitudes
    far = {amplitude.name: 10 * compliance}
    lost = try_fit(
        fit.model.with_effect(effect, far, fit.at.state), fit.map, rounds=0, max_evaluations=15
    )
    assert lost is not None
    assert lost.values[f"base_sliding.{amplitude.name}"] < 1e-9
    score = replace(score_effect(fit, effect, fitted_basis(fit.at)), values=far)
    found = fit_with(fit, effect, score)
    assert found is not None
    assert found.chi2 < lost.chi2 - 0.5 * score.statistic


def test_a_rival_that_is_far_behind_is_not_refitted_to_the_end(monkeypatch):
    press, _, _, force = timing(SEED)
    late = scan(true_compliance()[press] * force + 10 * NOISE.displacement_m, force, SEED)
    effects = {name: CATALOGUE[name] for name in ("contact_offset", "inclusion_edge")}
    step = step_of(fit_jointly(model(late), TRUE), late, [*effects.values()], 0, lambda text: None)
    refits = []

    def counted(tried, *rest, **options):
        refits.append(tried.effects[-1].effect.name)
        return try_fit(tried, *rest, **options)

    monkeypatch.setattr(candidates, "try_fit", counted)
    compare_candidates(step, effects, str, ["inclusion_edge"])
    assert len(refits) > 1
    refits.clear()
    best, beaten = compare_candidates(step, effects, str, ["contact_offset", "inclusion_edge"])
    assert (best.name, beaten.name) == ("contact_offset", "inclusion_edge")
    assert beaten.chi2 > best.chi2 + 200
    assert refits.count("inclusion_edge") == 1


@pytest.mark.parametrize(
    "moved",
    [
        {"inclusion_1.weight_pa": 20e3},
        {"inclusion_1.x_m": 0.031},
        {"inclusion_1.radius_m": 0.006, "inclusion_1.weight_pa": 25e3},
    ],
)
def test_the_doubt_of_a_carried_correction_covers_its_error(moved):
    own = mechanics()
    state, there = own.state(), TRUE.changed(moved)
    coarse = own.evaluate(there, state).compliance / own.evaluate(there, state)._scale
    off = own.correction_off(there, state, coarse)
    exact = replace(own, _corrections=Corrections()).corrected(there, state)
    error = np.log(exact.evaluate(there, state).compliance / own.evaluate(there, state).compliance)
    assert off is not None
    assert np.linalg.norm(error) < SELECTION.correction_doubt * np.linalg.norm(off)
    assert np.linalg.norm(off) < 10 * np.linalg.norm(error)


def test_a_fit_that_no_correction_brings_near_the_best_is_not_refitted(monkeypatch, saturated):
    fit = fit_with(saturated.fit, CATALOGUE["force_bias"], saturated.diagnosis["force_bias"])
    assert fit is not None
    assert fit.success
    tried, settings = [], replace(SELECTION, far_map=0.0)
    monkeypatch.setattr(candidates, "refit", lambda model, *_, **__: tried.append(model))

    def further(behind: float) -> int:
        tried.clear()
        assert refit_further(fit, saturated.fit, fit.chi2 - behind, settings) is fit
        return len(tried)

    assert further(5.0) == 1
    assert further(150.0) == 0
    doubt = 0.03 * (-1.0) ** np.arange(25)  # as a correction may be off that was made elsewhere
    monkeypatch.setattr(BodyMechanics, "correction_off", lambda *_: doubt)
    assert further(150.0) == 1
    monkeypatch.setattr(BodyMechanics, "correction_off", lambda *_: None)
    assert further(150.0) == 1
