"""Solutions of large bodies by preconditioners in single precision."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, Support, block_mesh
from fem.errors import SolverError
from fem.linear.assembly import Stiffness
from fem.mesh.mesh import Mesh
from fem.solve.block_matrix import BlockMatrix
from fem.solve.direct import Solver, SuperLUSolver, default_solver
from fem.solve.mixed_precision import RTOL, SinglePrecisionFactors, conjugate_gradients
from fem.solve.two_grid import TwoGrid, trilinear
from tests.long import long

SIZE_M = (0.06, 0.05, 0.03)
COUNT = 5  # vectors


class Body:
    """A block, hard on one side, held at its base."""

    def __init__(
        self, nu: float, contrast: float = 1.0, order: int = 2, parts: tuple = (4, 3, 2),
        curved: bool = False,
    ) -> None:  # fmt: skip
        mesh = block_mesh(SIZE_M, parts, order=order)
        if curved:  # a cap: much of the box around it is empty
            x, y, z = (2 * mesh.nodes / SIZE_M - (1, 1, 0)).T
            z *= 1 - 0.7 * np.maximum(x**2, y**2)
            nodes = np.stack([x * np.sqrt(1 - y**2 / 2), y * np.sqrt(1 - x**2 / 2), z], axis=1)
            mesh = Mesh(nodes * SIZE_M, mesh.cells, mesh.surfaces)
        self.stiffness = Stiffness(mesh, nu, ("base",))
        hard = self.stiffness.points_m[:, 0] > 0.03
        self.values = self.stiffness.values(np.where(hard, 5e3 * contrast, 5e3))
        self.pattern = self.stiffness.indptr, self.stiffness.indices
        self.matrix = BlockMatrix.of_upper(*self.pattern, self.values)

    def dense(self) -> np.ndarray:
        """The matrix, from its upper triangle."""
        indptr, indices = self.pattern
        size = len(indptr) - 1
        upper = sp.csr_array((self.values, indices, indptr), (size, size)).toarray()
        return upper + upper.T - np.diag(upper.diagonal())

    def rough(self):
        """Factors in single precision."""
        solver = default_solver()
        factors = SinglePrecisionFactors(lambda: solver.analyse(*self.pattern, approximate=True))
        return factors.prepare(self.matrix, self.values)

    def two_grids(self):
        """Smoothing and a coarse grid."""
        nodes = self.stiffness.mesh.nodes[self.stiffness.free_nodes]
        return TwoGrid(nodes, default_solver()).prepare(self.matrix, self.values)

    def loads(self) -> np.ndarray:
        """Forces (n, COUNT) without order."""
        return np.random.default_rng(3).normal(size=(3 * len(self.stiffness.free_nodes), COUNT))


def blocks_of(vectors: np.ndarray) -> np.ndarray:
    return np.ascontiguousarray(vectors).reshape(-1, 3, vectors.shape[1])


@pytest.mark.slow
def test_products_and_diagonal_are_those_of_the_whole_matrix():
    body = Body(0.4)
    dense, x = body.dense(), body.loads()
    product = body.matrix.products(blocks_of(x), np.empty((len(x) // 3, 3, COUNT)))
    assert_allclose(product.reshape(x.shape), dense @ x, rtol=1e-12, atol=1e-9)
    single = blocks_of(x).astype(np.float32)
    rough = body.matrix.single().products(single, np.empty_like(single))
    assert rough.dtype == np.float32
    assert_allclose(rough, product, atol=1e-5 * abs(product).max())
    for i, block in enumerate(body.matrix.diagonal):
        assert_allclose(block, dense[3 * i : 3 * i + 3, 3 * i : 3 * i + 3], rtol=1e-15)


def check_solution(body: Body, precondition, most: int) -> None:
    dense, rhs = body.dense(), body.loads()
    found = conjugate_gradients(body.matrix, precondition, rhs, most)
    exact = np.linalg.solve(dense, rhs)
    error, energy = found - exact, np.einsum("nk,nk->k", rhs, exact)
    assert (np.einsum("nk,nk->k", error, dense @ error) <= (2 * RTOL) ** 2 * energy).all()
    # near nu = 0.5 rounding alone makes 1e-11, in the dense solution as in this one
    assert_allclose(np.einsum("nk,nk->k", rhs, found), energy, rtol=3e-11)


@pytest.mark.parametrize("contrast", [1.0, 100.0])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("nu", [0.3, 0.4999, *long(0.45)])
def test_rough_factors_solve_as_exactly_as_promised_in_the_energy_norm(nu, order, contrast):
    body = Body(nu, contrast, order)
    check_solution(body, body.rough(), SinglePrecisionFactors.most)


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize(
    ("nu", "contrast"), [(0.45, 100.0), (0.49, 1.0), *long((0.0, 1.0), (0.3, 1.0), (0.45, 1.0))]
)
def test_two_grids_solve_as_exactly_as_promised_in_the_energy_norm(nu, contrast, order):
    body = Body(nu, contrast, order, (8, 7, 4) if order == 1 else (4, 3, 2))
    check_solution(body, body.two_grids(), TwoGrid.most)


def test_two_grids_are_symmetric_and_close_to_the_inverse():
    body = Body(0.4, order=1, parts=(6, 5, 4))
    dense = body.dense()
    precondition = body.two_grids()
    approximate = precondition(blocks_of(np.eye(len(dense), dtype=np.float32)))
    approximate = approximate.reshape(dense.shape).astype(float)
    assert_allclose(approximate, approximate.T, atol=2e-5 * np.abs(approximate).max())
    eigenvalues = np.linalg.eigvals(approximate @ dense).real
    assert 0.3 < eigenvalues.min() < eigenvalues.max() < 1.2


class Counted:
    """A preconditioner that counts its calls."""

    def __init__(self, precondition) -> None:
        self.precondition, self.calls = precondition, 0

    def __call__(self, residual):
        self.calls += 1
        return self.precondition(residual)


def test_a_mesh_twice_as_fine_needs_hardly_more_iterations_with_two_grids():
    calls = []
    for parts in ((14, 11, 7), (28, 22, 14)):
        body = Body(0.4, order=1, parts=parts)
        counted = Counted(body.two_grids())
        conjugate_gradients(body.matrix, counted, body.loads(), TwoGrid.most)
        calls.append(counted.calls)
    assert calls[1] <= 1.25 * calls[0]
    assert calls[1] < 20


def test_the_coarse_grid_takes_no_notice_of_the_shape():
    body = Body(0.4, order=1, parts=(16, 14, 8), curved=True)
    counted = Counted(body.two_grids())
    rhs = body.loads()
    found = conjugate_gradients(body.matrix, counted, rhs, TwoGrid.most)
    product = body.matrix.products(blocks_of(found), np.empty((len(rhs) // 3, 3, COUNT)))
    assert_allclose(product.reshape(rhs.shape), rhs, atol=1e-6 * np.abs(rhs).max())
    assert counted.calls < 28


def test_the_coarse_grid_holds_every_linear_displacement():
    nodes = np.random.default_rng(2).uniform((-0.1, 0, 0.2), (0.1, 0.05, 0.25), (4000, 3))
    functions = trilinear(nodes)
    assert_allclose(functions.sum(axis=1), 1, atol=1e-6)
    assert functions.shape[1] < len(nodes) / 8
    for values in nodes.T:
        found = np.linalg.lstsq(functions.toarray().astype(float), values, rcond=None)[0]
        assert_allclose(functions @ found, values, atol=1e-6)


def test_a_factor_that_is_too_rough_and_an_indefinite_matrix_are_told():
    body, other = Body(0.4999, 100.0), Body(0.3, 0.01)
    with pytest.raises(SolverError, match="iterations"):
        conjugate_gradients(body.matrix, other.rough(), body.loads(), SinglePrecisionFactors.most)
    upside_down = body.matrix._replace(blocks=-body.matrix.blocks)
    with pytest.raises(SolverError, match="positive definite"):
        conjugate_gradients(upside_down, body.rough(), body.loads(), SinglePrecisionFactors.most)


def test_what_would_take_too_many_iterations_is_given_up_early():
    body = Body(0.4999, order=1, parts=(16, 14, 8))
    counted = Counted(body.two_grids())
    with pytest.raises(SolverError, match="iterations"):
        conjugate_gradients(body.matrix, counted, body.loads(), TwoGrid.most)
    assert counted.calls < TwoGrid.most / 2


def test_a_load_of_nothing_moves_nothing():
    body = Body(0.4)
    rhs = body.loads()
    rhs[:, 1] = 0.0
    for precondition in (body.rough(), body.two_grids()):
        found = conjugate_gradients(body.matrix, precondition, rhs, TwoGrid.most)
        assert not found[:, 1].any()
        assert np.isfinite(found).all()


def model_of(
    support: Support | None, nu: float, solver: Solver | None = None, **options: int
) -> PalpationModel:
    contacts = Contacts(
        [(0.02, 0.02, 0.03), (0.03, 0.025, 0.03), (0.04, 0.03, 0.03)], (0, 0, -1), 0.005
    )
    mesh = block_mesh(SIZE_M, (8, 6, 4), order=1)
    return PalpationModel(
        mesh, nu, contacts, near_field=False, support=support, solver=solver, **options
    )


@pytest.mark.parametrize(("nu", "way"), [(0.45, TwoGrid), (0.4999, SinglePrecisionFactors)])
@pytest.mark.parametrize("support", [None, Support("base", normal=1e-7, tangential=2e-7)])
def test_a_large_body_answers_as_a_small_one_does(support, nu, way):
    if way is SinglePrecisionFactors and not default_solver().single_precision:
        pytest.skip("the solver here has no single precision")
    small = model_of(support, nu)
    modulus = 5e3 + 2e4 * np.exp(-((small.points_m - [0.03, 0.02, 0.02]) ** 2).sum(1) / 2e-4)
    exact = small.evaluate(modulus)
    large = model_of(support, nu, iterative_from=0)
    body = large.floating if support else large._bonded
    assert isinstance(body.iterative[0], way)
    found = large.evaluate(modulus)
    assert isinstance(body.iterative[0], way)
    assert "pattern" not in vars(body)
    assert_allclose(found.compliance, exact.compliance, rtol=1e-11)
    scale = np.abs(exact.sensitivity).max()
    assert_allclose(found.sensitivity, exact.sensitivity, rtol=1e-7, atol=1e-9 * scale)


@pytest.mark.parametrize("contrast", [1e8, 1e10])
def test_where_single_precision_is_not_enough_double_is_taken(contrast):
    small = model_of(None, 0.45)
    modulus = np.where(small.points_m[:, 2] > 0.015, contrast, 1.0)  # a hard body on a soft one
    exact = small.evaluate(modulus)
    large = model_of(None, 0.45, iterative_from=0)
    found = large.evaluate(modulus)
    assert large._bonded.iterative == []
    assert_allclose(found.compliance, exact.compliance, rtol=1e-12)


def test_without_single_precision_nothing_is_gained_by_rough_factors():
    for nu, ways in ((0.45, [TwoGrid]), (0.4999, [])):
        body = model_of(None, nu, SuperLUSolver(), iterative_from=0)._bonded
        assert [type(way) for way in body.iterative] == ways
