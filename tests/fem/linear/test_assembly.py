"""Stiffness matrix and strain energies of both elements, on distorted meshes."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.linalg
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

from fem.errors import MeshError
from fem.linear.assembly import (
    Stiffness,
    barycentric_gradients,
    lame,
    shape_derivatives,
    shape_functions,
)
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10

FREE = np.empty((0, 3), int)
ORDERS = (1, 2)
NU = 0.37


def distorted_block(order: int, divisions=(2, 3, 2), seed: int = 3) -> Mesh:
    """Block whose inner and boundary nodes are moved at random, plus a surface without faces."""
    plain = block_mesh((0.9, 1.1, 0.7), divisions, order=1)
    rng = np.random.default_rng(seed)
    step = np.array([0.9, 1.1, 0.7]) / divisions
    nodes = plain.nodes + rng.uniform(-0.15, 0.15, plain.nodes.shape) * step
    mesh = Mesh(nodes, plain.cells, {**plain.surfaces, "nowhere": FREE})
    return promote_to_tet10(mesh) if order == 2 else mesh


def one_cell(order: int) -> Mesh:
    nodes = np.array([(0.1, 0, 0), (1.2, 0.2, -0.1), (0.3, 0.9, 0.2), (-0.2, 0.1, 1.4)])
    mesh = Mesh(nodes, np.array([[0, 1, 2, 3]]), {"nowhere": FREE})
    return promote_to_tet10(mesh) if order == 2 else mesh


def matrix_of(stiffness: Stiffness, modulus: np.ndarray) -> sp.csr_array:
    """Whole matrix from the upper triangle."""
    size = 3 * len(stiffness.free_nodes)
    upper = sp.csr_array(
        (stiffness.values(modulus), stiffness.indices, stiffness.indptr), shape=(size, size)
    )
    assert upper.has_canonical_format
    assert abs(sp.tril(upper, -1)).sum() == 0
    return sp.csr_array(upper + sp.triu(upper, 1).T)


def random_modulus(stiffness: Stiffness, seed: int = 0) -> np.ndarray:
    return np.random.default_rng(seed).uniform(2e3, 9e3, len(stiffness.points_m))


def hooke(strain: np.ndarray, nu: float) -> np.ndarray:
    """Stress for E = 1 by inverting the compliance law, independent of the Lame constants."""
    compliance = np.eye(6)
    compliance[:3, :3] = (1 + nu) * np.eye(3) - nu
    compliance[3:, 3:] *= 2 * (1 + nu)
    voigt = np.array([strain[0, 0], strain[1, 1], strain[2, 2],
                      2 * strain[1, 2], 2 * strain[0, 2], 2 * strain[0, 1]])  # fmt: skip
    xx, yy, zz, yz, xz, xy = np.linalg.solve(compliance, voigt)
    return np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])


def test_lame_constants_are_those_of_uniaxial_tension_and_refuse_the_incompressible():
    for nu in (-0.4, 0.0, 0.3, 0.49):
        lam, mu = lame(nu)
        strain = np.diag([1, -nu, -nu])
        stress = lam * np.trace(strain) * np.eye(3) + 2 * mu * strain
        np.testing.assert_allclose(stress, np.diag([1, 0, 0]), atol=1e-14)
    for nu in (0.5, -1.0, 0.6, float("nan")):
        with pytest.raises(MeshError, match="Poisson's ratio"):
            lame(nu)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("corners", [3, 4])
def test_shape_functions_are_one_at_their_node_and_sum_to_one(order, corners):
    vertices = np.eye(corners)
    pairs = [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)][: 3 if corners == 3 else 6]
    nodes = np.vstack([vertices, [(vertices[i] + vertices[j]) / 2 for i, j in pairs]])
    nodes = vertices if order == 1 else nodes
    np.testing.assert_allclose(shape_functions(nodes, order), np.eye(len(nodes)), atol=1e-15)
    points = np.random.default_rng(1).dirichlet(np.ones(corners), 20)
    np.testing.assert_allclose(shape_functions(points, order).sum(axis=1), 1, rtol=1e-14)


@pytest.mark.parametrize("order", ORDERS)
def test_shape_derivatives_are_those_of_the_shape_functions(order):
    points = np.random.default_rng(2).dirichlet(np.ones(4), 6)
    exact = shape_derivatives(points, order)
    for v in range(4):
        step = 1e-3 * np.eye(4)[v]
        central = shape_functions(points + step, order) - shape_functions(points - step, order)
        np.testing.assert_allclose(exact[:, :, v], central / 2e-3, atol=1e-12)


def test_barycentric_gradients_are_dual_to_the_edges():
    mesh = distorted_block(1)
    gradients, v = barycentric_gradients(mesh.nodes, mesh.cells), mesh.nodes[mesh.cells]
    products = np.einsum("eai,ebi->eab", gradients, v - v[:, :1])
    expected = np.tile(np.eye(4) - np.eye(4)[:, :1] @ np.ones((1, 4)), (len(v), 1, 1))
    expected[:, 0] = [0, -1, -1, -1]
    expected[:, 1:] = np.eye(4)[1:]
    np.testing.assert_allclose(products, expected, atol=1e-12)


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("nu", [NU, 0.4999])
def test_patch_test_a_linear_field_has_the_same_exact_strain_in_every_cell(order, nu):
    mesh = distorted_block(order)
    stiffness = Stiffness(mesh, nu, "nowhere")
    rng = np.random.default_rng(7)
    slopes = rng.normal(size=(9, 3, 3))  # asymmetric: rotations are in them
    fields = mesh.nodes @ slopes.transpose(0, 2, 1) + rng.normal(size=(9, 1, 3))
    energies = stiffness.energies(fields).reshape(9, len(mesh.cells), stiffness.samples)
    weights = mesh.cell_volumes[:, None] * stiffness.rule[1]
    for slope, energy in zip(slopes, energies, strict=True):
        strain = (slope + slope.T) / 2
        np.testing.assert_allclose(energy, weights * np.sum(hooke(strain, nu) * strain), rtol=1e-8)


@pytest.mark.parametrize("order", ORDERS)
def test_patch_test_inner_nodes_of_a_uniform_body_follow_a_linear_boundary(order):
    mesh = distorted_block(order, divisions=(3, 3, 3))
    stiffness = Stiffness(mesh, NU, "nowhere")
    matrix = matrix_of(stiffness, np.full(len(stiffness.points_m), 4e3))
    slope = np.random.default_rng(8).normal(size=(3, 3))
    exact = (mesh.nodes @ slope.T).ravel()
    held = np.repeat(np.isin(np.arange(len(mesh.nodes)), mesh.boundary), 3)
    assert (~held).sum() >= 24
    inner = matrix[~held][:, ~held].toarray()
    solved = np.linalg.solve(inner, -matrix[~held][:, held] @ exact[held])
    np.testing.assert_allclose(solved, exact[~held], atol=1e-11 * abs(exact).max())
    # The nodal forces of the boundary are the tractions of the exact stress
    stress = 4e3 * hooke((slope + slope.T) / 2, NU)
    forces = (matrix @ exact).reshape(-1, 3)
    virial = np.einsum("na,nb->ab", forces, mesh.nodes)
    np.testing.assert_allclose(virial, stress * mesh.volume, atol=1e-9 * abs(virial).max())


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("make", [one_cell, distorted_block])
def test_exactly_six_modes_have_no_energy_and_they_are_the_rigid_ones(order, make):
    mesh = make(order)
    stiffness = Stiffness(mesh, NU, "nowhere")
    matrix = matrix_of(stiffness, random_modulus(stiffness)).toarray()
    values = np.linalg.eigvalsh(matrix)
    assert abs(values[:6]).max() < 1e-12 * values[-1]
    assert values[6] > 1e-4 * values[-1]
    axes = np.eye(3)
    rigid = [np.broadcast_to(a, mesh.nodes.shape) for a in axes]
    rigid += [np.cross(a, mesh.nodes) for a in axes]
    for field in rigid:
        assert abs(matrix @ field.ravel()).max() < 1e-12 * values[-1] * abs(field).max()
        assert abs(stiffness.energies(field[None])).max() < 1e-14


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49, 0.4999])
def test_the_matrix_of_a_supported_body_is_positive_definite(order, nu):
    stiffness = Stiffness(distorted_block(order), nu, "base")
    matrix = matrix_of(stiffness, random_modulus(stiffness)).toarray()
    assert np.linalg.eigvalsh(matrix)[0] > 0
    scipy.linalg.cholesky(matrix)


@pytest.mark.parametrize("order", ORDERS)
def test_a_held_surface_takes_its_nodes_out_and_changes_nothing_else(order):
    mesh = distorted_block(order)
    whole, held = Stiffness(mesh, NU, "nowhere"), Stiffness(mesh, NU, "base")
    modulus = random_modulus(whole)
    keep = (3 * held.free_nodes[:, None] + np.arange(3)).ravel()
    inner = matrix_of(whole, modulus)[keep][:, keep]
    np.testing.assert_array_equal(
        np.setdiff1d(np.arange(len(mesh.nodes)), held.free_nodes), mesh.surface_nodes("base")
    )
    np.testing.assert_allclose(
        matrix_of(held, modulus).toarray(), inner.toarray(), rtol=1e-12, atol=1e-12
    )
    nodal = np.random.default_rng(4).normal(size=(2, *mesh.nodes.shape))
    back = held.prolong(held.restrict(nodal))
    np.testing.assert_array_equal(back[:, held.free_nodes], nodal[:, held.free_nodes])
    assert not back[:, mesh.surface_nodes("base")].any()


@pytest.mark.parametrize("order", ORDERS)
def test_refilling_for_a_new_modulus_equals_assembling_afresh(order):
    mesh = distorted_block(order)
    used = Stiffness(mesh, NU)
    first = used.values(random_modulus(used, 1))
    kept = first.copy()
    modulus = random_modulus(used, 2)
    refilled, fresh = used.values(modulus), Stiffness(mesh, NU).values(modulus)
    np.testing.assert_array_equal(refilled, fresh)
    np.testing.assert_array_equal(first, kept)
    assert abs(refilled - first).max() > 0.1 * abs(first).max()


@pytest.mark.parametrize("order", ORDERS)
def test_the_matrix_is_linear_in_the_modulus_samples(order):
    stiffness = Stiffness(distorted_block(order), NU)
    a, b = random_modulus(stiffness, 1), random_modulus(stiffness, 2)
    combined = stiffness.values(0.3 * a + 5.0 * b)
    expected = 0.3 * stiffness.values(a) + 5.0 * stiffness.values(b)
    np.testing.assert_allclose(combined, expected, rtol=1e-10, atol=1e-12 * abs(expected).max())


@pytest.mark.parametrize("order", ORDERS)
@pytest.mark.parametrize("nu", [NU, 0.4999])
def test_the_energies_of_the_samples_split_the_quadratic_form_of_the_matrix(order, nu):
    mesh = distorted_block(order)
    stiffness = Stiffness(mesh, nu, "nowhere")
    fields = np.random.default_rng(5).normal(size=(3, *mesh.nodes.shape))
    energies = stiffness.energies(fields)
    assert energies.shape == (3, len(stiffness.points_m))
    for seed in (1, 2):
        modulus = random_modulus(stiffness, seed)
        matrix = matrix_of(stiffness, modulus)
        total = [u.ravel() @ (matrix @ u.ravel()) for u in fields]
        np.testing.assert_allclose(energies @ modulus, total, rtol=1e-11)
    # ... sample by sample, not only in sum
    for sample in (0, 17, len(modulus) - 1):
        alone = matrix_of(stiffness, np.eye(len(modulus))[sample])
        expected = [u.ravel() @ (alone @ u.ravel()) for u in fields]
        np.testing.assert_allclose(energies[:, sample], expected, rtol=1e-10)


@pytest.mark.parametrize("order", ORDERS)
def test_modulus_samples_lie_inside_their_own_cells(order):
    mesh = distorted_block(order)
    stiffness = Stiffness(mesh, NU)
    points = stiffness.points_m.reshape(len(mesh.cells), -1, 3)
    v = mesh.nodes[mesh.cells[:, :4]]
    inner = np.einsum(
        "eqi,eai->eqa", points - v[:, :1], barycentric_gradients(mesh.nodes, mesh.cells)
    )
    inner[..., 0] += 1
    assert inner.min() > 0.1
    # The samples integrate linear functions of place
    total = np.einsum("e,q,eqi->i", mesh.cell_volumes, stiffness.rule[1], points)
    expected = np.einsum("e,evi->i", mesh.cell_volumes, v) / 4
    np.testing.assert_allclose(total, expected, rtol=1e-12)


@settings(max_examples=15, deadline=None)
@given(seed=st.integers(0, 2**31), order=st.sampled_from(ORDERS))
def test_the_numbering_of_the_nodes_does_not_matter(seed, order):
    mesh = distorted_block(order, (1, 2, 1))
    rng = np.random.default_rng(seed)
    new = rng.permutation(len(mesh.nodes))  # new number of each old node
    nodes = np.empty_like(mesh.nodes)
    nodes[new] = mesh.nodes
    surfaces = {"base": new[mesh.surface("base")]}
    other = Stiffness(Mesh(nodes, new[mesh.cells], surfaces), NU)
    stiffness = Stiffness(mesh, NU)
    modulus = random_modulus(stiffness, seed)
    place = np.searchsorted(other.free_nodes, new[stiffness.free_nodes])
    dofs = (3 * place[:, None] + np.arange(3)).ravel()
    reordered = matrix_of(other, modulus).toarray()[np.ix_(dofs, dofs)]
    expected = matrix_of(stiffness, modulus).toarray()
    np.testing.assert_allclose(reordered, expected, atol=1e-12 * abs(expected).max())


def test_an_inverted_cell_is_refused_by_number():
    mesh = block_mesh((1, 1, 1), (1, 1, 1), order=1)
    cells = mesh.cells.copy()
    cells[4, [0, 1]] = cells[4, [1, 0]]
    with pytest.raises(MeshError, match="cell 4 has volume -"):
        Stiffness(Mesh(mesh.nodes, cells, mesh.surfaces), 0.3)
