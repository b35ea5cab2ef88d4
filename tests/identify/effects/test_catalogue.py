"""The catalogue: every built-in effect keeps to the kit, and its words can be read."""

import re

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.effects.base import LINKS
from identify.effects.conformance.kit import check_effect, failures
from models.errors import InputError

NAMES = (
    "viscoelasticity", "finite_strain", "strain_stiffening", "anisotropy", "skin_layer",
    "extra_inclusion", "stiffness_gradient", "poisson_ratio", "preconditioning", "hysteresis",
    "spherical_tip", "base_compliance", "base_sliding", "tool_compliance", "force_bias",
    "force_drift", "force_saturation", "contact_offset", "surface_tilt", "breathing", "mesh_error",
    "touch_threshold", "rigid_tip", "inclusion_edge", "inclusion_stretch", "side_gradient",
    "body_shift", "sensitivity_drift", "displacement_drift", "time_lag", "force_warm_up",
    "force_wander", "displacement_wander", "two_time_creep", "power_law_creep", "play",
    "breathing_from_touch", "local_creep", "free_loop", "guide_friction", "backlash", "force_jump",
    "displacement_jump", "several_plays", "preconditioning_nearby", "breathing_harmonics",
    "breathing_harmonics_from_touch", "creep_recovery", "breathing_drifting",
    "sensitivity_wander", "free_stiffening", "free_saturation", "side_creep",
    "curved_surface", "uneven_surface", "surface_bump", "free_preconditioning",
    "filtered_force",
)  # fmt: skip


def test_the_catalogue_holds_the_effects_that_studies_may_name():
    assert sorted(effect.name for effect in CATALOGUE) == sorted(NAMES)


def test_effects_stand_in_the_order_of_the_chain():
    links = list(dict.fromkeys(LINKS.values()))
    places = [(links.index(effect.link), effect.order) for effect in CATALOGUE]
    assert places == sorted(places)
    beyond = [place for place in places if place[0] != links.index("body")]
    assert len(set(beyond)) == len(beyond)


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_a_built_in_effect_keeps_to_the_kit(effect):
    assert failures(check_effect(effect)) == []


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_a_summary_has_two_sentences_and_a_class_the_name_of_its_file(effect):
    sentences = re.findall(r"[^.]+\.(?:\s|$)", effect.summary)
    assert len(sentences) == 2
    camel = "".join(word.capitalize() for word in effect.name.split("_"))
    assert type(effect).__name__ == camel
    assert type(effect).__module__ == f"identify.catalogue.{effect.name}"


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_what_an_effect_contains_exists(effect):
    assert set(effect.contains) <= set(NAMES) - {effect.name}


@pytest.mark.parametrize("effect", CATALOGUE, ids=lambda effect: effect.name)
def test_a_family_bears_the_name_of_its_simplest_effect_and_keeps_to_one_link(effect):
    assert effect.family in NAMES
    assert CATALOGUE[effect.family].family == effect.family
    assert CATALOGUE[effect.family].link == effect.link
    base = type(effect).__mro__[1]
    assert effect.family == getattr(base, "family", effect.family)


def test_effects_that_can_only_go_one_way_are_known():
    one_sided = {effect.name for effect in CATALOGUE if effect.one_sided}
    assert one_sided == {
        "viscoelasticity", "preconditioning", "hysteresis", "spherical_tip", "strain_stiffening",
        "base_compliance", "base_sliding", "tool_compliance", "force_saturation",
        "touch_threshold", "rigid_tip", "power_law_creep", "play", "local_creep",
        "preconditioning_nearby", "creep_recovery", "side_creep", "filtered_force",
    }  # fmt: skip


def test_an_effect_is_found_by_its_name():
    assert CATALOGUE["breathing"].title == "Breathing"


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        ("viscoelastic", "did you mean 'viscoelasticity'"),
        ("Tool-Compliance", "did you mean 'tool_compliance'"),
        ("qqq", "there are: extra_inclusion, inclusion_edge"),
    ],
)
def test_a_wrong_name_is_answered_with_the_nearest_right_one(wrong, says):
    with pytest.raises(InputError, match=re.escape(says)):
        CATALOGUE[wrong]


def test_the_surface_tilt_contains_the_contact_offset():
    # Nested models are compared otherwise than others: the larger one must give the smaller.
    from identify.effects.conformance.example_scan import trial

    own = trial()
    tilt, offset = CATALOGUE["surface_tilt"], CATALOGUE["contact_offset"]
    tilted = own.out(tilt, {"offset_m": 2e-4, "slope_x": 0.0, "slope_y": 0.0})
    assert np.array_equal(tilted, own.out(offset, {"offset_m": 2e-4}))
    assert tilt.contains == ("contact_offset",)


@pytest.mark.parametrize("name", ["force_jump", "displacement_jump"])
def test_a_jump_leaves_three_presses_on_either_side(name):
    """One before all presses would be an offset, and never be told from it."""
    from identify.effects.conformance.example_scan import trial

    case = trial()
    _, at = CATALOGUE[name].bounded(case.readings, case.state)
    first = case.readings.elapsed_s[case.readings.first]
    for instant, before in ((at.lower, 3), (at.upper, len(first) - 3)):
        assert np.sum(first < instant) == before
    instants = [shape["at_s"] for shape in CATALOGUE[name].grid(case.readings, case.state)]
    assert at.lower < min(instants)
    assert max(instants) < at.upper
