"""95 % intervals of a joint fit follow the valley of depth and weight, effects fitted along."""

from dataclasses import replace

import numpy as np
import pytest
from loop_problem import TRUE, model, scan, timing, true_compliance

from identify.effects.catalogue import CATALOGUE
from identify.intervals import NORMAL_95
from identify.joint_fit import fit_jointly
from identify.joint_intervals import joint_intervals

OFFSET_M = 1.5e-4


@pytest.fixture(scope="module")
def fit():
    press, _, _, force = timing(7)
    own = model(scan(true_compliance()[press] * force + OFFSET_M, force, 7))
    offset = next(effect for effect in CATALOGUE if effect.name == "contact_offset")
    return fit_jointly(
        own.with_effect(offset, {"offset_m": OFFSET_M}, own.mechanics.state()), TRUE, rounds=0
    )


@pytest.fixture(scope="module")
def found(fit):
    return joint_intervals(fit)


@pytest.mark.parametrize("side", [0, 1])
@pytest.mark.parametrize("name", ["inclusion_1.weight_pa", "inclusion_1.z_m"])
def test_chi_square_rises_by_3_84_at_the_ends(fit, found, name, side):
    """The likelihood's own profile, by another way: the parameter is taken out of the free ones."""
    at = fit.model.names.index(name)
    space = fit.model.space
    free = tuple(i for i in space.free if space.start.names[i] != name)
    end = space.to_scaled(fit.map.changed({name: found[name][side]}))[at]
    u = fit.u + fit.covariance[:, at] / fit.covariance[at, at] * (end - fit.u[at])
    held = fit.model.map(u)
    fixed = replace(fit.model, space=replace(space, start=held, free=free)).started(
        np.delete(u, at)
    )
    again = fit_jointly(fixed, held, rounds=0)
    assert again.chi2 - fit.chi2 == pytest.approx(NORMAL_95**2, rel=0.3)


def test_the_interval_of_the_weight_is_longer_towards_hard_inclusions(fit, found):
    name = "inclusion_1.weight_pa"
    low, high = np.log(found[name]) - np.log(fit.values[name])
    straight = joint_intervals(fit, bent=False)[name]
    assert high > 1.05 * -low
    assert straight[0] < fit.values[name] < straight[1] < found[name][1]


def test_an_effect_has_an_interval_that_holds_what_was_planted(fit, found):
    low, high = found["contact_offset.offset_m"]
    assert low < OFFSET_M < high
    assert high - low == pytest.approx(2 * NORMAL_95 * fit.std["contact_offset.offset_m"], rel=0.05)


def test_a_map_whose_own_error_outweighs_the_noise_has_no_valley(fit):
    rough = fit_jointly(replace(fit.model, press_error=0.15), fit.map, rounds=0)
    assert joint_intervals(rough) == joint_intervals(rough, bent=False)
