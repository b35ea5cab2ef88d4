"""95 % intervals of a joint fit follow the valley of depth and weight, effects fitted along."""

from dataclasses import replace

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.fit.joint_fit import fit_jointly
from identify.fit.profile_intervals import NORMAL_95
from tests.identify.select.loop_problem import TRUE, model, scan, timing, true_compliance
from tests.long import long

OFFSET_M = 1.5e-4


@pytest.fixture(scope="module")
def fit():
    """With meshes that are said to be exact: the noise alone makes the intervals."""
    press, _, _, force = timing(7)
    own = model(scan(true_compliance()[press] * force + OFFSET_M, force, 7))
    own.mechanics.forget()  # of other tests: the intervals must not depend on what ran before
    offset = CATALOGUE["contact_offset"]
    found = fit_jointly(
        own.with_effect(offset, {"offset_m": OFFSET_M}, own.mechanics.state()), TRUE
    )
    return fit_jointly(with_meshes_error(found, 0.0), found.map, rounds=0)


@pytest.fixture(scope="module")
def found(fit):
    return ends(fit.parameters)


def ends(estimates):
    return {name: (entry.lower95, entry.upper95) for name, entry in estimates.items()}


@pytest.mark.parametrize("side", [0, *long(1)])
@pytest.mark.parametrize("name", ["inclusion_1.weight_pa", "inclusion_1.z_m"])
def test_chi_square_rises_by_3_84_at_the_ends(fit, found, name, side):
    """The likelihood's own profile, by another way: the parameter is taken out of the free ones."""
    at, noise = fit.model.names.index(name), fit.solution.noise_covariance
    space = fit.model.space
    free = tuple(i for i in space.free if space.start.names[i] != name)
    end = space.to_scaled(fit.map.changed({name: found[name][side]}))[at]
    u = fit.u + noise[:, at] / noise[at, at] * (end - fit.u[at])
    held = fit.model.map(u)
    fixed = replace(fit.model, space=replace(space, start=held, free=free)).started(
        np.delete(u, at)
    )
    again = fit_jointly(fixed, held)
    assert again.chi2 - fit.chi2 == pytest.approx(NORMAL_95**2, rel=0.1)


def test_the_interval_of_the_weight_is_longer_towards_hard_inclusions(fit, found):
    name = "inclusion_1.weight_pa"
    low, high = np.log(found[name]) - np.log(fit.values[name])
    straight = ends(fit.intervals(curved=False))[name]
    assert high > 1.05 * -low
    assert straight[0] < fit.values[name] < straight[1] < found[name][1]


def test_an_effect_has_an_interval_that_holds_what_was_planted(fit, found):
    low, high = found["contact_offset.offset_m"]
    assert low < OFFSET_M < high
    assert high - low == pytest.approx(2 * NORMAL_95 * fit.std["contact_offset.offset_m"], rel=0.05)


def test_a_map_whose_own_error_outweighs_the_noise_has_no_valley(fit):
    rough = fit_jointly(replace(fit.model, press_error=0.15), fit.map, rounds=0)
    assert rough.parameters == rough.intervals(curved=False)


def with_correction(model, **changes):
    correction = replace(model.mechanics.correction, **changes)
    return replace(model, mechanics=replace(model.mechanics, correction=correction))


def with_meshes_error(fit, error):
    return with_correction(fit.model, model_error=error)


def test_what_the_meshes_are_off_by_together_widens_by_what_it_moves_the_estimate(fit):
    error = 2e-4 * np.random.default_rng(1).standard_normal(25)
    erring = with_meshes_error(fit, error)
    estimate = fit_jointly(erring, fit.map, rounds=0)
    corrected = with_correction(erring, ratio=erring.mechanics.correction.ratio * (1 + error))
    # a step of Gauss and Newton at the estimate: the fit's own end is known no better
    change = corrected.linearise(estimate.u).residual - estimate.at.residual
    moved = estimate.solution.noise_covariance @ estimate.at.jacobian.T @ change
    added = estimate.solution.covariance - estimate.solution.noise_covariance
    own = [with_meshes_error(fit, np.where(np.arange(25) == j, error, 0.0)) for j in range(25)]
    single = sum(
        (f.solution.covariance - f.solution.noise_covariance) / 2
        for f in (fit_jointly(m, fit.map, rounds=0) for m in own)
    )
    # one error of all presses at once, and one of each press by itself
    together = np.outer(moved, moved)
    np.testing.assert_allclose(added - single, together, atol=0.05 * together.max())
    assert np.all(np.diag(single) > 0)
    assert all(estimate.std[name] > fit.std[name] for name in fit.values)
    wide, narrow = ends(estimate.parameters), ends(fit.parameters)
    for name in ("inclusion_1.x_m", "background_pa"):
        assert np.ptp(wide[name]) > np.ptp(narrow[name])


def test_a_meshes_error_among_the_unknowns_is_not_counted_twice(fit):
    effect = CATALOGUE["mesh_error"]
    erring = with_meshes_error(fit, np.full(25, 2e-3))
    known = erring.with_effect(effect, {"share": 0.0}, erring.mechanics.state())
    joint = fit_jointly(known, fit.map, rounds=0)
    np.testing.assert_array_equal(joint.solution.covariance, joint.solution.noise_covariance)
