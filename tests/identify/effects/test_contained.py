"""A free form contains the effects that it names as its special cases."""

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.catalogue.contained import contains_its_special_cases
from identify.effects.conformance.checks import Fault
from identify.effects.conformance.example_scan import trial

FREE = [effect for effect in CATALOGUE if effect.contains]


@pytest.mark.parametrize("effect", FREE, ids=lambda effect: effect.name)
def test_a_built_in_free_form_contains_its_special_cases(effect):
    says = contains_its_special_cases(effect, trial())
    assert all(name in says for name in effect.contains)


def test_an_effect_without_special_cases_passes():
    says = contains_its_special_cases(CATALOGUE["contact_offset"], trial())
    assert says == "contains no built-in effect"


class Narrow(type(CATALOGUE["force_warm_up"])):
    """A warm-up that claims to contain a loop in the force."""

    name = "narrow"
    family = "force_drift"
    contains = ("guide_friction",)


class Elsewhere(type(CATALOGUE["contact_offset"])):
    """An offset of the displacement that claims to be a form of creep."""

    name = "elsewhere"
    family = "viscoelasticity"


@pytest.mark.parametrize(("kind", "says"), [(Narrow, "cosine"), (Elsewhere, "different causes")])
def test_a_wrong_claim_is_a_fault(kind, says):
    with pytest.raises(Fault, match=says):
        contains_its_special_cases(kind(), trial())


def test_the_course_of_a_straight_drift_lies_in_the_spline():
    case, wander = trial(), CATALOGUE["force_wander"]
    line = {p.name: 1e-3 * (i + 1) for i, p in enumerate(wander.parameters)}
    end = float(case.readings.elapsed_s.max())
    straight = CATALOGUE["force_drift"]
    np.testing.assert_allclose(
        case.out(wander, line), case.out(straight, {"rate_n_per_s": 5e-3 / end}), atol=1e-12
    )
