"""A problem is posed from a map that the model can evaluate."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import SolverError
from identify.body.mechanics import BodyMechanics
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.map.parameters import parameter_space
from identify.optimize.result import InadmissibleError
from identify.select.start_fit import possible
from tests.identify.select.loop_problem import (
    SIZE,
    TRUE,
    mechanics,
    model,
    points,
    scan,
    timing,
    true_compliance,
)


def test_a_map_that_cannot_be_evaluated_is_weakened_until_it_can_be():
    press, _, _, force = timing(3)
    x, y, z = points()[10] + [0.0, 0.0, -0.002]
    spike = GaussianMap(5000.0, (Inclusion(-7e3, x, y, z, 0.008),))
    box = np.array([[0.0, 0.0, 0.0], SIZE])
    known = model(scan(true_compliance()[press] * force, force, 3))
    own = replace(known, space=parameter_space(spike, box))
    with pytest.raises(InadmissibleError, match="modulus"):
        own.linearise(own.start(spike))
    there, weaker = possible(own, spike)
    there.linearise(there.start(weaker))
    assert spike.inclusions[0].weight_pa < weaker.inclusions[0].weight_pa < 0
    assert possible(known, TRUE)[1] is TRUE


def test_a_map_that_the_finer_mesh_does_not_resolve_is_weakened(monkeypatch):
    press, _, _, force = timing(3)
    known = model(scan(true_compliance()[press] * force, force, 3))
    hard = GaussianMap(5000.0, (replace(TRUE.inclusions[0], weight_pa=3e5),))
    corrected, tried = BodyMechanics.corrected, []

    def only_soft(self, stiffness, state, slack=0.0):
        tried.append(stiffness.inclusions[0].weight_pa)
        if tried[-1] > 5e4:
            raise SolverError("no positive energy")
        return corrected(self, stiffness, state, slack)

    monkeypatch.setattr(BodyMechanics, "corrected", only_soft)
    _, start = possible(known, hard)
    assert tried == pytest.approx([3e5, 9e4, 3e4])
    assert start.inclusions[0].weight_pa == tried[-1]
    with pytest.raises(SolverError):
        possible(known, GaussianMap(5000.0, (replace(hard.inclusions[0], weight_pa=3e6),)))


def test_a_map_finer_than_the_mesh_is_evaluated_as_the_mesh_can():
    press, _, _, force = timing(3)
    x, y, z = points()[10] + [0.0, 0.0, -0.002]
    spike = GaussianMap(5000.0, (Inclusion(3e7, x, y, z, 0.002),))
    box = np.array([[0.0, 0.0, 0.0], SIZE])
    known = model(scan(true_compliance()[press] * force, force, 3))
    own = replace(known, space=parameter_space(spike, box))
    at = own.linearise(own.start(spike))
    plain = known.mechanics.evaluate(GaussianMap(5000.0), known.mechanics.state()).compliance
    assert (at.body.compliance > 0).all()
    assert at.body.compliance[10] < plain[10]  # a hard spot under the tip
    assert np.isfinite(at.jacobian).all()


def test_a_tip_that_is_held_takes_its_part_of_the_compliance():
    own = mechanics()
    free = own.state()
    half, whole = (free.changed(rigid_tip_share=share) for share in (0.5, 1.0))
    plain, held = own.evaluate(TRUE, free), own.evaluate(TRUE, half)
    assert 1e-3 < np.max(own.correction.tip.gain) < 0.1
    assert_allclose(
        held.compliance, plain.compliance * (1 - 0.5 * own.correction.tip.gain), rtol=1e-12
    )
    for start, end in ((plain, half), (held, whole), (held, free)):
        change, local = start.change(end)
        assert_allclose(start.compliance + change, own.evaluate(TRUE, end).compliance, rtol=1e-12)
        assert not local.any()
