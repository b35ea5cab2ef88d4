"""Detection limits of effects whose own size, or the map's answer to it, is far from linear."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from identify.catalogue.catalogue import CATALOGUE
from identify.design.detection_limits import Limit, detection_limits
from identify.design.settings import DETECTION, DetectionSettings
from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from tests.identify.select.loop_problem import TRUE, model, scan, timing
from tests.identify.select.loop_problem import uncorrected as body


def effect(name):
    return CATALOGUE[name]


@cache
def fit() -> FitResult:
    return fit_jointly(model(measured(), body()), TRUE)


def measured(**changes):
    """The scan of a body that is changed, always with the same noise."""
    press, _, _, force = timing(0)
    compliance = body().evaluate(TRUE, body().state().changed(**changes)).compliance
    return scan(compliance[press] * force, force, 0)


def limit(name: str, settings: DetectionSettings = DETECTION) -> Limit:
    (only,) = detection_limits(fit(), [effect(name)], settings=settings)
    return only


def left_by_a_whole_fit(**changes) -> float:
    """Length of what a change of the body leaves unexplained, in standard errors."""
    found = fit_jointly(model(measured(**changes), body()), TRUE)
    return float(np.linalg.norm(found.at.residual - fit().at.residual))


@pytest.mark.slow
def test_an_edge_that_takes_the_map_far_is_seen_from_the_size_that_a_whole_fit_leaves():
    shape = body().state().inclusion_shape

    def left(own: Limit) -> float:
        return left_by_a_whole_fit(inclusion_shape=replace(shape, edge=own.sizes["edge"]))

    fitted = limit("inclusion_edge")
    assert left(fitted) == pytest.approx(DETECTION.sigmas, rel=0.2)
    # By projection alone the edge would seem to be seen earlier, which it is not
    projected = limit("inclusion_edge", replace(DETECTION, far_map=np.inf))
    assert projected.smallest_share < 0.8 * fitted.smallest_share
    assert left(projected) < 0.8 * DETECTION.sigmas


def test_the_hardest_skin_of_the_thickness_stated_is_not_seen_where_no_size_is_given():
    # What the derivative at the null promises falls off as the skin grows hard, and changes sign
    own = limit("skin_layer")
    hardest = effect("skin_layer").parameters[0].upper
    assert own.smallest_share is None
    assert own.sizes["stiffening"] == pytest.approx(hardest)
    skin = {"skin_factor": 1 + hardest, "skin_thickness_m": own.shape["thickness_m"]}
    # So hard a skin also lowers the weight of the force's noise: by a quarter, in this scan
    assert left_by_a_whole_fit(**skin) < 1.5 * DETECTION.sigmas
    # At the size at which the derivative at the null makes five standard errors it is one
    assert left_by_a_whole_fit(**{**skin, "skin_factor": 8.7}) < DETECTION.sigmas / 2


def test_an_effect_that_is_too_small_to_be_seen_at_its_largest_has_no_limit_but_a_size():
    own = limit("rigid_tip")
    largest = effect("rigid_tip").parameters[0].upper
    assert own.smallest_share is None
    assert own.sizes["share"] == pytest.approx(largest)
    change = largest * fit().model.mechanics.correction.tip.gain
    signal = fit().at.predicted_m
    moved = signal * change[fit().model.readings.press]
    assert own.largest_share == pytest.approx(np.linalg.norm(moved) / np.linalg.norm(signal), 0.05)
    assert "the largest that is possible" in own.untestable
