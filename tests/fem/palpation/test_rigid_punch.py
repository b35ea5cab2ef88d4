"""A tip's own pressure against Hayes' layer and the closed forms of the half-space."""

from __future__ import annotations

import numpy as np
import pytest

from fem.contact.contacts import Contacts, disc_quadrature
from fem.contact.half_space import FLAT
from fem.errors import MeshError
from fem.mesh.block import block_mesh
from fem.palpation.model import PalpationModel
from fem.palpation.rigid_punch import by_contact_radius, shape_gain, travel_under
from tests.fem.reference.hayes import punch_factor

DOWN = np.array([0.0, 0.0, -1.0])
NU, H = 0.45, 0.01


def test_a_tip_as_wide_as_the_layer_is_thick_has_hayes_stiffness():
    a, size = 0.010, (0.12, 0.12, H)  # as good as a layer without end
    contacts = Contacts(np.array([0.06, 0.06, H]), DOWN, a)
    model = PalpationModel(block_mesh(size, (18, 18, 4)), NU, contacts)
    response = model.evaluate(5e3)
    exact = (1 - NU**2) / (2 * 5e3 * a * punch_factor(a / H, NU))
    assert response.compliance[0] / exact - 1 > 0.02
    better = response.compliance - shape_gain(response, np.array([5e3]))
    assert better[0] == pytest.approx(exact, rel=0.006)


def test_a_small_tip_on_an_even_body_has_the_half_spaces_pressure():
    contacts = Contacts(np.array([0.03, 0.03, 0.04]), DOWN, 0.004)
    model = PalpationModel(block_mesh((0.06, 0.06, 0.04), (6, 6, 4)), 0.4, contacts)
    response = model.evaluate(5e3)
    gain = shape_gain(response, np.array([5e3]))
    assert 0 <= gain[0] < 1e-4 * response.compliance[0]


def test_a_tip_over_the_side_of_a_stiff_place_gains_by_not_tilting():
    size = (0.06, 0.06, 0.04)
    points = np.array([(0.03, 0.03, 0.04), (0.037, 0.03, 0.04), (0.03, 0.037, 0.04)])
    model = PalpationModel(block_mesh(size, (6, 6, 4)), 0.4, Contacts(points, DOWN, 0.005))

    def modulus(x: np.ndarray) -> np.ndarray:
        away = ((x - [0.03, 0.03, 0.036]) ** 2).sum(axis=1)
        return 5e3 + 20e3 * np.exp(-away / (2 * 0.008**2))

    response = model.evaluate(modulus(model.points_m))
    above, beside, across = shape_gain(response, modulus(points)) / response.compliance
    assert above < 0.1 * beside
    assert beside == pytest.approx(across, rel=0.01)  # x and y may change places
    assert 0.003 < beside < 0.1
    assert (shape_gain(response, 2 * modulus(points))[1]) == pytest.approx(
        2 * beside * response.compliance[1], rel=1e-9
    )


def test_the_travel_under_the_tip_weighted_with_the_pressure_is_the_compliance():
    size = (0.06, 0.06, 0.04)
    points = np.array([(0.03, 0.03, 0.04), (0.037, 0.021, 0.04)])
    model = PalpationModel(block_mesh(size, (6, 6, 4)), 0.4, Contacts(points, DOWN, 0.005))
    x = model.points_m
    response = model.evaluate(5e3 * (1 + 4 * np.exp(-((x - points[0]) ** 2).sum(axis=1) / 1e-4)))
    disc, weight = disc_quadrature(FLAT)
    for j in range(2):
        mean = weight @ travel_under(response, j, disc)
        assert mean == pytest.approx(response.compliance[j], rel=1e-6)


def test_the_growth_of_a_hertz_contact_is_the_difference_of_two_contacts():
    size = (0.06, 0.06, 0.012)
    points = np.array([(0.03, 0.03, 0.012), (0.037, 0.021, 0.012)])
    mesh = block_mesh(size, (8, 8, 3))

    def at(radius: float):
        model = PalpationModel(mesh, 0.4, Contacts(points, DOWN, radius, "hertz"))
        stiff = np.exp(-((model.points_m - [0.04, 0.03, 0.008]) ** 2).sum(axis=1) / 8e-5)
        return model.evaluate(5e3 * (1 + 3 * stiff))

    a, step = 3e-3, 0.05
    wider, narrower = (at(a * np.exp(s)).compliance for s in (step, -step))
    growth = by_contact_radius(at(a))
    half_space = -0.6 * (1 - 0.4**2) / (5e3 * a)
    assert (growth > 0.98 * half_space).all()
    assert growth == pytest.approx((wider - narrower) / (2 * step), rel=0.005)


def test_a_hertz_contact_is_refused():
    contacts = Contacts(np.array([0.02, 0.02, 0.02]), DOWN, 0.004, "hertz")
    model = PalpationModel(block_mesh((0.04, 0.04, 0.02), (3, 3, 2)), 0.4, contacts)
    with pytest.raises(MeshError, match="only a flat tip"):
        shape_gain(model.evaluate(5e3), np.array([5e3]))
    flat = PalpationModel(model.mesh, 0.4, Contacts(contacts.points_m, DOWN, 0.004))
    with pytest.raises(MeshError, match="expected Hertz contacts"):
        by_contact_radius(flat.evaluate(5e3))
