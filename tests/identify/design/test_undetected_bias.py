"""What an effect too small to be seen does to the map: foretold from the fit, and then done."""

from dataclasses import replace

import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.design.detection_limits import Limit, detection_limits
from identify.design.settings import DETECTION
from identify.design.undetected_bias import UndetectedBias, undetected_biases
from identify.fit.joint_fit import fit_jointly
from identify.fit.settings import SEARCH
from tests.identify.select.loop_problem import TRUE, model, scan, timing, uncorrected

SHARE = DETECTION.bias_share
# A depth moves by an eighth of its standard error, a search ends within a seventh
TO_ITS_END = replace(SEARCH, ftol=1e-5, rtol=0.0)


def limit(name: str, share: float | None, most: float | None = None, **bias: float) -> Limit:
    return Limit(name, share, {}, 0.1, (), bias, largest_share=most)


def test_the_largest_shift_is_that_of_the_limit_or_of_three_percent_if_that_is_less():
    found = undetected_biases(
        [
            limit("easily_seen", SHARE / 10, background_pa=-400.0, weight_pa=9000.0),
            limit("hardly_seen", 3 * SHARE, background_pa=-70.0, weight_pa=300.0),
            limit("untestable", None),
            limit("never_seen", None, SHARE / 2, z_m=4e-3),
        ]
    )
    assert found == {
        "background_pa": UndetectedBias(70.0, "hardly_seen", SHARE),
        "weight_pa": UndetectedBias(900.0, "easily_seen", SHARE / 10),
        "z_m": UndetectedBias(2e-3, "never_seen", SHARE / 2),  # as much of it as there can be
    }
    assert not undetected_biases([limit("never_seen", None)])


@pytest.mark.parametrize("name", ["tool_compliance", "contact_offset"])
def test_an_effect_too_small_to_be_seen_moves_the_map_as_foretold(name):
    press, _, _, force = timing(0)
    body = uncorrected()
    table = scan(body.evaluate(TRUE, body.state()).compliance[press] * force, force, 0)
    fit = fit_jointly(model(table, body), TRUE, settings=TO_ITS_END)
    (own,) = detection_limits(fit, [effect for effect in CATALOGUE if effect.name == name])
    foretold = undetected_biases([own])
    share = foretold["background_pa"].share
    assert own.smallest_share is not None
    assert share == min(own.smallest_share, SHARE)
    size = next(iter(own.sizes.values())) * share / own.smallest_share
    # By formulas of this test: a spring in series, and a first touch that is declared late
    added = size * force if name == "tool_compliance" else -size
    planted = replace(table, displacement_m=table.displacement_m + added)
    moved = fit_jointly(model(planted, body), fit.map, settings=TO_ITS_END)
    for parameter in ("background_pa", "inclusion_1.weight_pa", "inclusion_1.z_m"):
        done = abs(moved.values[parameter] - fit.values[parameter])
        assert done == pytest.approx(foretold[parameter].shift, rel=0.4), parameter
    # More than what the scan's own interval counts
    assert foretold["background_pa"].shift > fit.std["background_pa"]
