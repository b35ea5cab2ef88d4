from __future__ import annotations

import gc
import subprocess
import sys
import weakref

import numpy as np
import pytest
import scipy.sparse as sp

import fem.solve.pardiso
from fem.errors import SolverError
from fem.mesh.block import block_mesh
from fem.solve.direct import PardisoSolver, Solver, SuperLUSolver, default_solver
from fem.solve.pardiso import pardiso_works

SOLVERS: list[Solver] = [SuperLUSolver()]
if pardiso_works():
    SOLVERS.append(PardisoSolver())

every_solver = pytest.mark.parametrize("solver", SOLVERS, ids=lambda s: type(s).__name__)


def stiffness_like(seed: int = 0, shift: float = 0.0) -> sp.csr_array:
    """A symmetric matrix over a mesh's edges, three unknowns a node; definite for shift >= 0."""
    cells = block_mesh((0.1, 0.08, 0.05), (4, 3, 2), order=1).cells
    rng = np.random.default_rng(seed)
    n = 3 * (int(cells.max()) + 1)
    dofs = (3 * cells[:, :, None] + np.arange(3)).reshape(len(cells), -1)
    root = rng.normal(size=(len(cells), 12, 12))
    blocks = root @ root.transpose(0, 2, 1)  # positive definite, cell by cell
    rows, columns = np.repeat(dofs, 12, axis=1), np.tile(dofs, (1, 12))
    matrix = sp.coo_array((blocks.ravel(), (rows.ravel(), columns.ravel())), shape=(n, n))
    return sp.csr_array(matrix.tocsr() + shift * sp.eye_array(n))


def upper_of(matrix: sp.csr_array) -> sp.csr_array:
    upper = sp.csr_array(sp.triu(matrix, 0, format="csr"))
    upper.sort_indices()
    return upper


@every_solver
def test_the_solution_of_one_and_of_many_loads_has_a_residual_of_rounding_size(solver):
    matrix = stiffness_like()
    upper = upper_of(matrix)
    loads = np.random.default_rng(1).normal(size=(matrix.shape[0], 7))
    factor = solver.analyse(upper.indptr, upper.indices).factorize(upper.data)
    scale = abs(matrix).max() * np.linalg.cond(matrix.toarray())
    for rhs in (loads, np.asfortranarray(loads), loads[:, ::-2], loads[:, 3], loads[:, :1]):
        x = factor.solve(rhs)
        assert x.shape == rhs.shape
        np.testing.assert_allclose(x, np.linalg.solve(matrix.toarray(), rhs), rtol=1e-8, atol=1e-13)
        np.testing.assert_allclose(matrix @ x, rhs, atol=1e-15 * scale)


@every_solver
def test_new_values_on_the_same_pattern_give_the_new_solution(solver):
    first, second = stiffness_like(0), stiffness_like(5)
    pattern = solver.analyse(upper_of(first).indptr, upper_of(first).indices)
    rhs = np.random.default_rng(2).normal(size=first.shape[0])
    for matrix in (first, second, first):
        x = pattern.factorize(upper_of(matrix).data).solve(rhs)
        np.testing.assert_allclose(x, np.linalg.solve(matrix.toarray(), rhs), rtol=1e-8, atol=1e-13)


@every_solver
def test_two_patterns_do_not_disturb_each_other(solver):
    matrices = [stiffness_like(0), stiffness_like(5)]
    factors = [
        solver.analyse(upper_of(m).indptr, upper_of(m).indices).factorize(upper_of(m).data)
        for m in matrices
    ]
    for matrix, factor in zip(matrices, factors, strict=True):
        expected = np.linalg.solve(matrix.toarray(), np.ones(matrix.shape[0]))
        np.testing.assert_allclose(factor.solve(np.ones(matrix.shape[0])), expected, rtol=1e-8)


