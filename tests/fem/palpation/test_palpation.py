"""Compliance and its derivative: scaling, symmetry, invariance, consistency."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fem.contact.contacts import Contacts, contact_weights
from fem.errors import MeshError, SolverError
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh
from fem.palpation.model import PalpationModel
from fem.palpation.richardson import RefinedModel

SIZE = (0.09, 0.07, 0.05)
DOWN = np.array([0.0, 0.0, -1.0])
POINTS = np.array([(0.03, 0.025, 0.05), (0.051, 0.042, 0.05), (0.066, 0.02, 0.05)])

every_kind = pytest.mark.parametrize(
    ("order", "profile", "near_field"),
    [(1, "flat", True), (2, "flat", True), (2, "hertz", True), (1, "flat", False),
     (2, "hertz", False)],
)  # fmt: skip
_MODELS: dict[tuple, PalpationModel] = {}


def model(order: int, profile: str, near_field: bool) -> PalpationModel:
    """Three presses of different radii; models are frozen, so each is made once."""
    key = (order, profile, near_field)
    if key not in _MODELS:
        mesh = block_mesh(SIZE, (6, 5, 3), order=order)
        contacts = Contacts(POINTS, DOWN, [0.004, 0.006, 0.005], profile)
        _MODELS[key] = PalpationModel(mesh, 0.4, contacts, near_field=near_field)
    return _MODELS[key]


def modulus(points: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Background, weight, place and radius of one inclusion."""
    away = points - theta[2:5]
    return theta[0] + theta[1] * np.exp(-(away**2).sum(axis=1) / (2 * theta[5] ** 2))


def modulus_gradient(points: np.ndarray, theta: np.ndarray) -> np.ndarray:
    away = points - theta[2:5]
    square = (away**2).sum(axis=1)
    bell = np.exp(-square / (2 * theta[5] ** 2))
    shift = theta[1] * bell[:, None] * away / theta[5] ** 2
    width = theta[1] * bell * square / theta[5] ** 3
    return np.column_stack([np.ones(len(points)), bell, shift, width])


THETA = np.array([5e3, 18e3, 0.04, 0.038, 0.034, 0.011])


@every_kind
def test_the_derivative_passes_taylors_test(order, profile, near_field):
    palpation = model(order, profile, near_field)
    points = palpation.points_m
    start = palpation.evaluate(modulus(points, THETA))
    gradient = start.gradient(modulus_gradient(points, THETA))
    assert gradient.shape == (3, 6)
    for seed in range(3):
        direction = THETA * np.random.default_rng(seed).uniform(-1, 1, 6) * [1, 1, 0.3, 0.3, 0.3, 1]
        steps = np.array([0.04, 0.02, 0.01])
        change = np.array([
            palpation.evaluate(modulus(points, THETA + h * direction)).compliance for h in steps
        ]) - start.compliance  # fmt: skip
        rest = np.linalg.norm(change - np.outer(steps, gradient @ direction), axis=1)
        slopes = np.log2(rest[:-1] / rest[1:])
        np.testing.assert_allclose(slopes, 2, atol=0.15)


@every_kind
def test_the_sensitivities_are_the_derivatives_for_single_samples(order, profile, near_field):
    palpation = model(order, profile, near_field)
    field = modulus(palpation.points_m, THETA)
    sensitivity = palpation.evaluate(field).sensitivity
    assert sensitivity.shape == (3, len(field))
    below = np.linalg.norm(palpation.points_m - POINTS[1], axis=1)
    for p in (*np.argsort(below)[:2], int(np.argmax(below))):
        step = 1e-3 * field[p] * np.eye(len(field))[p]
        up, down = (palpation.evaluate(field + s).compliance for s in (step, -step))
        central = (up - down) / (2 * step[p])
        np.testing.assert_allclose(
            sensitivity[:, p], central, rtol=1e-4, atol=1e-6 * abs(sensitivity).max()
        )


@every_kind
def test_a_stiffer_body_scales_every_compliance_and_the_sensitivities_add_up(
    order, profile, near_field
):
    palpation = model(order, profile, near_field)
    field = modulus(palpation.points_m, THETA)
    response = palpation.evaluate(field)
    scaled = palpation.evaluate(7.5 * field)
    np.testing.assert_allclose(7.5 * scaled.compliance, response.compliance, rtol=1e-9)
    # Euler: C is homogeneous of degree -1 in E
    np.testing.assert_allclose(response.sensitivity @ field, -response.compliance, rtol=1e-6)
    if not near_field:  # the energy of a sample cannot be negative
        assert response.sensitivity.max() <= 0


def test_one_number_stands_for_a_homogeneous_body():
    palpation = model(2, "flat", True)
    everywhere = palpation.evaluate(np.full(len(palpation.points_m), 4e3))
    np.testing.assert_array_equal(palpation.evaluate(4e3).compliance, everywhere.compliance)


