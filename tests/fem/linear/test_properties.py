"""What must hold for every body, whatever holds it and whatever it is made of."""

from __future__ import annotations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fem.contact.contacts import Contacts
from fem.linear.support import Support
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh
from fem.palpation.model import PalpationModel

SIZE = (0.09, 0.07, 0.05)
DOWN = np.array([0.0, 0.0, -1.0])
UNIT = 0.05 / 5e3  # m/Pa


def some_contacts(rng: np.random.Generator) -> Contacts:
    points = np.column_stack([[0.025, 0.065], rng.uniform(0.02, 0.05, 2), np.full(2, 0.05)])
    return Contacts(points, DOWN, rng.uniform(0.003, 0.008, 2), str(rng.choice(["flat", "hertz"])))


def smooth(rng: np.random.Generator, points: np.ndarray) -> np.ndarray:
    """A modulus of a background and three soft-edged lumps, up to eight times as hard, (p,) Pa."""
    modulus = np.full(len(points), 2e3)
    for centre in rng.uniform([0, 0, 0], SIZE, (3, 3)):
        distance = np.sum((points - centre) ** 2, axis=1)
        weight, radius = rng.uniform(0, 1.4e4), rng.uniform(0.015, 0.04)
        modulus += weight * np.exp(-distance / (2 * radius**2))
    return modulus


@settings(max_examples=4, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    nu=st.sampled_from([0.2, 0.45, 0.49, 0.4999]),
    near_field=st.booleans(),
    order=st.sampled_from([1, 2]),
)
def test_compliance_is_positive_reciprocal_like_one_over_e_and_falls_with_all_that_stiffens(
    seed, nu, near_field, order
):
    rng = np.random.default_rng(seed)
    mesh = block_mesh(SIZE, (4, 3, 2), order=order)
    model = PalpationModel(mesh, nu, some_contacts(rng), near_field=near_field)
    # Between the samples of a near field the modulus is a quadratic: noise there has no meaning
    places = model.points_m
    field = smooth(rng, places) if near_field else rng.uniform(2e3, 2e4, len(places))
    more = smooth(rng, places) / 5 if near_field else rng.uniform(0, 2e3, len(places))
    base = (UNIT * rng.uniform(0, 0.2), UNIT * rng.choice([0.0, 0.3, np.inf]))
    angle = rng.uniform(0, np.pi)
    direction = np.array([np.cos(angle), np.sin(angle), 0])

    def evaluate(scale=1.0, base=base, fibres=0.0, skin=None, add=0.0):
        weak = tuple(s / scale for s in base)
        return model.evaluate(scale * field + add, weak, (direction, scale * fibres), skin)

    start = evaluate(fibres=500.0)
    np.testing.assert_allclose(7 * evaluate(7.0, fibres=500.0).compliance, start.compliance,
                               rtol=1e-6)  # fmt: skip
    cross = start._body.loads.T @ start._free  # travel at one press under 1 N at another, m/N
    own = np.diag(cross).copy()
    cross[np.diag_indices(len(cross))] = start.compliance
    if near_field:  # each press has a space of its own: reciprocal to the accuracy of the mesh
        np.testing.assert_allclose(cross, cross.T, atol=0.05 * cross.max())
    else:
        np.testing.assert_allclose(cross, cross.T, rtol=1e-6, atol=1e-9 * cross.max())
        np.testing.assert_allclose(own, start.compliance, rtol=1e-4)
        assert np.linalg.eigvalsh((cross + cross.T) / 2).min() > 0
    assert (start.compliance > 0).all()
    stiffer = (
        evaluate(fibres=2500.0),
        evaluate(fibres=500.0, add=more),
        evaluate(fibres=500.0, skin=(5e-4, 4.0)),
        evaluate(fibres=500.0, base=(0.5 * base[0], base[1])),
        evaluate(fibres=500.0, base=(base[0], 0.0)),
    )
    for body in stiffer:
        assert (body.compliance <= start.compliance * (1 + 1e-9)).all()
    assert start.sensitivity.sum(axis=1).max() < 0
    assert start.support_sensitivity.min() >= 0


@settings(max_examples=4, deadline=None)
@given(
    seed=st.integers(0, 2**31),
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
    shift=st.tuples(*[st.floats(-0.2, 0.2)] * 3),
)
def test_neither_numbering_nor_a_rigid_motion_matters_to_supports_fibres_and_skin(
    seed, turn, shift
):
    rng = np.random.default_rng(seed)
    mesh = block_mesh(SIZE, (3, 2, 2))
    nodes = mesh.nodes[mesh.surface_nodes("top")[rng.choice(35, 2, replace=False)]]
    direction = Rotation.random(random_state=seed % 1000).apply([1.0, 0, 0])
    rotation = Rotation.from_rotvec(turn)
    new, cells = rng.permutation(len(mesh.nodes)), rng.permutation(len(mesh.cells))
    places = np.empty_like(mesh.nodes)
    places[new] = rotation.apply(mesh.nodes.copy()) + shift
    surfaces = {name: new[faces] for name, faces in mesh.surfaces.items()}
    support = Support(held=("x1",))
    still = PalpationModel(mesh, 0.495, Contacts(nodes, DOWN, 0.004, "nodal"), support=support)
    moved = PalpationModel(
        Mesh(places, new[mesh.cells[cells]], surfaces),
        0.495,
        Contacts(rotation.apply(nodes) + shift, rotation.apply(DOWN), 0.004, "nodal"),
        support=support,
    )
    # Alike in all cells around a node, of which the skin takes one
    field = 5e3 * np.exp(still.points_m @ rng.uniform(-15, 15, 3))
    in_cells, at_contacts = np.split(field, [-len(nodes)])
    other = np.append(in_cells.reshape(len(cells), -1)[cells], at_contacts)
    base = (0.1 * UNIT, 0.4 * UNIT)
    expected = still.evaluate(field, base, (direction, 0.3 * field), (5e-4, 3.0))
    found = moved.evaluate(other, base, (rotation.apply(direction), 0.3 * other), (5e-4, 3.0))
    np.testing.assert_allclose(found.compliance, expected.compliance, rtol=1e-6)
    np.testing.assert_allclose(found.support_sensitivity, expected.support_sensitivity, rtol=1e-5)
    np.testing.assert_allclose(found.skin_sensitivity, expected.skin_sensitivity, rtol=1e-5)
