"""The ratio of two models' compliances carried to maps nearby, against solutions of both."""

from dataclasses import replace

import numpy as np
import pytest

from identify.body.linear_ratio import LinearRatio
from identify.body.settings import BODY
from identify.body.state import ChangedMap
from identify.map.gaussian_map import GaussianMap, Inclusion
from tests.identify.select import loop_problem as problem


def map_nearby(step: np.ndarray) -> GaussianMap:
    """The true map, each of its six parameters moved by a part of its size."""
    true, (spot,) = problem.TRUE, problem.TRUE.inclusions
    moved = Inclusion(
        spot.weight_pa * np.exp(step[1]),
        *(np.array([spot.x_m, spot.y_m, spot.z_m]) + spot.radius_m * step[2:5]).tolist(),
        spot.radius_m * np.exp(step[5]),
    )
    return GaussianMap(true.background_pa * np.exp(step[0]), (moved,))


@pytest.mark.parametrize("change", [{"shift_m": (0.0012, 0.0)}, {"poisson_ratio": 0.47}])
def test_the_error_is_within_its_estimate_and_far_maps_are_refused(change):
    own = problem.mechanics()
    state = own.state()
    other = own.shifted.coarse_at((0.0012, 0.0))
    if "poisson_ratio" in change:
        other = own.at_poisson_ratio(change["poisson_ratio"])

    def both(stiffness: GaussianMap):
        return (m.evaluate(stiffness.modulus(m.points_m)) for m in (own.coarse, other))

    linear = LinearRatio.of(*both(problem.TRUE), ChangedMap(problem.TRUE, state))
    errors = []
    for size in (0.01, 0.03, 0.1):
        stiffness = map_nearby(size * np.random.default_rng(1).normal(size=6))
        coarse, there = both(stiffness)
        changed, exact = ChangedMap(stiffness, state), np.log(there.compliance / coarse.compliance)
        known = linear.log_at(changed, coarse.compliance, np.inf)
        assert known is not None
        errors.append(np.abs(known - exact).max())
        assert linear.log_at(changed, coarse.compliance, errors[-1]) is None
    assert errors[0] < 1e-5 < errors[2]


@pytest.mark.slow
def test_a_search_near_a_solved_map_solves_the_coarse_model_alone(monkeypatch):
    own = replace(problem.mechanics(), _ratios={}, _reduced_ratios={}, _solutions={})
    state = own.state().changed(shift_m=(0.0012, -0.0009), poisson_ratio=0.44)
    solved = []
    solve = type(own).solve

    def counted(self, model, *rest):
        solved.append(model is own.coarse)
        return solve(self, model, *rest)

    monkeypatch.setattr(type(own), "solve", counted)
    own.evaluate(problem.TRUE, state)
    assert solved.count(False) == 6  # two ratios, two shifts along each axis
    near = map_nearby(np.full(6, 0.001))
    found = own.evaluate(near, state).compliance
    assert solved.count(False) == 6
    exact = replace(own, settings=replace(BODY, ratio_error=-1.0), _ratios={}, _solutions={})
    np.testing.assert_allclose(found, exact.evaluate(near, state).compliance, rtol=1e-5)
    assert solved.count(False) == 12