@pytest.mark.parametrize("order", [1, 2])
def test_what_a_press_does_elsewhere_is_reciprocal(order):
    palpation = model(order, "flat", False)
    response = palpation.evaluate(modulus(palpation.points_m, THETA))
    weights = contact_weights(palpation.mesh, palpation.contacts)
    fields = np.array([response.displacement(j) for j in range(3)])
    assert not fields[:, palpation.mesh.surface_nodes("base")].any()
    matrix = np.einsum("ina,jna->ij", weights, fields)
    np.testing.assert_allclose(np.diag(matrix), response.compliance, rtol=1e-10)
    np.testing.assert_allclose(matrix, matrix.T, rtol=1e-9)
    assert (np.diag(matrix) > abs(matrix - np.diag(np.diag(matrix))).max()).all()


def test_with_the_near_field_distant_presses_stay_reciprocal():
    palpation = model(2, "flat", True)
    response = palpation.evaluate(modulus(palpation.points_m, THETA))
    weights = contact_weights(palpation.mesh, palpation.contacts)
    ij = weights[0].ravel() @ response.displacement(2).ravel()
    ji = weights[2].ravel() @ response.displacement(0).ravel()
    assert ij == pytest.approx(ji, rel=0.04)


@every_kind
def test_units_do_not_matter(order, profile, near_field):
    metres = model(order, profile, near_field)
    contacts = metres.contacts
    millimetres = PalpationModel(
        Mesh(1e3 * metres.mesh.nodes, metres.mesh.cells, metres.mesh.surfaces),
        0.4,
        Contacts(1e3 * contacts.points_m, DOWN, 1e3 * contacts.radius_m, profile),
        near_field=near_field,
    )
    field = modulus(metres.points_m, THETA)
    in_metres = metres.evaluate(field).compliance
    in_millimetres = millimetres.evaluate(1e-6 * field).compliance  # N/mm^2
    np.testing.assert_allclose(in_millimetres, 1e3 * in_metres, rtol=1e-6)


@settings(max_examples=8, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    order=st.sampled_from([1, 2]),
    near_field=st.booleans(),
    shift=st.tuples(*[st.floats(-0.2, 0.2)] * 3),
    quarter_turns=st.integers(0, 3),
)
def test_neither_the_numbering_nor_the_frame_matters(seed, order, near_field, shift, quarter_turns):
    rng = np.random.default_rng(seed)
    mesh = block_mesh(SIZE, (4, 3, 2), order=order)
    contacts = Contacts(
        np.column_stack([rng.uniform(0.02, 0.05, (2, 2)), [0.05, 0.05]]),
        DOWN,
        rng.uniform(0.002, 0.015, 2),
        rng.choice(["flat", "hertz"]),
    )
    new = rng.permutation(len(mesh.nodes))
    cells = rng.permutation(len(mesh.cells))
    rotation = Rotation.from_euler("z", 90 * quarter_turns, degrees=True)
    nodes = np.empty_like(mesh.nodes)
    nodes[new] = rotation.apply(mesh.nodes.copy()) + shift
    surfaces = {"base": new[mesh.surface("base")]}
    moved = PalpationModel(
        Mesh(nodes, new[mesh.cells[cells]], surfaces),
        0.45,
        Contacts(rotation.apply(contacts.points_m.copy()) + shift, DOWN, contacts.radius_m,
                 contacts.profile),
        near_field=near_field,
    )  # fmt: skip
    still = PalpationModel(mesh, 0.45, contacts, near_field=near_field)
    waves, phases = rng.uniform(-100, 100, (3, 8)), rng.uniform(0, 6, 8)

    def field(points: np.ndarray) -> np.ndarray:
        return 8e3 + 700 * np.sin(points @ waves + phases).sum(axis=1)

    expected = still.evaluate(field(still.points_m)).compliance
    back = rotation.inv().apply(moved.points_m - shift)
    np.testing.assert_allclose(moved.evaluate(field(back)).compliance, expected, rtol=1e-6)


@settings(max_examples=6, deadline=None)
@given(turn=st.tuples(*[st.floats(-3, 3)] * 3))
def test_a_tilted_body_answers_alike_to_the_accuracy_of_the_quadrature(turn):
    # The quadrature of disc and rim turns about the tip's axis: that is all that may change
    rotation = Rotation.from_rotvec(turn)
    still = model(2, "flat", True)
    moved = PalpationModel(
        Mesh(rotation.apply(still.mesh.nodes.copy()), still.mesh.cells, still.mesh.surfaces),
        0.4,
        Contacts(rotation.apply(POINTS), rotation.apply(DOWN), still.contacts.radius_m),
    )
    field = modulus(still.points_m, THETA)
    np.testing.assert_allclose(
        moved.evaluate(field).compliance, still.evaluate(field).compliance, rtol=1e-3
    )


@settings(max_examples=10, deadline=None)
@given(
    radius=st.floats(0.002, 0.012),
    low=st.floats(1e2, 1e6),
    contrast=st.floats(1, 20),
    seed=st.integers(0, 2**31),
)
def test_a_body_between_two_moduli_has_a_compliance_between(radius, low, contrast, seed):
    mesh = block_mesh(SIZE, (5, 4, 3), order=2)
    palpation = PalpationModel(mesh, 0.45, Contacts(POINTS[:2], DOWN, radius))
    field = low * np.random.default_rng(seed).uniform(1, contrast, len(palpation.points_m))
    between = palpation.evaluate(field).compliance
    soft = palpation.evaluate(low).compliance
    assert (between <= soft * (1 + 1e-9)).all()
    assert (between >= soft / contrast * (1 - 1e-9)).all()


