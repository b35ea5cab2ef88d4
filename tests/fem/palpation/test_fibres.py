"""Fibres: closed forms, frames, derivatives, convergence."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from fem.contact.contacts import Contacts
from fem.errors import MeshError
from fem.linear.assembly import Stiffness
from fem.linear.support import Foundation
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh
from fem.palpation.fibres import HORIZONTAL, fibre_weights
from fem.palpation.model import PalpationModel
from fem.palpation.richardson import RefinedModel

SIZE = np.array([0.09, 0.07, 0.05])
DOWN = np.array([0.0, 0.0, -1.0])
POINTS = np.array([(0.03, 0.025, 0.05), (0.051, 0.042, 0.05), (0.066, 0.02, 0.05)])
SLANTED = np.array([0.48, 0.6, 0.64])
_MODELS: dict[tuple, PalpationModel] = {}

every_kind = pytest.mark.parametrize(
    ("order", "near_field"), [(1, False), (1, True), (2, False), (2, True)]
)


def model(order: int = 2, near_field: bool = True) -> PalpationModel:
    key = (order, near_field)
    if key not in _MODELS:
        contacts = Contacts(POINTS, DOWN, [0.004, 0.006, 0.005])
        mesh = block_mesh(SIZE, (6, 5, 3), order=order)
        _MODELS[key] = PalpationModel(mesh, 0.4, contacts, near_field=near_field)
    return _MODELS[key]


def modulus(points: np.ndarray) -> np.ndarray:
    return 5e3 * (1 + 3 * np.exp(-((points - [0.04, 0.038, 0.034]) ** 2).sum(axis=1) / 2.4e-4))


def fibre_modulus(points: np.ndarray) -> np.ndarray:
    return 900 + 3e4 * points[:, 0] + 4e4 * points[:, 1]


def horizontal(angle: float) -> np.ndarray:
    return np.array([np.cos(angle), np.sin(angle), 0])


@pytest.mark.parametrize("order", [1, 2])
def test_fibres_of_a_linear_field_hold_the_energy_of_their_own_strain(order):
    stiffness = Stiffness(block_mesh(SIZE, (2, 3, 2), order=order), 0.3, ())
    rng = np.random.default_rng(2)
    slope, direction = rng.normal(size=(3, 3)), SLANTED
    along = direction @ (slope + slope.T) / 2 @ direction
    young = rng.uniform(1, 5, len(stiffness.points_m))
    values = stiffness.fibre_values(direction, young)
    size = len(stiffness.indptr) - 1
    upper = sp.csr_array((values, stiffness.indices, stiffness.indptr), shape=(size, size))
    matrix = upper + sp.triu(upper, 1).T
    field = (stiffness.mesh.nodes @ slope.T).ravel()
    weights = np.outer(stiffness.volumes, stiffness.rule[1]).ravel()
    assert field @ (matrix @ field) == pytest.approx(weights @ young * along**2, rel=1e-10)


@pytest.mark.parametrize(("axis", "letter"), [(0, "x"), (1, "y")])
def test_a_bar_is_stiffer_by_the_fibres_along_it_and_hardly_by_those_across(axis, letter):
    mesh = block_mesh((0.3, 0.2, 0.4), (2, 2, 2))
    stiffness = Stiffness(mesh, 0.3, ())
    young, extra, nu, traction = 2e3, 5e3, 0.3, 40.0
    samples = np.ones(len(stiffness.points_m))
    values = stiffness.values(young * samples)
    values += stiffness.fibre_values(np.array([1.0, 0, 0]), extra * samples)
    soft, hard = 1e6 / young, 1e-9 / young
    Foundation(stiffness, f"{letter}0").add(values, (hard, soft))
    end = Foundation(stiffness, f"{letter}1")
    load = np.zeros((len(mesh.nodes), 3))
    load[end.nodes, axis] = traction * (end._mass @ np.ones(len(end.nodes)))
    size = len(stiffness.indptr) - 1
    upper = sp.csr_array((values, stiffness.indices, stiffness.indptr), shape=(size, size))
    found = spsolve(sp.csc_array(upper + sp.triu(upper, 1).T), load.ravel()).reshape(-1, 3)
    strain = found[:, axis].max() / np.ptp(mesh.nodes[:, axis])
    along = traction / (young + extra)
    across = traction / young * (1 - nu**2 * extra / (young + extra))
    assert strain == pytest.approx(along if axis == 0 else across, rel=1e-5)


@every_kind
def test_without_fibres_the_derivative_for_every_direction_is_that_of_weak_ones(order, near_field):
    body = model(order, near_field)
    field, weight = modulus(body.points_m), fibre_modulus(body.points_m)
    plain = body.evaluate(field)
    moments = plain.fibre_moments(weight)
    assert moments.shape == (3, 6)
    for angle in (0.0, 0.7, 2.1):
        direction = horizontal(angle)
        step = 1e-3
        up, down = (body.evaluate(field, fibres=(direction, s * weight)).compliance
                    for s in (step, -step))  # fmt: skip
        slope = (up - down) / (2 * step)
        np.testing.assert_allclose(-moments @ fibre_weights(angle), slope, rtol=1e-5)
        np.testing.assert_allclose(plain.fibre_sensitivity(direction) @ weight, slope, rtol=1e-5)


@every_kind
def test_with_fibres_every_derivative_passes_taylors_test(order, near_field):
    body = model(order, near_field)
    field, weight = modulus(body.points_m), fibre_modulus(body.points_m)
    angle = 0.6

    def compliance(stiff=0.0, more=0.0, turn=0.0):
        fibres = (horizontal(angle + turn), (1 + more) * weight)
        return body.evaluate((1 + stiff) * field, fibres=fibres).compliance

    response = body.evaluate(field, fibres=(horizontal(angle), weight))
    slopes = {
        "stiff": response.sensitivity @ field,
        "more": response.fibre_sensitivity(horizontal(angle)) @ weight,
        "turn": -response.fibre_moments(weight) @ fibre_weights(angle + 1e-30j).imag / 1e-30,
    }
    for name, slope in slopes.items():
        steps = np.array([0.08, 0.04, 0.02])
        rest = [np.linalg.norm(compliance(**{name: h}) - response.compliance - h * slope)
                for h in steps]  # fmt: skip
        np.testing.assert_allclose(np.log2(np.divide(rest[:-1], rest[1:])), 2, atol=0.15)
    # Euler: the compliance is homogeneous of degree -1 in both moduli together
    np.testing.assert_allclose(slopes["stiff"] + slopes["more"], -response.compliance, rtol=1e-6)


def test_fibres_out_of_the_horizontal_have_the_right_derivative_too():
    body = model()
    field, weight = modulus(body.points_m), fibre_modulus(body.points_m)
    response = body.evaluate(field, fibres=(SLANTED, weight))
    slope = response.fibre_sensitivity(SLANTED) @ weight
    up, down = (body.evaluate(field, fibres=(SLANTED, (1 + s) * weight)).compliance
                for s in (1e-3, -1e-3))  # fmt: skip
    np.testing.assert_allclose(slope, (up - down) / 2e-3, rtol=1e-5)
    plane = np.array([[1.0, 0, 0], [0, 0.6, 0.8]])
    tilted = response.fibre_moments(weight, plane) @ fibre_weights(0.4)
    direction = np.cos(0.4) * plane[0] + np.sin(0.4) * plane[1]
    np.testing.assert_allclose(-tilted, response.fibre_sensitivity(direction) @ weight, rtol=1e-5)


def test_fibres_turn_with_the_body():
    mesh = model(1).mesh
    nodes = mesh.nodes[mesh.surface_nodes("top")[[9, 17, 25]]]
    rotation = Rotation.from_rotvec((0.4, -1.1, 0.7))
    turned = PalpationModel(
        Mesh(rotation.apply(mesh.nodes.copy()), mesh.cells, mesh.surfaces),
        0.4,
        Contacts(rotation.apply(nodes), rotation.apply(DOWN), 0.0, "nodal"),
    )
    still = PalpationModel(mesh, 0.4, Contacts(nodes, DOWN, 0.0, "nodal"))
    field, weight = modulus(still.points_m), fibre_modulus(still.points_m)
    for direction in (horizontal(0.3), SLANTED):
        a = still.evaluate(field, fibres=(direction, weight))
        b = turned.evaluate(field, fibres=(rotation.apply(direction), weight))
        np.testing.assert_allclose(b.compliance, a.compliance, rtol=1e-9)
    moments = turned.evaluate(field).fibre_moments(weight, rotation.apply(HORIZONTAL))
    np.testing.assert_allclose(moments, still.evaluate(field).fibre_moments(weight), rtol=1e-6,
                               atol=1e-9 * abs(moments).max())  # fmt: skip


def test_with_the_near_field_the_derivative_is_that_of_a_finer_mesh():
    contacts = Contacts(POINTS[:1], DOWN, 0.004)
    found = {}
    for near_field in (False, True):
        for cells in ((6, 5, 3), (10, 8, 5)):
            body = PalpationModel(block_mesh(SIZE, cells), 0.45, contacts, near_field=near_field)
            response = body.evaluate(modulus(body.points_m))
            moments = response.fibre_moments(modulus(body.points_m))
            found[near_field, cells[0]] = [moments @ fibre_weights(p) for p in (0.0, 0.8)]
    exact = np.array(found[True, 10])
    error = {key: abs(np.array(value) / exact - 1).max() for key, value in found.items()}
    assert 8 * error[True, 6] < error[False, 10] < error[False, 6]


def test_on_two_meshes_the_fibres_are_split_like_the_modulus():
    meshes = [block_mesh(SIZE, cells) for cells in ((4, 3, 2), (6, 5, 3))]
    contacts = Contacts(POINTS, DOWN, 0.004)
    pair = RefinedModel(*(PalpationModel(mesh, 0.4, contacts) for mesh in meshes))
    field, weight = modulus(pair.points_m), fibre_modulus(pair.points_m)
    with_fibres = pair.evaluate(field, fibres=(SLANTED, weight))
    fine = pair.fine.evaluate(modulus(pair.fine.points_m),
                              fibres=(SLANTED, fibre_modulus(pair.fine.points_m)))  # fmt: skip
    np.testing.assert_array_equal(with_fibres.fine.compliance, fine.compliance)
    assert (with_fibres.compliance < pair.evaluate(field).compliance).all()


def test_fibres_without_a_unit_direction_or_a_finite_modulus_are_refused():
    body = model()
    with pytest.raises(MeshError, match="unit vector"):
        body.evaluate(5e3, fibres=((1.0, 1.0, 0.0), 1e3))
    with pytest.raises(MeshError, match="finite everywhere"):
        body.evaluate(5e3, fibres=((1.0, 0.0, 0.0), np.nan))
    with pytest.raises(MeshError, match="orthonormal"):
        body.evaluate(5e3).fibre_moments(1.0, np.ones((2, 3)))
