"""Solutions in double precision by factors in single precision."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from numpy.testing import assert_allclose

import fem.palpation
from fem import Contacts, PalpationModel, Support, block_mesh
from fem.assembly import Stiffness
from fem.mixed_precision import RTOL, SymmetricMatrix, solve_with_rough_factor
from fem.solver import default_solver

SIZE_M = (0.06, 0.05, 0.03)


def matrix_of(nu: float, contrast: float = 1.0, order: int = 2) -> SymmetricMatrix:
    body = Stiffness(block_mesh(SIZE_M, (4, 3, 2), order=order), nu, ("base",))
    hard = body.points_m[:, 0] > 0.03
    return SymmetricMatrix(
        body.indptr, body.indices, body.values(np.where(hard, 5e3 * contrast, 5e3))
    )


def full(matrix: SymmetricMatrix) -> np.ndarray:
    size = len(matrix.indptr) - 1
    upper = sp.csr_array((matrix.values, matrix.indices, matrix.indptr), (size, size)).toarray()
    return upper + upper.T - np.diag(upper.diagonal())


def rough(matrix: SymmetricMatrix):
    pattern = default_solver().analyse(matrix.indptr, matrix.indices, approximate=True)
    return pattern.factorize(matrix.values)


def loads(size: int, count: int = 5) -> np.ndarray:
    return np.random.default_rng(3).normal(size=(size, count))


def test_products_are_those_of_the_whole_matrix():
    matrix = matrix_of(0.4)
    dense = full(matrix)
    x = loads(len(dense))
    assert_allclose(matrix.product(x[:, 0].copy()), dense @ x[:, 0], rtol=1e-12, atol=1e-9)
    assert_allclose(matrix.products(x.T.copy()), (dense @ x).T, rtol=1e-12, atol=1e-9)


@pytest.mark.parametrize("contrast", [1.0, 100.0])
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("nu", [0.3, 0.45, 0.4999])
def test_every_solution_is_as_exact_as_promised_in_the_energy_norm(nu, order, contrast):
    matrix = matrix_of(nu, contrast, order)
    dense = full(matrix)
    rhs = loads(len(dense))
    found = solve_with_rough_factor(matrix, rough(matrix), rhs)
    assert found is not None
    error = found - np.linalg.solve(dense, rhs)
    energy = np.einsum("nk,nk->k", rhs, np.linalg.solve(dense, rhs))
    assert (np.einsum("nk,nk->k", error, dense @ error) <= (2 * RTOL) ** 2 * energy).all()
    assert_allclose(np.einsum("nk,nk->k", rhs, found), energy, rtol=1e-11)


def test_a_factor_that_is_too_rough_and_an_indefinite_matrix_are_told():
    matrix, other = matrix_of(0.4999, 100.0), matrix_of(0.3, 0.01)
    rhs = loads(len(matrix.indptr) - 1)
    assert solve_with_rough_factor(matrix, rough(other), rhs) is None
    upside_down = matrix._replace(values=-matrix.values)
    assert solve_with_rough_factor(upside_down, rough(matrix), rhs) is None


def test_a_load_of_nothing_moves_nothing():
    matrix = matrix_of(0.4)
    rhs = loads(len(matrix.indptr) - 1)
    rhs[:, 1] = 0.0
    found = solve_with_rough_factor(matrix, rough(matrix), rhs)
    assert found is not None
    assert not found[:, 1].any()
    assert np.isfinite(found).all()


def model_of(support: Support | None) -> PalpationModel:
    contacts = Contacts(
        [(0.02, 0.02, 0.03), (0.03, 0.025, 0.03), (0.04, 0.03, 0.03)], (0, 0, -1), 0.005
    )
    mesh = block_mesh(SIZE_M, (8, 6, 4), order=1)
    return PalpationModel(mesh, 0.49, contacts, near_field=False, support=support)


@pytest.mark.parametrize("support", [None, Support("base", normal=1e-7, tangential=2e-7)])
def test_a_large_body_answers_as_a_small_one_does(monkeypatch, support):
    small = model_of(support)
    modulus = 5e3 + 2e4 * np.exp(-((small.points_m - [0.03, 0.02, 0.02]) ** 2).sum(1) / 2e-4)
    exact = small.evaluate(modulus)
    monkeypatch.setattr(fem.palpation, "LARGE", 0)
    large = model_of(support)
    found = large.evaluate(modulus)
    body = large.floating if support else large._bonded
    assert body.rough is not None
    assert "pattern" not in vars(body)
    assert_allclose(found.compliance, exact.compliance, rtol=1e-11)
    scale = np.abs(exact.sensitivity).max()
    assert_allclose(found.sensitivity, exact.sensitivity, rtol=1e-7, atol=1e-9 * scale)


@pytest.mark.parametrize("contrast", [1e8, 1e10])
def test_where_single_precision_is_not_enough_double_is_taken(monkeypatch, contrast):
    small = model_of(None)
    modulus = np.where(small.points_m[:, 2] > 0.015, contrast, 1.0)  # a hard body on a soft one
    exact = small.evaluate(modulus)
    monkeypatch.setattr(fem.palpation, "LARGE", 0)
    large = model_of(None)
    found = large.evaluate(modulus)
    assert large._bonded.rough is None
    assert_allclose(found.compliance, exact.compliance, rtol=1e-12)
