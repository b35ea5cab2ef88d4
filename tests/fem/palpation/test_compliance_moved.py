"""Compliances of a body whose base lies a little lower, from the fields on the body as it is."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from fem.mesh import lower_base

SIZE = (0.06, 0.06, 0.03)


def test_a_lower_base_changes_compliances_as_a_model_of_that_body_says():
    def modulus(points_m: np.ndarray) -> np.ndarray:
        away = points_m - np.array([0.025, 0.03, 0.008])
        return 6e3 + 2e4 * np.exp(-0.5 * np.sum(away**2, axis=1) / 0.007**2)

    places = np.array([[0.02, 0.03, 0.03], [0.035, 0.04, 0.03]])
    contacts = Contacts(places, np.tile([0.0, 0.0, -1.0], (2, 1)), 0.003)
    model = PalpationModel(block_mesh(SIZE, (6, 6, 4)), 0.45, contacts)
    response = model.evaluate(modulus(model.points_m))
    lower = lower_base(model.mesh, 2e-4 * SIZE[2])
    there = model.on(lower)
    change = there.evaluate(modulus(there.points_m)).compliance - response.compliance
    found = response.compliance_moved(lower, modulus) - response.compliance
    assert found == pytest.approx(change, rel=0.03)


def test_a_lower_base_leaves_the_upper_half_and_straight_edges():
    mesh = block_mesh(SIZE, (3, 3, 3))
    lower = lower_base(mesh, 0.003)
    assert np.ptp(lower.nodes[:, 2]) == pytest.approx(0.033)
    upper = mesh.nodes[:, 2] > 0.0201
    assert np.array_equal(lower.nodes[upper], mesh.nodes[upper])
    middle = (lower.nodes[lower.cells[:, 0]] + lower.nodes[lower.cells[:, 1]]) / 2
    assert lower.nodes[lower.cells[:, 4]] == pytest.approx(middle)
