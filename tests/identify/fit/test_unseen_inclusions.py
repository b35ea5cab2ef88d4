"""An inclusion that the readings do not ask for is told from one that they do."""

from dataclasses import replace

import numpy as np
import pytest

from identify.fit.joint_fit import fit_jointly
from identify.fit.result import FitResult
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.parameters import parameter_space
from tests.identify.select.loop_problem import TRUE, mechanics, model, scan, timing, true_compliance

NEAR = Inclusion(300.0, 0.030, 0.030, 0.02, 0.008)
FAINT = Inclusion(300.0, 0.044, 0.018, 0.02, 0.008)


def fitted(truth: GaussianMap, start: GaussianMap, **options) -> FitResult:
    press, _, _, force = timing(4)
    table = scan(true_compliance(truth.modulus)[press] * force, force, 4)
    held = replace(mechanics().correction, trend=None)  # that of another map
    own = model(table, replace(mechanics(), fine=None, correction=held))
    nodes = own.mechanics.coarse.mesh.nodes
    box = np.array([nodes.min(axis=0), nodes.max(axis=0)])
    return fit_jointly(replace(own, space=parameter_space(start, box)), start, **options)


@pytest.mark.slow
def test_of_a_homogeneous_body_no_inclusion_is_seen():
    start = GaussianMap(TRUE.background_pa, (FAINT,))
    fit = fitted(GaussianMap(5000.0), start)
    assert fit.unseen_inclusions == (1,)
    low, high = fit.model.mechanics.coarse.mesh.box_m
    for axis, letter in enumerate("xyz"):  # nothing is known of it
        place = fit.parameters[f"inclusion_1.{letter}_m"]
        assert (place.lower95, place.upper95) == pytest.approx((low[axis], high[axis]))
    weight = fit.parameters["inclusion_1.weight_pa"]
    assert weight.lower95 < -4000.0
    assert weight.upper95 > 4e5
    assert fit.parameters["background_pa"].upper95 < 6000.0


@pytest.mark.slow
def test_of_two_that_stand_for_one_only_one_is_named():
    (real,) = TRUE.inclusions
    fit = fitted(TRUE, GaussianMap(TRUE.background_pa, (real, NEAR)), max_evaluations=12)
    (named,) = fit.unseen_inclusions
    kept = fit.map.inclusions[2 - named]
    assert np.hypot(kept.x_m - real.x_m, kept.y_m - real.y_m) < 0.003


def test_the_one_that_is_there_is_kept():
    fit = fitted(TRUE, TRUE)
    assert fit.unseen_inclusions == ()
    assert fit.parameters["inclusion_1.weight_pa"].lower95 > 0
