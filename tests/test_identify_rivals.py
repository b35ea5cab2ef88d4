"""Which refitted effects may be added: those whose expected travel fits better, not whose noise."""

import pytest
from loop_problem import PEAK_N, TRUE, model, scan, timing, true_compliance

from identify.effects.catalogue import CATALOGUE, effect_named
from identify.effects.contact_offset import ContactOffset
from identify.joint_fit import fit_jointly
from identify.rivals import borne_out, compare_rivals, fit_with
from identify.rung import rung_of

LOSS, SHARPNESS, SEED = 0.02, 8.0, 4


@pytest.fixture(scope="module")
def saturated():
    """A rung of the map alone, of a scan whose sensor loses 2 % at its largest force."""
    press, _, _, force = timing(SEED)
    read = force * (1 - LOSS * (force / PEAK_N) ** SHARPNESS)
    table = scan(true_compliance()[press] * force, read, SEED)
    return rung_of(fit_jointly(model(table), TRUE), table, CATALOGUE, 0, lambda text: None)


def test_a_law_that_passes_more_noise_on_is_a_rival_if_it_is_right(saturated):
    effect = effect_named("force_saturation")
    fit = fit_with(saturated.fit, effect, saturated.diagnosis["force_saturation"])
    assert fit is not None
    assert fit.chi2 < saturated.fit.chi2 - 20
    assert fit.rms_m > 1.002 * saturated.fit.rms_m  # at the forces as they were read
    assert borne_out(saturated.fit, fit) == pytest.approx(1, abs=0.3)
    rivals = compare_rivals(saturated, {e.name: e for e in CATALOGUE}, lambda text: None)
    assert rivals[0].name == "force_saturation"


class Sawtooth(ContactOffset):
    """Wrong, but so steep in the force that its noise would excuse any misfit."""

    name = "sawtooth"

    def reading(self, readings, force_n, travel_m, values):
        return travel_m + values["offset_m"] * (force_n / 1e-3 % 1 - 0.5)


def test_a_law_that_only_allows_more_noise_is_not_borne_out(saturated):
    before = saturated.fit
    steep = before.model.with_effect(Sawtooth(), {"offset_m": 2e-5}, before.at.state)
    after = fit_jointly(steep, before.map, rounds=0, max_evaluations=1)
    assert after.chi2 < 0.9 * before.chi2
    assert borne_out(before, after) < 0.1
