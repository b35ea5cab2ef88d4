"""Effects planted in a scan on finite elements and found again, the last check of the kit."""

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.contact_offset import ContactOffset
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.example_scan import trial
from identify.select.plant_and_recover import plant_and_recover

QUICK = {"contact_offset", "force_bias", "viscoelasticity", "tool_compliance", "skin_layer"}


@pytest.mark.parametrize(
    "effect",
    [pytest.param(e, marks=() if e.name in QUICK else pytest.mark.slow) for e in CATALOGUE],
    ids=lambda effect: effect.name,
)
def test_a_built_in_effect_is_found_where_it_was_planted(effect):
    said = plant_and_recover(effect, trial())
    redundant = "under a contact of fixed size it is what force_bias is"
    assert ("found" in said) is (effect.name != "touch_threshold")
    assert "not planted" not in said or redundant in said


class Forgetful(ContactOffset):
    """Acts on a random half of the readings, another one at each call."""

    rng = np.random.default_rng(0)

    def reading(self, readings, force_n, travel_m, *, offset_m):
        return travel_m + offset_m * self.rng.integers(0, 2, len(travel_m))


def test_an_effect_that_does_not_come_back_is_at_fault():
    with pytest.raises(Fault, match=r"planted .*offset_m"):
        plant_and_recover(Forgetful(), trial())
