"""Forces and tangent of a hyperelastic mesh: consistency, patch test, rotation, linear limit."""

import numpy as np
import pytest
import scipy.sparse as sp

from fem.finite_strain.assembly import FiniteStrainBody
from fem.finite_strain.hyperelastic import Fung, NeoHookean, Yeoh
from fem.linear.assembly import Stiffness
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from tests.fem.reference.material_point import material_point

NU = 0.42
LAWS = [NeoHookean(), Yeoh(0.6), Fung(0.9)]
FREE = np.empty((0, 3), int)
SIZE = np.array([0.9, 1.1, 0.7])
every_law = pytest.mark.parametrize("law", LAWS, ids=lambda law: type(law).__name__)
every_element = pytest.mark.parametrize(
    ("order", "mean"), [(1, False), (2, False), (2, True)], ids=["tet4", "tet10", "tet10 mean"]
)


def distorted_block(order: int, base_held: bool) -> Mesh:
    plain = block_mesh(SIZE, (2, 3, 2), order=1)
    moves = np.random.default_rng(3).uniform(-0.15, 0.15, plain.nodes.shape)
    nodes = plain.nodes + moves * SIZE / (2, 3, 2)
    surfaces = {"base": plain.surfaces["base"] if base_held else FREE}
    mesh = Mesh(nodes, plain.cells, surfaces)
    return promote_to_tet10(mesh) if order == 2 else mesh


def body_of(law, order: int, mean: bool, base_held: bool = False) -> FiniteStrainBody:
    return FiniteStrainBody(distorted_block(order, base_held), NU, law, mean_dilatation=mean)


def random_state(body: FiniteStrainBody, size: float) -> np.ndarray:
    """A smooth displacement with some roughness."""
    x = body.mesh.nodes[body.stiffness.free_nodes]
    rng = np.random.default_rng(8)
    smooth = x @ rng.normal(size=(3, 3)).T + np.sin(2 * x @ rng.normal(size=(3, 3)).T)
    return (size * (smooth + 0.1 * rng.normal(size=x.shape))).ravel()


def random_modulus(body: FiniteStrainBody) -> np.ndarray:
    return np.random.default_rng(1).uniform(2e3, 9e3, len(body.stiffness.points_m))


def matrix(body: FiniteStrainBody, values: np.ndarray) -> sp.csr_array:
    s = body.stiffness
    upper = sp.csr_array((values, s.indices, s.indptr), shape=(body.size, body.size))
    return sp.csr_array(upper + sp.triu(upper, 1).T)


@every_law
@every_element
def test_forces_and_tangent_are_derivatives_of_the_energy(law, order, mean):
    body = body_of(law, order, mean, base_held=True)
    u, modulus = random_state(body, 0.04), random_modulus(body)
    force, energy = body.internal_force(u, modulus)
    assert 0 < energy < np.inf
    tangent = matrix(body, body.tangent_values(u, modulus))
    rng = np.random.default_rng(2)
    step = 1e-6
    for direction in rng.normal(size=(3, body.size)):
        up, down = (body.internal_force(u + s * direction, modulus) for s in (step, -step))
        assert force @ direction == pytest.approx((up[1] - down[1]) / (2 * step), rel=1e-6)
        central = (up[0] - down[0]) / (2 * step)
        scale = np.abs(central).max()
        np.testing.assert_allclose(tangent @ direction, central, atol=1e-7 * scale)


@every_law
@every_element
def test_forces_are_proportional_to_the_moduli_and_their_derivative(law, order, mean):
    body = body_of(law, order, mean)
    u, modulus = random_state(body, 0.04), random_modulus(body)
    z = np.random.default_rng(6).normal(size=body.size)
    by_sample = body.sensitivity(u, z)
    force, _ = body.internal_force(u, modulus)
    assert by_sample @ modulus == pytest.approx(force @ z, rel=1e-11)
    one = np.zeros(len(modulus))
    one[7] = 1e3
    assert by_sample[7] * 1e3 == pytest.approx(body.internal_force(u, one)[0] @ z, rel=1e-9)


