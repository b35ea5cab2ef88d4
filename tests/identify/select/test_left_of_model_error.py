"""What follows an addition that may be the model's own error may be what that error leaves over."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from identify.body.discretization_error import MODEL_ERROR
from identify.catalogue.catalogue import CATALOGUE
from identify.select.forward_selection import forward_selection
from identify.select.settings import SelectionSettings
from tests.identify.select.loop_problem import TRUE, mechanics, model, scan, timing

NAMES = (MODEL_ERROR, "poisson_ratio", "base_sliding", "side_gradient", "force_drift")
ERROR = 40.0  # times what the meshes are estimated to be off by
GRADIENT = 0.015
DRIFT_N = 0.004
SMALL = 0.45  # of what the error explains: more than these two do here


@cache
def explained(small: float, gradient: float = 0.0, drift_n: float = 0.0):
    """A scan of a body that differs from the model by its error, and by a little more."""
    press, time, _, force = timing(0)
    own = mechanics()
    x = np.linspace(-0.5, 0.5, 5)[np.arange(25) % 5]  # of the presses' places, side to side
    compliance = own.evaluate(TRUE, own.state()).compliance * (
        1 + ERROR * own.correction.model_error
    )
    table = scan((compliance * np.exp(-gradient * x))[press] * force, force, 0)
    table = replace(table, force_n=table.force_n + drift_n * time / time[-1])
    return forward_selection(
        model(table),
        TRUE,
        table,
        [CATALOGUE[name] for name in NAMES],
        settings=SelectionSettings(left_of_error=small),
    )


def second(found):
    """Group of the second addition, and its share of what the first explained."""
    chi2 = [step.fit.chi2 for step in found.ladder]
    first, other = found.accepted
    assert MODEL_ERROR in first.group
    return other.group, (chi2[1] - chi2[2]) / (chi2[0] - chi2[1])


@pytest.mark.slow
def test_a_little_more_that_acts_on_compliances_is_not_told_from_the_rest_of_that_error():
    found = explained(SMALL, gradient=GRADIENT)
    group, share = second(found)
    assert share < SMALL
    assert group == ("side_gradient", MODEL_ERROR)
    assert found.added == ()


@pytest.mark.slow
def test_what_explains_more_than_such_a_rest_is_named():
    found = explained(0.1, gradient=GRADIENT)
    group, share = second(found)
    assert share > 0.1
    assert group == found.added == ("side_gradient",)


@pytest.mark.slow
def test_what_no_mesh_does_is_named_however_little():
    found = explained(SMALL, drift_n=DRIFT_N)
    group, share = second(found)
    assert share < SMALL
    assert group == found.added == ("force_drift",)
