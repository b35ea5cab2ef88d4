"""Elastic and sliding supports against closed forms, and their derivatives."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from scipy.sparse.linalg import spsolve
from scipy.spatial.transform import Rotation

from fem.contact.contacts import Contacts
from fem.errors import MeshError, SolverError
from fem.linear.assembly import Stiffness
from fem.linear.support import Foundation, Support
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.palpation.model import PalpationModel

SIZE = np.array([0.09, 0.07, 0.05])
DOWN = np.array([0.0, 0.0, -1.0])
POINTS = np.array([(0.03, 0.025, 0.05), (0.051, 0.042, 0.05), (0.066, 0.02, 0.05)])
RADII = np.array([0.004, 0.006, 0.005])
UNIT = 0.05 / 5e3  # m/Pa: height over modulus
FREE = np.inf
_MODELS: dict[tuple, PalpationModel] = {}


def model(order: int = 2, near_field: bool = True, held: tuple[str, ...] = ()) -> PalpationModel:
    key = (order, near_field, held)
    if key not in _MODELS:
        contacts = Contacts(POINTS, DOWN, RADII)
        mesh = block_mesh(SIZE, (6, 5, 3), order=order)
        support = Support(held=held)
        _MODELS[key] = PalpationModel(mesh, 0.4, contacts, near_field=near_field, support=support)
    return _MODELS[key]


def modulus(points: np.ndarray) -> np.ndarray:
    return 5e3 * (1 + 3 * np.exp(-((points - [0.04, 0.038, 0.034]) ** 2).sum(axis=1) / 2.4e-4))


@pytest.mark.parametrize("order", [1, 2])
def test_a_column_on_a_spring_bed_shortens_by_its_own_and_the_beds_compression(order):
    mesh = block_mesh((0.3, 0.2, 0.7), (2, 2, 3), order=order)
    stiffness = Stiffness(mesh, 0.3, ())
    foundation = Foundation(stiffness, "base")
    young, normal, pressure = 2e3, 4e-5, 50.0
    values = stiffness.values(np.full(len(stiffness.points_m), young))
    foundation.add(values, (normal, 1e6 * normal))
    size = len(stiffness.indptr) - 1
    upper = sp.csr_array((values, stiffness.indices, stiffness.indptr), shape=(size, size))
    # The pressure's nodal forces, from the mass matrix of the springs under the top
    top = Foundation(stiffness, "top")
    load = np.zeros((len(mesh.nodes), 3))
    load[top.nodes, 2] = -pressure * (top._mass @ np.ones(len(top.nodes)))
    found = spsolve(sp.csc_array(upper + sp.triu(upper, 1).T), load.ravel()).reshape(-1, 3)
    z = mesh.nodes[:, 2]
    np.testing.assert_allclose(found[:, 2], -pressure * (z / young + normal), rtol=1e-5)
    widening = np.ptp(found[:, 0]) / 0.3
    assert widening == pytest.approx(0.3 * pressure / young, rel=1e-5)


@pytest.mark.parametrize("tangential", [0.0, 1e-6, FREE])
def test_a_stiff_block_sinks_and_tilts_on_its_spring_bed_like_a_rigid_one(tangential):
    young, normal = 1e10, 1e-6
    found = model().evaluate(young, (normal, tangential))
    x, y = (POINTS - SIZE / 2)[:, :2].T
    area = SIZE[0] * SIZE[1]
    rigid = 1 / area + x**2 / (area * SIZE[0] ** 2 / 12) + y**2 / (area * SIZE[1] ** 2 / 12)
    np.testing.assert_allclose(found.compliance, normal * rigid, rtol=1e-4)
    np.testing.assert_allclose(found.support_sensitivity[:, 0], rigid, rtol=1e-3)


def sliding_layer_compliance(a: float, nu: float) -> float:
    """Flat punch on a layer of height 1 on a frictionless rigid base, E = 1.

    Kernel (cosh 2k - 1)/(sinh 2k + 2k), Johnson, Contact Mechanics, Sec. 5.8.
    """
    node, weight = np.polynomial.legendre.leggauss(30)
    edges = np.linspace(0, 40, 81)
    k = ((edges[1:] + edges[:-1])[:, None] / 2 + node / 4).ravel()
    e = np.exp(-2 * k)
    kernel = (1 - e) ** 2 / (1 - e**2 + 4 * k * e)
    rest = np.tile(weight / 4, 80) @ ((kernel - 1) * (np.sin(k * a) / (k * a)) ** 2) / np.pi
    return (1 - nu**2) * (0.5 / a + rest)


@pytest.mark.parametrize(("a", "nu"), [(0.2, 0.3), (0.4, 0.45), (0.8, 0.45)])
def test_a_layer_that_slides_on_its_base_has_the_compliance_of_theory(a, nu):
    # Wide, as the end of a layer that slides is felt like 1/width^2, and finer to the middle
    plain = block_mesh((2, 2, 1), (10, 10, 3), order=1)
    flat = (a + 9) * np.sinh(3 * (plain.nodes[:, :2] - 1)) / np.sinh(3)
    nodes = np.column_stack([flat, plain.nodes[:, 2] - 1])
    mesh = promote_to_tet10(Mesh(nodes, plain.cells, plain.surfaces))
    bonded = PalpationModel(mesh, nu, Contacts((0, 0, 0), DOWN, a))
    found = bonded.evaluate(1.0, (0.0, FREE)).compliance[0]
    assert found == pytest.approx(sliding_layer_compliance(a, nu), rel=0.005)
    assert found > 1.01 * bonded.evaluate(1.0).compliance[0]


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("near_field", [False, True])
def test_at_the_bonded_base_the_derivative_is_that_of_a_stiff_foundation(order, near_field):
    body = model(order, near_field)
    field = modulus(body.points_m)
    bonded = body.evaluate(field)
    for k in range(2):
        slopes = []
        for step in (4e-5, 2e-5):
            compliance = tuple(UNIT * step * np.eye(2)[k])
            difference = body.evaluate(field, compliance).compliance - bonded.compliance
            slopes.append(difference / (UNIT * step))
        straight = 2 * slopes[1] - slopes[0]  # Richardson
        np.testing.assert_allclose(straight, bonded.support_sensitivity[:, k], rtol=1e-4)


@pytest.mark.parametrize("start", [(0.3, 0.1), (0.0, 0.2), (0.1, 0.0), (0.02, FREE)])
def test_the_derivative_by_the_foundations_compliance_passes_taylors_test(start):
    body = model()
    field = modulus(body.points_m)
    start = UNIT * np.array(start)
    first = body.evaluate(field, tuple(start))
    for k in np.flatnonzero((start > 0) & np.isfinite(start)):
        rest = []
        for step in (0.04, 0.02, 0.01):
            moved = start.copy()
            moved[k] += step * start[k]
            change = body.evaluate(field, tuple(moved)).compliance - first.compliance
            rest.append(np.linalg.norm(change - step * start[k] * first.support_sensitivity[:, k]))
        np.testing.assert_allclose(np.log2(np.divide(rest[:-1], rest[1:])), 2, atol=0.1)
    if np.isinf(start[1]):
        assert abs(first.support_sensitivity[:, 1] * UNIT / first.compliance).max() < 1e-9


def test_a_foundation_without_compliance_is_the_bonded_base():
    body = model()
    field = modulus(body.points_m)
    bonded = body.evaluate(field)
    for compliance in ((1e-30, 0.0), (0.0, 1e-30), (1e-15 * UNIT, 1e-15 * UNIT)):
        found = body.evaluate(field, compliance)
        np.testing.assert_allclose(found.compliance, bonded.compliance, rtol=1e-7)
        np.testing.assert_allclose(found.sensitivity.sum(axis=1), bonded.sensitivity.sum(axis=1),
                                   rtol=1e-6)  # fmt: skip
        np.testing.assert_allclose(found.support_sensitivity, bonded.support_sensitivity, rtol=1e-4)
    zero = body.evaluate(field, (0.0, 0.0))
    np.testing.assert_array_equal(zero.compliance, bonded.compliance)


def test_the_derivative_by_the_modulus_holds_on_a_foundation_too():
    body = model()
    field, compliance = modulus(body.points_m), (0.1 * UNIT, 0.4 * UNIT)
    found = body.evaluate(field, compliance)
    direction = field * np.random.default_rng(1).uniform(-1, 1, len(field))
    up, down = (body.evaluate(field + h * direction, compliance).compliance for h in (1e-3, -1e-3))
    np.testing.assert_allclose(found.sensitivity @ direction, (up - down) / 2e-3, rtol=1e-5)


def test_each_looser_support_makes_every_press_softer_and_held_sides_make_it_stiffer():
    field = modulus(model().points_m)
    steps = [(0, 0), (0, 0.1), (0, FREE), (0.1, FREE), (0.3, FREE)]
    found = [model().evaluate(field, (UNIT * n, UNIT * t)).compliance for n, t in steps]
    assert (np.diff(found, axis=0) > 0).all()
    one, all_sides = (model(held=h).evaluate(field) for h in (("x0",), ("sides",)))
    assert (one.compliance < found[0]).all()
    assert (all_sides.compliance < one.compliance).all()
    mesh = model().mesh
    for name in ("base", "sides"):
        assert not all_sides.displacement(0)[mesh.surface_nodes(name)].any()
    # On a foundation the edge stays held where the sides are
    loose = model(held=("x0",)).evaluate(field, (UNIT, UNIT)).displacement(1)
    assert not loose[mesh.surface_nodes("x0")].any()
    assert loose[mesh.surface_nodes("base")].any()


def test_supports_turn_with_the_body():
    rotation = Rotation.from_rotvec((0.4, -1.1, 0.7))
    mesh = model().mesh
    nodes = mesh.nodes[mesh.surface_nodes("top")[[30, 45, 77]]]
    turned_mesh = Mesh(rotation.apply(mesh.nodes.copy()), mesh.cells, mesh.surfaces)
    still = PalpationModel(mesh, 0.4, Contacts(nodes, DOWN, 0.0, "nodal"))
    turned = PalpationModel(
        turned_mesh, 0.4, Contacts(rotation.apply(nodes), rotation.apply(DOWN), 0.0, "nodal")
    )
    field = modulus(still.points_m)
    for compliance in ((0.0, 0.0), (0.0, FREE), (UNIT, 0.0), (0.2 * UNIT, 0.1 * UNIT)):
        a, b = still.evaluate(field, compliance), turned.evaluate(field, compliance)
        np.testing.assert_allclose(b.compliance, a.compliance, rtol=1e-6)
        np.testing.assert_allclose(b.support_sensitivity, a.support_sensitivity, rtol=1e-5,
                                   atol=1e-9 * abs(a.support_sensitivity).max())  # fmt: skip


def test_a_slanted_press_on_a_sliding_body_is_refused():
    contacts = Contacts(POINTS, (0.1, 0.0, -np.sqrt(0.99)), RADII)
    mesh = block_mesh(SIZE, (3, 3, 2))
    sliding = PalpationModel(mesh, 0.4, contacts, near_field=False,
                             support=Support(tangential=FREE))  # fmt: skip
    with pytest.raises(SolverError, match="pushes the body off"):
        sliding.evaluate(5e3)
    held = Support(tangential=FREE, held=("x0",))
    found = PalpationModel(mesh, 0.4, contacts, near_field=False, support=held).evaluate(5e3)
    assert np.isfinite(found.compliance).all()


@pytest.mark.parametrize("normal", [-1e-9, FREE, np.nan])
def test_an_impossible_compliance_is_refused(normal):
    with pytest.raises(MeshError, match="must be >= 0 m/Pa"):
        Support(normal=normal)
    with pytest.raises(MeshError, match="no surface 'floor'"):
        PalpationModel(block_mesh(SIZE, (2, 2, 2)), 0.4, Contacts(POINTS, DOWN, RADII),
                       support=Support("floor"))  # fmt: skip
    with pytest.raises(MeshError, match="tuple of surface names"):
        Support(held="sides")  # pyright: ignore[reportArgumentType]