@every_law
@every_element
def test_homogeneous_deformation_passes_the_patch_test(law, order, mean):
    body = body_of(law, order, mean)
    f = np.eye(3) + np.random.default_rng(9).uniform(-0.3, 0.3, (3, 3))
    u = (body.mesh.nodes @ (f - np.eye(3)).T).ravel()
    force, energy = body.internal_force(u, np.full(len(body.stiffness.points_m), 4e3))
    nodal = force.reshape(-1, 3)
    inner = np.setdiff1d(np.arange(len(nodal)), np.unique(body.mesh.boundary))
    assert len(inner) >= 2
    point = material_point(law, NU, f[None])
    scale = np.abs(nodal).max()
    np.testing.assert_allclose(nodal[inner], 0, atol=1e-13 * scale)
    assert energy == pytest.approx(4e3 * point.energy[0] * body.mesh.volume, rel=1e-12)
    # virial: sum of force x position is the stress times the volume
    virial = nodal.T @ body.mesh.nodes
    np.testing.assert_allclose(
        virial, 4e3 * point.stress[0] * body.mesh.volume, atol=1e-11 * np.abs(virial).max()
    )


@every_law
@every_element
def test_a_turned_body_is_free_of_stress(law, order, mean):
    body = body_of(law, order, mean)
    q, _ = np.linalg.qr(np.random.default_rng(11).normal(size=(3, 3)))
    turn = q * np.sign(np.linalg.det(q))
    x = body.mesh.nodes
    force, energy = body.internal_force((x @ turn.T + 0.3 - x).ravel(), random_modulus(body))
    assert np.abs(force).max() < 1e-10 * 9e3
    assert abs(energy) < 1e-10 * 9e3
    # ... and one that is strained first, and then turned, carries its forces with it
    u = random_state(body, 0.04)
    y = x + u.reshape(-1, 3)
    before, _ = body.internal_force(u, random_modulus(body))
    after, _ = body.internal_force((y @ turn.T - x).ravel(), random_modulus(body))
    expected = before.reshape(-1, 3) @ turn.T
    np.testing.assert_allclose(after.reshape(-1, 3), expected, atol=1e-11 * np.abs(before).max())


@every_law
@pytest.mark.parametrize("order", [1, 2])
def test_the_tangent_at_rest_is_the_linear_stiffness_matrix(law, order):
    body = body_of(law, order, mean=False, base_held=True)
    linear = Stiffness(body.mesh, NU)
    modulus = random_modulus(body)
    values = linear.values(modulus)
    at_rest = body.tangent_values(np.zeros(body.size), modulus)
    np.testing.assert_allclose(at_rest, values, atol=1e-14 * np.abs(values).max())
    u = random_state(body, 0.04)
    energies = linear.energies(linear.prolong(u[:, None]))[0]
    np.testing.assert_allclose(body.linear_energies(u), energies, atol=1e-14 * energies.max())


def test_mean_dilatation_energies_at_rest_are_those_of_its_tangent():
    body = body_of(NeoHookean(), 2, mean=True, base_held=True)
    u, modulus = random_state(body, 0.04), random_modulus(body)
    stored = u @ (matrix(body, body.tangent_values(0 * u, modulus)) @ u)
    # the samples share one dilatation: their energies are taken with weights of one each
    assert body.linear_energies(u) @ modulus == pytest.approx(stored, rel=1e-12)


def test_an_inverted_cell_has_infinite_energy():
    body = body_of(NeoHookean(), 2, mean=False)
    u = np.zeros((len(body.mesh.nodes), 3))
    u[:, 2] = -1.2 * body.mesh.nodes[:, 2]
    assert body.internal_force(u.ravel(), random_modulus(body))[1] == np.inf
