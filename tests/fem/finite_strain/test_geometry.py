"""What a body's changing shape does to a reading: the numbers behind the effect `finite_strain`."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import Contacts, block_mesh
from fem.finite_strain.hyperelastic import NeoHookean
from fem.finite_strain.model import FiniteStrainModel
from fem.finite_strain.tips import RigidTip
from fem.mesh.mesh import Mesh
from tests.identify.effects.test_physics import DEPTH, SLIDING, STICKING

WIDTH_M = 0.096
CELLS = 2  # to the tip's rim, and so on to twice its radius


def from_tip(radius: float, to: float, layers: int, widest: float) -> np.ndarray:
    """Distances from the tip, in cells that grow beyond twice its radius."""
    step = radius / CELLS
    beyond = np.geomspace(step, widest * step, layers)
    beyond *= (to - 2 * radius) / beyond.sum()
    return np.concatenate([np.arange(2 * CELLS + 1) * step, 2 * radius + np.cumsum(beyond)])


def graded(height: float, radius: float) -> Mesh:
    half = from_tip(radius, WIDTH_M / 2, 4, 8.0)
    across = np.concatenate([WIDTH_M / 2 - half[::-1], WIDTH_M / 2 + half[1:]])
    levels = height - from_tip(radius, height, 4, 6.0)[::-1]
    levels[0] = 0.0
    n = len(across) - 1
    even = block_mesh((WIDTH_M, WIDTH_M, height), (n, n, 1), levels_m=levels)
    nodes = even.nodes.copy()
    for axis in (0, 1):
        nodes[:, axis] = np.interp(nodes[:, axis], np.linspace(0, WIDTH_M, n + 1), across)
    return Mesh(nodes, even.cells, even.surfaces)


def ratios(height: float, radius: float, nu: float, tip: RigidTip) -> np.ndarray:
    contacts = Contacts([(WIDTH_M / 2, WIDTH_M / 2, height)], (0, 0, -1), radius)
    model = FiniteStrainModel(
        graded(height, radius), nu, contacts, NeoHookean(), tip=tip, mean_dilatation=nu > 0.4
    )
    compliance = model.evaluate(6e3, [0.001]).mesh_compliance
    response = model.evaluate(6e3, radius * np.array(DEPTH) / compliance[:, None])
    assert response.complete
    return response.ratio[0]


@pytest.mark.slow
@pytest.mark.parametrize(("sticking", "ratio"), [(True, STICKING), (False, SLIDING)])
def test_a_thick_body_softens(sticking, ratio):
    found = ratios(0.048, 0.005, 0.49, RigidTip(8, sticking=sticking))
    assert_allclose(found, ratio, atol=2e-4)


@pytest.mark.slow
@pytest.mark.parametrize(("height", "low", "high"), [(0.048, 1.005, 1.02), (0.030, 0.980, 0.995)])
def test_it_softens_less_the_thinner_the_body_and_then_hardens(height, low, high):
    found = ratios(height, 0.010, 0.49, RigidTip(8))
    assert low < found[-1] < high
