"""Sparse direct solvers behind one small interface: analyse once, factorise often, solve many.

A stiffness matrix keeps its sparsity pattern while the modulus field changes. So a solver splits
the work in three::

    pattern = default_solver().analyse(indptr, indices)  # ordering and fill: once a mesh
    factor = pattern.factorize(values)                   # numbers: once a modulus field
    displacement = factor.solve(loads)                   # (n,) or (n, r), as often as needed

`indptr`, `indices`, `values` are the UPPER triangle, diagonal included, of a symmetric positive
definite matrix in scipy's CSR layout. Which solver runs is an object: `PardisoSolver` (Intel MKL,
x86-64) or `SuperLUSolver` (scipy, everywhere); `default_solver` takes the fastest that works here.
"""

from __future__ import annotations

import ctypes
import weakref
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import SuperLU, splu

from fem.errors import SolverError

WHAT_TO_DO = (
    "check that the body is held (fixed surface not empty), that every Young's modulus is "
    "positive, that -1 < Poisson's ratio < 0.5 and that no cell is inverted"
)


class Factor(Protocol):
    """A factorised matrix A."""

    def solve(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return x of A x = rhs, of the shape of rhs: (n,) or (n, r)."""
        ...


class Pattern(Protocol):
    """An analysed sparsity pattern, to be filled with values again and again."""

    def factorize(self, values: ArrayLike) -> Factor:
        """Factorise the matrix with these values (nnz,) of the upper triangle.

        The factor of an earlier call may become stale: it then raises `SolverError` if used.
        """
        ...


class Solver(Protocol):
    """A way to factorise symmetric positive definite matrices."""

    @property
    def name(self) -> str:
        """Name with version, for reports."""
        ...

    def analyse(self, indptr: ArrayLike, indices: ArrayLike) -> Pattern:
        """Order and analyse the CSR pattern (n + 1,), (nnz,) of an upper triangle."""
        ...


def default_solver() -> Solver:
    """Return PARDISO where MKL is installed and works (x86-64), else SuperLU."""
    return PardisoSolver() if _pardiso_works() else SuperLUSolver()


@cache
def _pardiso_works() -> bool:
    """Whether MKL can be loaded and solves a small system."""
    try:
        factor = PardisoSolver().analyse([0, 2, 3], [0, 1, 1]).factorize([2.0, 1.0, 2.0])
    except (ImportError, OSError, SolverError):
        return False
    return bool(np.allclose(factor.solve([3.0, 3.0]), 1.0))


# ---------------------------------------------------------------------------------- PARDISO

_ANALYSE, _FACTORIZE, _SOLVE, _RELEASE = 11, 22, 33, -1
_SPD = 2  # mtype: real, symmetric positive definite
_PARDISO_ERRORS = {
    -2: "not enough memory; use a coarser mesh",
    -3: "reordering failed",
    -8: "the factor is too large for 32-bit indices; use a coarser mesh",
}


@dataclass(frozen=True)
class PardisoSolver:
    """Cholesky factorisation by PARDISO of Intel MKL (through pypardiso's handle of the library).

    Parameters
    ----------
    threads : int, optional
        Threads MKL may use, for the whole process; its own choice (all cores) where not given.
    """

    threads: int | None = None

    @property
    def name(self) -> str:
        """Name with version."""
        buffer = ctypes.create_string_buffer(200)
        _mkl().mkl_get_version_string(buffer, 200)
        return buffer.value.decode().split(" for ")[0].strip()

    def analyse(self, indptr: ArrayLike, indices: ArrayLike) -> PardisoPattern:
        """Order (nested dissection) and analyse the pattern of an upper triangle."""
        # PARDISO needs as many threads to factorise as to analyse, and others in the process (as
        # numba) change OpenMP's number in between: MKL's own is set, which they do not touch.
        threads = self.threads or _mkl().MKL_Get_Max_Threads()
        _mkl().MKL_Set_Num_Threads(ctypes.c_int(threads))
        return PardisoPattern(*_checked_pattern(indptr, indices))


@cache
def _mkl() -> Any:
    """MKL's library, found by pypardiso."""
    from pypardiso import ps  # not there on every platform

    return ps.libmkl


class PardisoPattern:
    """An analysed pattern inside PARDISO; its memory is given back when nobody uses it."""

    def __init__(self, indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> None:
        self.size = indptr.size - 1
        self._indptr, self._indices = indptr, indices
        self._handle = np.zeros(64, np.int64)
        self._options = _pardiso_options()
        self._values = np.ones(indices.size)
        self._generation = 0
        self._finalizer = weakref.finalize(self, _release, self._handle, self._options, self.size)
        self._call(_ANALYSE)

    @property
    def factor_bytes(self) -> int:
        """Memory held by PARDISO for the pattern and its factor."""
        permanent_kb, factor_kb = self._options[15], self._options[16]
        return 1024 * int(permanent_kb + factor_kb)

    def factorize(self, values: ArrayLike) -> PardisoFactor:
        """Factorise the values (nnz,); factors of earlier calls become stale."""
        self._values = _checked_values(values, self._indices.size)
        self._generation += 1
        self._call(_FACTORIZE)
        return PardisoFactor(self, self._generation)

    def solve(self, rhs: ArrayLike, generation: int) -> NDArray[np.float64]:
        """Solve with the factor of that generation."""
        if generation != self._generation:
            raise SolverError(
                "This factor is stale: its pattern has been factorised again since; "
                "solve with the new factor, or analyse a second pattern to keep both."
            )
        load = np.asfortranarray(_checked_rhs(rhs, self.size))
        solution = np.empty_like(load)
        if load.size:
            self._call(_SOLVE, load, solution)
        return solution

    def _call(
        self,
        phase: int,
        load: NDArray[np.float64] | None = None,
        solution: NDArray[np.float64] | None = None,
    ) -> None:
        error = _call_pardiso(
            self._handle,
            self._options,
            phase,
            self.size,
            (self._values, self._indptr, self._indices),
            load,
            solution,
        )
        if error == -4:
            raise SolverError(
                f"The matrix is not positive definite (pivot of row {self._options[29]} "
                f"of {self.size}): {WHAT_TO_DO}."
            )
        if error:
            reason = _PARDISO_ERRORS.get(error, "see MKL's manual of PARDISO for this number")
            raise SolverError(f"PARDISO stopped with error {error} in phase {phase}: {reason}.")


@dataclass(frozen=True, eq=False)
class PardisoFactor:
    """The factor last made by a pattern."""

    pattern: PardisoPattern
    generation: int

    def solve(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return x of A x = rhs, (n,) or (n, r)."""
        return self.pattern.solve(rhs, self.generation)


def _pardiso_options() -> NDArray[np.int32]:
    """PARDISO's iparm (here with C's indices; MKL's manual counts from one)."""
    options = np.zeros(64, np.int32)
    options[0] = 1  # take these, not the defaults
    options[1] = 2  # nested dissection
    options[17] = -1  # report the non-zeros of the factor
    options[23] = 1  # two-level factorisation
    options[34] = 1  # indices count from zero
    return options


def _call_pardiso(
    handle: NDArray[np.int64],
    options: NDArray[np.int32],
    phase: int,
    size: int,
    matrix: tuple[NDArray[np.float64], NDArray[np.int32], NDArray[np.int32]] | None = None,
    load: NDArray[np.float64] | None = None,
    solution: NDArray[np.float64] | None = None,
) -> int:
    """Call the C function and return its error number."""

    def integer(number: int) -> Any:
        return ctypes.byref(ctypes.c_int32(number))

    def pointer(array: NDArray[Any] | None) -> ctypes.c_void_p:
        return ctypes.c_void_p(None if array is None else array.ctypes.data)

    values, indptr, indices = (None, None, None) if matrix is None else matrix
    columns = 1 if load is None or load.ndim == 1 else load.shape[1]
    error = ctypes.c_int32(0)
    pardiso = _mkl().pardiso
    pardiso.restype, pardiso.argtypes = None, None
    pardiso(
        *(pointer(handle), integer(1), integer(1), integer(_SPD), integer(phase), integer(size)),
        *(pointer(values), pointer(indptr), pointer(indices), pointer(None), integer(columns)),
        *(pointer(options), integer(0), pointer(load), pointer(solution), ctypes.byref(error)),
    )
    return error.value


def _release(handle: NDArray[np.int64], options: NDArray[np.int32], size: int) -> None:
    """Give PARDISO's memory back."""
    _call_pardiso(handle, options, _RELEASE, size)


# ---------------------------------------------------------------------------------- SuperLU


@dataclass(frozen=True)
class SuperLUSolver:
    """LU factorisation by scipy's SuperLU in symmetric mode: slower, larger, runs everywhere."""

    @property
    def name(self) -> str:
        """Name with version."""
        from scipy import __version__

        return f"SuperLU of scipy {__version__}"

    def analyse(self, indptr: ArrayLike, indices: ArrayLike) -> SuperLUPattern:
        """Prepare the full matrix of the upper triangle (SuperLU orders in `factorize`)."""
        return SuperLUPattern(*_checked_pattern(indptr, indices))


class SuperLUPattern:
    """The full matrix's pattern, and from which value of the upper triangle each entry comes."""

    def __init__(self, indptr: NDArray[np.int32], indices: NDArray[np.int32]) -> None:
        self.size = indptr.size - 1
        numbers = np.arange(1.0, indices.size + 1)  # from 1: a zero would be dropped
        upper = sp.csr_array((numbers, indices, indptr), shape=(self.size, self.size))
        full = sp.csc_array(upper + sp.triu(upper, 1).T)
        full.sort_indices()
        self._full = full
        self._source = full.data.astype(np.int64) - 1

    def factorize(self, values: ArrayLike) -> SuperLUFactor:
        """Factorise the values (nnz,); earlier factors stay valid."""
        data = _checked_values(values, int(self._source.max()) + 1)[self._source]
        matrix = sp.csc_array((data, self._full.indices, self._full.indptr), self._full.shape)
        try:
            factor = splu(
                matrix,
                permc_spec="MMD_AT_PLUS_A",
                diag_pivot_thresh=0.0,
                options={"SymmetricMode": True},
            )
        except RuntimeError as error:  # an exactly zero pivot
            raise SolverError(f"The matrix is singular: {WHAT_TO_DO}.") from error
        pivots = factor.U.diagonal()
        # without row exchange the pivots have the signs of the eigenvalues (Sylvester)
        if np.any(factor.perm_r != factor.perm_c) or pivots.min() <= 0.0:
            row = int(np.flatnonzero(factor.perm_c == pivots.argmin())[0])
            raise SolverError(
                f"The matrix is not positive definite (pivot of row {row} of {self.size}): "
                f"{WHAT_TO_DO}."
            )
        return SuperLUFactor(factor, self.size)


@dataclass(frozen=True, eq=False)
class SuperLUFactor:
    """A factor in SuperLU's memory."""

    factor: SuperLU
    size: int

    def solve(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return x of A x = rhs, (n,) or (n, r)."""
        return self.factor.solve(_checked_rhs(rhs, self.size))


# ----------------------------------------------------------------------------------- checks


def _checked_pattern(
    indptr: ArrayLike, indices: ArrayLike
) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Return the pattern as int32, or say why it is not that of an upper triangle.

    PARDISO crashes or computes nonsense on a pattern that is unsorted or lacks a diagonal entry.
    """
    starts = np.array(indptr, np.int32)
    columns = np.array(indices, np.int32)
    if starts.ndim != 1 or starts.size < 2 or starts[0] != 0 or starts[-1] != columns.size:
        raise SolverError("The pattern's indptr must be (n + 1,), from 0 to the number of indices.")
    if np.any(np.diff(starts) < 1) or np.any(columns[starts[:-1]] != np.arange(starts.size - 1)):
        raise SolverError(
            "Each row of the pattern must begin with its diagonal entry: pass the upper triangle, "
            "diagonal included, with sorted indices."
        )
    rises = np.diff(columns) > 0
    rises[starts[1:-1] - 1] = True  # from one row to the next
    if not rises.all() or columns.max() >= starts.size - 1:
        raise SolverError("The pattern's indices must rise within each row and be below n.")
    return starts, columns


def _checked_values(values: ArrayLike, count: int) -> NDArray[np.float64]:
    data = np.ascontiguousarray(values, np.float64)
    if data.shape != (count,):
        raise SolverError(f"The pattern has {count} entries, but the values are {data.shape}.")
    if not np.isfinite(data).all():
        bad = int(np.flatnonzero(~np.isfinite(data))[0])
        raise SolverError(f"Entry {bad} of the matrix is {data[bad]}: {WHAT_TO_DO}.")
    return data


def _checked_rhs(rhs: ArrayLike, size: int) -> NDArray[np.float64]:
    load = np.asarray(rhs, np.float64)
    if load.ndim not in (1, 2) or load.shape[0] != size:
        raise SolverError(
            f"The right-hand side must be ({size},) or ({size}, r), but is {load.shape}."
        )
    return load
