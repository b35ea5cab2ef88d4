"""The quadrature of near fields: its error in a compliance and in the derivative by a sample."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from fem.near_field import moments
from fem.near_field.points import FUNCTIONS
from tests.long import long

SIZE = (0.048, 0.048, 0.048)
LEVELS = [0, 0.015, 0.028, 0.038, 0.0445, 0.048]  # thin cells at the top
# On a node, beside all faces, beside an edge of the body
PLACES = np.array([[0.012, 0.012, 0.048], [0.0289, 0.0222, 0.048], [0.0075, 0.03, 0.048]])


def steep(points: np.ndarray) -> np.ndarray:
    away = points - [0.02, 0.02, 0.036]
    return 6960 + 14300 * np.exp(-(away**2).sum(axis=1) / (2 * 0.0112**2))


@pytest.mark.parametrize(("tip", "radius"), [("flat", 0.005), ("hertz", 0.0025)])
@pytest.mark.parametrize("nu", [0.499, *long(0.3)])
@pytest.mark.parametrize("graded", [False, True])
def test_compliances_are_those_of_a_finer_quadrature(tip, radius, nu, graded, monkeypatch):
    levels = LEVELS if graded else None
    mesh = block_mesh(SIZE, (4, 4, 5 if graded else 4), levels_m=levels)
    contacts = Contacts(PLACES, np.array([0.0, 0.0, -1.0]), np.array(radius), tip)
    found = []
    for finer in (False, True):
        if finer:
            monkeypatch.setattr(moments, "_LEAF", 1.2)
            monkeypatch.setattr(moments, "_POINTS", (256, 12, 24))
        model = PalpationModel(mesh, nu, contacts)
        found.append(model.evaluate(steep(model.points_m)))
    own, finer = found
    np.testing.assert_allclose(own.compliance, finer.compliance, rtol=5e-5)
    scale = np.abs(finer.sensitivity).max()
    np.testing.assert_allclose(own.sensitivity, finer.sensitivity, atol=0.01 * scale)


def test_the_parts_near_the_rim_and_away_from_it_make_up_the_whole(monkeypatch):
    """The sum of strains over a block of cells does not depend on the tube's radius."""
    mesh = block_mesh((4, 4, 2), (4, 4, 2), order=1)
    vertices = (mesh.nodes - [2.1, 1.93, 2.0])[mesh.cells] * [1, -1, -1]
    found = []
    for tube in (0.35, 0.2):
        monkeypatch.setattr(moments, "_TUBE", tube)
        strain, energy = moments.moments(vertices, np.zeros(7), 0.7, 0.3, 0)
        found.append((strain.sum(axis=(0, 3)), energy.sum(axis=(0, 3))))
    assert found[0][0].shape == (FUNCTIONS, 6)
    for wide, narrow in zip(*found, strict=True):
        np.testing.assert_allclose(wide, narrow, atol=1e-4 * np.abs(narrow).max())