@every_solver
def test_changing_the_arrays_after_the_call_does_not_change_the_solution(solver):
    upper = upper_of(stiffness_like())
    rhs = np.ones(upper.shape[0])
    values = upper.data.copy()
    pattern = solver.analyse(upper.indptr, upper.indices)
    factor = pattern.factorize(upper.data)
    before = factor.solve(rhs)
    for array in (upper.indptr, upper.indices, upper.data):
        array[:] = 0
    np.testing.assert_allclose(factor.solve(rhs), before, rtol=1e-12)
    np.testing.assert_allclose(pattern.factorize(values).solve(rhs), before, rtol=1e-12)
    np.testing.assert_array_equal(rhs, 1.0)


@every_solver
@pytest.mark.parametrize("where", ["one", "all", "many"])
def test_an_indefinite_matrix_is_refused_and_the_pattern_stays_usable(solver, where):
    matrix = stiffness_like()
    upper = upper_of(matrix)
    pattern = solver.analyse(upper.indptr, upper.indices)
    bad = upper.copy()
    diagonal = bad.indptr[:-1]
    if where == "one":
        bad.data[diagonal[40]] = -1.0
    elif where == "all":
        bad.data *= -1.0
    else:
        bad.data[diagonal] -= 0.5 * matrix.diagonal().max()
    with pytest.raises(SolverError, match=r"not positive definite.*Young's modulus"):
        pattern.factorize(bad.data)
    rhs = np.ones(matrix.shape[0])
    x = pattern.factorize(upper.data).solve(rhs)
    np.testing.assert_allclose(matrix @ x, rhs, atol=1e-9)


@every_solver
@pytest.mark.parametrize("row", [0, 40, 199])
def test_the_row_of_a_negative_pivot_is_named_counting_from_zero(solver, row):
    diagonal = np.ones(200)
    diagonal[row] = -1.0
    with pytest.raises(SolverError, match=f"pivot of row {row} of 200"):
        solver.analyse(np.arange(201), np.arange(200)).factorize(diagonal)


@every_solver
def test_a_matrix_with_an_exactly_zero_row_is_refused(solver):
    upper = upper_of(stiffness_like())
    upper.data[np.repeat(np.arange(upper.shape[0]), np.diff(upper.indptr)) == 11] = 0.0
    upper.data[upper.indices == 11] = 0.0
    with pytest.raises(SolverError, match=r"singular|not positive definite"):
        solver.analyse(upper.indptr, upper.indices).factorize(upper.data)


@every_solver
def test_wrong_patterns_are_refused_before_the_library_sees_them(solver):
    upper = upper_of(stiffness_like())
    full = stiffness_like()
    full.sort_indices()
    with pytest.raises(SolverError, match="diagonal"):
        solver.analyse(full.indptr, full.indices)
    shuffled = upper.indices.copy()
    shuffled[1:3] = shuffled[2:0:-1]
    with pytest.raises(SolverError, match="rise within each row"):
        solver.analyse(upper.indptr, shuffled)
    outside = upper.indices.copy()
    outside[upper.indptr[5] - 1] = upper.shape[0]
    with pytest.raises(SolverError, match="below n"):
        solver.analyse(upper.indptr, outside)
    with pytest.raises(SolverError, match="indptr"):
        solver.analyse(upper.indptr[:-1], upper.indices)


@every_solver
def test_wrong_values_and_loads_are_refused_with_their_place(solver):
    upper = upper_of(stiffness_like())
    pattern = solver.analyse(upper.indptr, upper.indices)
    values = upper.data.copy()
    values[17] = np.nan
    with pytest.raises(SolverError, match="Entry 17 of the matrix is nan"):
        pattern.factorize(values)
    with pytest.raises(SolverError, match=f"has {upper.nnz} entries"):
        pattern.factorize(values[:-1])
    factor = pattern.factorize(upper.data)
    with pytest.raises(SolverError, match="right-hand side"):
        factor.solve(np.ones(upper.shape[0] + 1))
    with pytest.raises(SolverError, match="right-hand side"):
        factor.solve(np.ones((1, upper.shape[0], 1)))