@pytest.mark.parametrize("value", [0.0, -5.0, np.nan, np.inf])
def test_a_modulus_that_is_not_positive_and_finite_is_refused(value):
    palpation = model(1, "flat", True)
    field = np.full(len(palpation.points_m), 5e3)
    field[17] = value
    with pytest.raises(SolverError, match="must be positive and finite"):
        palpation.evaluate(field)


def test_a_modulus_of_another_length_is_refused():
    palpation = model(1, "flat", True)
    with pytest.raises(SolverError, match="one at each of the model's points_m"):
        palpation.evaluate(np.ones(len(palpation.points_m) - 1))


def test_arrays_changed_after_the_call_do_not_change_the_derivatives():
    palpation = model(1, "flat", True)
    modulus = np.linspace(4e3, 9e3, len(palpation.points_m))
    strength = 0.1 * modulus
    expected = palpation.evaluate(modulus, fibres=((1, 0, 0), strength)).sensitivity
    response = palpation.evaluate(modulus, fibres=((1, 0, 0), strength))
    unevenness = palpation.evaluate(modulus).unevenness
    late = palpation.evaluate(modulus)
    modulus[:], strength[:] = 1.0, 0.0
    np.testing.assert_array_equal(response.sensitivity, expected)
    np.testing.assert_array_equal(late.unevenness, unevenness)
    for array in (response.compliance, response.amplitude):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0.0


def test_an_unknown_support_is_refused_with_the_known_ones():
    with pytest.raises(MeshError, match="no surface 'floor'; it has: base, sides, top"):
        PalpationModel(block_mesh(SIZE, (2, 2, 2)), 0.4, Contacts(POINTS, DOWN, 0.004), "floor")


def test_a_press_on_what_is_held_moves_nothing():
    held = Contacts([(0.0, 0.0, 0.0)], DOWN, 0.0, "nodal")
    model = PalpationModel(block_mesh((0.06, 0.06, 0.03), (4, 4, 2)), 0.45, held)
    response = model.evaluate(5e3)
    assert response.compliance == [0.0]
    assert not response.sensitivity.any()


def test_a_nodal_press_has_no_near_field():
    mesh = block_mesh(SIZE, (3, 2, 2), order=1)
    node = mesh.nodes[mesh.surface_nodes("top")[[4, 5]]]
    contacts = Contacts(node, DOWN, 0.0, "nodal")
    found = [PalpationModel(mesh, 0.4, contacts, near_field=n).evaluate(5e3) for n in (True, False)]
    np.testing.assert_array_equal(found[0].compliance, found[1].compliance)
    np.testing.assert_allclose(found[0].sensitivity.sum(axis=1) * 5e3, -found[0].compliance)


@pytest.mark.parametrize(
    ("points", "directions", "radius"),
    [
        (np.zeros((0, 3)), DOWN, 0.004),
        ([(0.0, 0.0)], DOWN, 0.004),
        ([(0.0, 0.0, 0.0)], (0, -1), 0.004),
        ([(0.0, 0.0, 0.0)], DOWN, [0.004, 0.005]),
    ],
)
def test_contacts_of_a_wrong_shape_are_refused(points, directions, radius):
    with pytest.raises(MeshError, match="contacts need points"):
        Contacts(points, directions, radius)


def test_a_mesh_with_a_node_that_is_nowhere_or_in_no_cell_is_refused():
    mesh = block_mesh(SIZE, (2, 2, 2))
    nodes = mesh.nodes.copy()
    nodes[3] = np.nan
    contacts = Contacts(POINTS, DOWN, 0.004)
    with pytest.raises(MeshError, match="Node 3 has the coordinates"):
        PalpationModel(Mesh(nodes, mesh.cells, mesh.surfaces), 0.4, contacts)
    more = np.vstack([mesh.nodes, [[0.0, 0.0, 1.0]]])
    with pytest.raises(MeshError, match="belongs to no cell"):
        PalpationModel(Mesh(more, mesh.cells, mesh.surfaces), 0.4, contacts)


def test_a_press_too_far_off_the_normal_is_refused():
    angle = np.radians(63)
    contacts = Contacts(np.array(POINTS)[:1], (np.sin(angle), 0, -np.cos(angle)), 0.002)
    with pytest.raises(MeshError, match="within 60 degrees of the normal"):
        PalpationModel(block_mesh(SIZE, (4, 4, 2)), 0.4, contacts)


def test_two_meshes_with_other_presses_are_not_extrapolated():
    coarse, fine = block_mesh(SIZE, (2, 2, 2)), block_mesh(SIZE, (4, 4, 4))
    models = [
        PalpationModel(mesh, 0.4, Contacts(POINTS, DOWN, radius), near_field=False)
        for mesh, radius in ((coarse, 0.004), (fine, 0.005))
    ]
    with pytest.raises(MeshError, match="the same presses"):
        RefinedModel(*models)
