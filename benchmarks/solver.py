"""Sparse direct solvers on stiffness matrices of a palpated block.

Each solver runs in a process of its own, so that its memory can be told; `qdldl` takes part where
it is installed. Part of `python benchmarks/run.py`.
"""

from __future__ import annotations

import importlib.util
import multiprocessing
import time
from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from memory import peak_mb
from scipy.sparse.linalg import splu

from fem.linear.assembly import Stiffness
from fem.mesh.block import block_mesh
from fem.solve.direct import PardisoSolver, Solver, SuperLUSolver

SIZE_M = (0.096, 0.096, 0.048)
LAYERS = (4, 6)  # of cells: 6,936 and 22,500 unknowns
PRESSES = 81
TIME_LIMIT_S = 100.0
Solve = Callable[[np.ndarray], np.ndarray]
# takes the upper triangle; returns seconds to analyse, seconds to factorise, and how to solve
Method = Callable[[sp.csr_array], tuple[float, float, Solve]]


def ours(solver: Solver) -> Method:
    def method(upper: sp.csr_array) -> tuple[float, float, Solve]:
        solver.analyse([0, 1], [0]).factorize([1.0])  # loads the library
        start = time.perf_counter()
        pattern = solver.analyse(upper.indptr, upper.indices)
        middle = time.perf_counter()
        factor = pattern.factorize(upper.data)
        return middle - start, time.perf_counter() - middle, factor.solve

    return method


def full(upper: sp.csr_array) -> sp.csc_array:
    return sp.csc_array(upper + sp.triu(upper, 1).T)


def superlu_as_scipy_sets_it(upper: sp.csr_array) -> tuple[float, float, Solve]:
    matrix = full(upper)
    start = time.perf_counter()
    factor = splu(matrix)
    return 0.0, time.perf_counter() - start, factor.solve


def qdldl(upper: sp.csr_array) -> tuple[float, float, Solve]:
    import qdldl  # pyright: ignore[reportMissingImports]

    matrix = sp.csc_matrix(full(upper))
    start = time.perf_counter()
    factor = qdldl.Solver(matrix)
    seconds = time.perf_counter() - start
    return 0.0, seconds, lambda loads: np.stack([factor.solve(b) for b in loads.T], axis=1)


METHODS: dict[str, Method] = {
    "PARDISO (MKL), Cholesky": ours(PardisoSolver()),
    "SuperLU, symmetric mode": ours(SuperLUSolver()),
    "SuperLU, scipy's defaults": superlu_as_scipy_sets_it,
}
QDLDL_IS_HERE = importlib.util.find_spec("qdldl") is not None
if QDLDL_IS_HERE:
    METHODS["QDLDL, LDL'"] = qdldl


def measure(divisions: tuple[int, int, int], name: str, answer: multiprocessing.Queue) -> None:
    mesh = block_mesh(SIZE_M, divisions)
    stiffness = Stiffness(mesh, poisson_ratio=0.49)
    values = stiffness.values(np.full(len(stiffness.points_m), 20e3))
    n = 3 * len(stiffness.free_nodes)
    upper = sp.csr_array((values, stiffness.indices, stiffness.indptr), shape=(n, n))
    matrix = full(upper)
    loads = np.asfortranarray(np.random.default_rng(0).normal(size=(n, PRESSES)))
    before = peak_mb()
    analyse, factorise, solve = METHODS[name](upper)
    start = time.perf_counter()
    x = solve(loads)
    seconds = time.perf_counter() - start
    peak = peak_mb() - before
    residual = np.linalg.norm(matrix @ x - loads) / np.linalg.norm(loads)
    answer.put((analyse, factorise, seconds, peak, residual))


def row(divisions: tuple[int, int, int], name: str) -> str:
    nx, ny, nz = divisions
    size = f"{3 * (2 * nx + 1) * (2 * ny + 1) * 2 * nz:,}"
    context = multiprocessing.get_context("spawn")
    answer = context.Queue()
    child = context.Process(target=measure, args=(divisions, name, answer))
    child.start()
    child.join(TIME_LIMIT_S)
    if child.is_alive():
        child.kill()
        child.join()
        return f"| {size} | {name} | | > {TIME_LIMIT_S:.0f} | | | |"
    analyse, factorise, solve, peak, residual = answer.get(timeout=1)
    times = f"{analyse:.2f} | {factorise:.2f} | {solve:.2f}"
    return f"| {size} | {name} | {times} | {peak:.0f} | {residual:.0e} |"


def table() -> list[str]:
    """Return the lines of the table."""
    absent = "" if QDLDL_IS_HERE else "; QDLDL is not installed and has no row"
    return [
        f"{PRESSES} right-hand sides, ten-node tetrahedra{absent}.",
        "",
        "| unknowns | solver | analyse s | factorise s | solve s | memory MB | residual |",
        "|---:|---|---:|---:|---:|---:|---:|",
        *(row((2 * count, 2 * count, count), name) for count in LAYERS for name in METHODS),
    ]