def test_a_stale_factor_is_never_used_in_silence():
    upper = upper_of(stiffness_like())
    rhs = np.ones(upper.shape[0])
    for solver in SOLVERS:
        pattern = solver.analyse(upper.indptr, upper.indices)
        old = pattern.factorize(upper.data)
        before = old.solve(rhs)
        new = pattern.factorize(2 * upper.data)
        np.testing.assert_allclose(new.solve(rhs), before / 2, rtol=1e-12)
        if isinstance(solver, PardisoSolver):
            with pytest.raises(SolverError, match="stale"):
                old.solve(rhs)
        else:
            np.testing.assert_array_equal(old.solve(rhs), before)


def test_memory_of_a_pattern_is_given_back_when_nobody_uses_it():
    if not pardiso_works():
        pytest.skip("MKL is not installed here")
    upper = upper_of(stiffness_like())
    pattern = PardisoSolver().analyse(upper.indptr, upper.indices)
    factor = pattern.factorize(upper.data)
    assert 8 * upper.nnz < pattern.factor_bytes < 1e8  # type: ignore[attr-defined]
    gone = weakref.ref(pattern)
    before = _mkl_bytes()
    del pattern
    assert gone() is not None  # the factor still needs it
    factor.solve(np.ones(upper.shape[0]))
    del factor
    gc.collect()
    assert gone() is None
    assert _mkl_bytes() < before - 8 * upper.nnz


OTHER_THREADS = """
import numpy as np
from fem.linear.assembly import Stiffness
from fem.mesh.block import block_mesh
from fem.solve.threads import map_over_workers, solver_for_threads
from fem.solve.pardiso import PardisoSolver, _mkl

stiffness = Stiffness(block_mesh((0.1, 0.1, 0.05), (8, 8, 4)), 0.45)
pattern = PardisoSolver(threads=2).analyse(stiffness.indptr, stiffness.indices)
load = np.zeros(len(stiffness.indptr) - 1)
load[-1] = 1.0

def solved(worker, modulus):
    values = stiffness.values(np.full(len(stiffness.points_m), float(modulus)))
    return modulus * worker.factorize(values).solve(load)

expected = solved(pattern, 1)
most = _mkl().MKL_Get_Max_Threads()
one = solver_for_threads(PardisoSolver()).analyse(stiffness.indptr, stiffness.indices)
for worker in (one, pattern):
    for found in (solved(worker, 2), *map_over_workers([worker], lambda w, i: solved(w, 3 + i), 2)):
        np.testing.assert_allclose(found, expected, rtol=1e-9)
assert _mkl().MKL_Get_Max_Threads() == most
assert one.threads == 1
"""


def test_a_pattern_keeps_its_threads_whoever_factorises_and_whatever_others_take():
    if not pardiso_works():
        pytest.skip("MKL is not installed here")
    # in a process of its own: with fewer threads than analysed with, PARDISO crashes
    run = subprocess.run([sys.executable, "-c", OTHER_THREADS], capture_output=True, text=True)
    assert run.returncode == 0, run.stderr


def _mkl_bytes() -> int:
    """Bytes that MKL's memory manager holds in use."""
    import ctypes

    count = ctypes.c_int(0)
    statistics = fem.solve.pardiso._mkl().MKL_Mem_Stat
    statistics.restype = ctypes.c_int64
    return int(statistics(ctypes.byref(count)))


def test_the_default_is_pardiso_where_it_works_and_says_its_version():
    solver = default_solver()
    if pardiso_works():
        assert isinstance(solver, PardisoSolver)
        assert "Math Kernel Library" in solver.name
    else:
        assert isinstance(solver, SuperLUSolver)
    assert "scipy" in SuperLUSolver().name


@every_solver
def test_the_two_halves_of_a_solve_make_the_whole_and_give_every_product(solver):
    matrix = stiffness_like(2)
    upper = upper_of(matrix)
    factor = solver.analyse(upper.indptr, upper.indices).factorize(upper.data)
    loads = np.random.default_rng(4).normal(size=(matrix.shape[0], 5))
    solution = np.linalg.solve(matrix.toarray(), loads)
    half = factor.forward(loads)
    np.testing.assert_allclose(half.T @ half, loads.T @ solution, rtol=1e-9)
    mixed = loads @ [[1.0, 0.0], [0.0, 2.0], [0.0, 0.0], [-3.0, 0.0], [0.0, 1.0]]
    np.testing.assert_allclose(
        factor.backward(half @ np.linalg.lstsq(loads, mixed)[0]),
        np.linalg.solve(matrix.toarray(), mixed),
        rtol=1e-8,
        atol=1e-12,
    )
    one = factor.forward(loads[:, 2])
    assert one.shape == (matrix.shape[0],)
    np.testing.assert_allclose(factor.backward(one), solution[:, 2], rtol=1e-8, atol=1e-12)


@every_solver
@pytest.mark.parametrize("rows", [[0], [3, 17, 18], "all"])
def test_loads_in_few_rows_have_the_same_solution_and_the_same_halves(solver, rows):
    first, second = stiffness_like(2), stiffness_like(6)
    n = first.shape[0]
    rows = np.arange(n) if rows == "all" else np.array(rows)
    loads = np.zeros((n, 5))
    loads[rows] = np.random.default_rng(5).normal(size=(len(rows), 5))
    upper = upper_of(first)
    pattern = solver.analyse(upper.indptr, upper.indices, loaded=rows)
    for matrix in (first, second):
        factor = pattern.factorize(upper_of(matrix).data)
        solution = np.linalg.solve(matrix.toarray(), loads)
        np.testing.assert_allclose(factor.solve(loads), solution, rtol=1e-8, atol=1e-12)
        half = factor.forward(loads)
        np.testing.assert_allclose(half.T @ half, loads.T @ solution, rtol=1e-9, atol=1e-15)
        np.testing.assert_allclose(factor.backward(half), solution, rtol=1e-8, atol=1e-12)


def test_a_load_where_none_was_announced_is_refused():
    if not isinstance(default_solver(), PardisoSolver):
        pytest.skip("only PARDISO makes use of sparse loads")
    upper = upper_of(stiffness_like())
    pattern = PardisoSolver().analyse(upper.indptr, upper.indices, loaded=[4, 5])
    factor = pattern.factorize(upper.data)
    for solve in (factor.solve, factor.forward):
        with pytest.raises(SolverError, match="not zero where analysed to be unloaded"):
            solve(np.ones(upper.shape[0]))
    for rows in ([], [-1], [upper.shape[0]]):
        with pytest.raises(SolverError, match="Loaded rows must be numbers from 0 to"):
            PardisoSolver().analyse(upper.indptr, upper.indices, loaded=rows)


@every_solver
def test_an_approximate_factor_is_a_good_preconditioner_and_its_solutions_are_in_double(solver):
    upper = upper_of(stiffness_like(3))
    rhs = np.random.default_rng(1).normal(size=(upper.shape[0], 2))
    exact = solver.analyse(upper.indptr, upper.indices).factorize(upper.data).solve(rhs)
    pattern = solver.analyse(upper.indptr, upper.indices, approximate=True)
    found = pattern.factorize(upper.data).solve(rhs)
    assert found.dtype == np.float64
    assert np.linalg.norm(found - exact) < 1e-3 * np.linalg.norm(exact)
    if isinstance(solver, PardisoSolver):
        assert np.abs(found / exact - 1).max() > 1e-12  # it is single precision indeed
        full = solver.analyse(upper.indptr, upper.indices)
        full.factorize(upper.data)
        assert pattern.factor_bytes < 0.9 * full.factor_bytes
