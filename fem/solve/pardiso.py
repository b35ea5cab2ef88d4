"""Sparse Cholesky factors by PARDISO of Intel MKL, see `fem.solve.direct`."""

from __future__ import annotations

import ctypes
import os
import weakref
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, files
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fem.errors import SolverError
from fem.solve.checks import WHAT_TO_DO, checked_pattern, checked_rhs, checked_rows, checked_values

_ANALYSE, _FACTORIZE, _SOLVE, _RELEASE, _RELEASE_FACTOR = 11, 22, 33, -1, 0
_FORWARD, _BACKWARD = 331, 333  # the diagonal phase between them does nothing to a Cholesky factor
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
        Threads MKL may use for the patterns of this solver; where not given, as many as it would
        take in the thread that analyses.
    """

    threads: int | None = None

    @property
    def name(self) -> str:
        """Name with version."""
        buffer = ctypes.create_string_buffer(200)
        _mkl().mkl_get_version_string(buffer, 200)
        return buffer.value.decode().split(" for ")[0].strip()

    @property
    def single_precision(self) -> bool:
        """It has."""
        return True

    def analyse(
        self,
        indptr: ArrayLike,
        indices: ArrayLike,
        approximate: bool = False,
        loaded: ArrayLike | None = None,
    ) -> PardisoPattern:
        """Order (nested dissection) and analyse the pattern of an upper triangle."""
        threads = self.threads or _mkl().MKL_Get_Max_Threads()
        precision = np.float32 if approximate else np.float64
        return PardisoPattern(*checked_pattern(indptr, indices), threads, precision, loaded)


@cache
def pardiso_works() -> bool:
    """Return True if MKL can be loaded and solves a small system."""
    try:
        factor = PardisoSolver().analyse([0, 2, 3], [0, 1, 1]).factorize([2.0, 1.0, 2.0])
    except (ImportError, OSError, SolverError):
        return False
    return bool(np.allclose(factor.solve([3.0, 3.0]), 1.0))


@cache
def _mkl() -> Any:
    """MKL's library, as pypardiso loads it."""
    known = "PYPARDISO_MKL_RT"  # without it pypardiso searches all of the installation, for 0.5 s
    place = None if known in os.environ else _installed_mkl()
    try:
        if place is not None:
            os.environ[known] = str(place)
        from pypardiso import ps  # not there on every platform
    finally:
        if place is not None:
            del os.environ[known]
    return ps.libmkl


def _installed_mkl() -> Path | None:
    """Place of the library that the package `mkl` lists, if it is there."""
    try:
        listed = files("mkl") or ()
    except PackageNotFoundError:
        return None
    places = (Path(str(file.locate())) for file in listed if "mkl_rt" in file.name)
    return next((place for place in places if place.suffix != ".lib" and place.exists()), None)


@contextmanager
def _mkl_threads(threads: int) -> Iterator[None]:
    """Let MKL use so many threads when called from this one.

    PARDISO crashes where it factorises with fewer threads than it has analysed with, and others in
    the process, as numba, change OpenMP's number; that of MKL for one thread they do not touch.
    """
    set_local = _mkl().MKL_Set_Num_Threads_Local
    before = set_local(ctypes.c_int(threads))
    try:
        yield
    finally:
        set_local(ctypes.c_int(before))


class PardisoPattern:
    """An analysed pattern inside PARDISO; its memory is given back when nobody uses it.

    For one thread at a time: it keeps one factor, and PARDISO's state.
    """

    def __init__(
        self,
        indptr: NDArray[np.int32],
        indices: NDArray[np.int32],
        threads: int,
        precision: type[np.float32] | type[np.float64] = np.float64,
        loaded: ArrayLike | None = None,
    ) -> None:
        self.size, self.threads = indptr.size - 1, threads
        self._loaded = None if loaded is None else checked_rows(loaded, self.size)
        # PARDISO's perm: the analysis finds the loaded rows there and leaves its order behind
        self._order = None if self._loaded is None else self._loaded.astype(np.int32)
        self._indptr, self._indices = indptr, indices
        self._precision = precision
        self._handle = np.zeros(64, np.int64)
        self._options = _pardiso_options(precision is np.float32, loaded is not None)
        self._values = np.ones(indices.size, precision)
        self._generation = 0
        self._finalizer = weakref.finalize(
            self, _call_pardiso, self._handle, self._options, _RELEASE, self.size
        )
        self._call(_ANALYSE)

    @property
    def factor_bytes(self) -> int:
        """Memory held by PARDISO for the pattern and its factor."""
        permanent_kb, factor_kb = self._options[15], self._options[16]
        return 1024 * int(permanent_kb + factor_kb)

    def factorize(self, values: ArrayLike) -> PardisoFactor:
        """Factorise the values (nnz,); factors of earlier calls become stale."""
        checked = checked_values(values, self._indices.size)
        self._values = checked.astype(self._precision, copy=False)
        self._generation += 1
        self._call(_FACTORIZE)
        factor = PardisoFactor(self, self._generation)
        weakref.finalize(factor, self._forget, self._generation).atexit = False
        return factor

    def _forget(self, generation: int) -> None:
        """Give back the numbers of a factor that nobody uses any more; the analysis stays."""
        if generation == self._generation:
            self._call(_RELEASE_FACTOR)

    def solve(self, rhs: ArrayLike, generation: int, phase: int = _SOLVE) -> NDArray[np.float64]:
        """Solve with the factor of that generation; all of it, or one of the two halves."""
        if generation != self._generation:
            raise SolverError(
                "This factor is stale: its pattern has been factorised again since; "
                "solve with the new factor, or analyse a second pattern to keep both."
            )
        load = np.asfortranarray(checked_rhs(rhs, self.size), self._precision)
        if self._loaded is not None and phase != _BACKWARD:
            if np.count_nonzero(load) != np.count_nonzero(load[self._loaded]):
                raise SolverError("A right-hand side is not zero where analysed to be unloaded.")
        solution = np.empty_like(load)
        if load.size:
            self._call(phase, load, solution)
        return solution.astype(np.float64, copy=False)

    def _call(
        self,
        phase: int,
        load: NDArray[Any] | None = None,
        solution: NDArray[Any] | None = None,
    ) -> None:
        with _mkl_threads(self.threads):
            error = _call_pardiso(
                self._handle,
                self._options,
                phase,
                self.size,
                (self._values, self._indptr, self._indices),
                load,
                solution,
                self._order,
            )
        if error == -4:
            raise SolverError(
                f"The matrix is not positive definite (pivot of row {self._options[29] - 1} "
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

    def forward(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return y of G y = rhs, (n,) or (n, r)."""
        return self.pattern.solve(rhs, self.generation, _FORWARD)

    def backward(self, half: ArrayLike) -> NDArray[np.float64]:
        """Return x of G'x = half, (n,) or (n, r)."""
        return self.pattern.solve(half, self.generation, _BACKWARD)


def _pardiso_options(single: bool, sparse_loads: bool) -> NDArray[np.int32]:
    """PARDISO's iparm (here with C's indices; MKL's manual counts from one)."""
    options = np.zeros(64, np.int32)
    options[0] = 1  # take these, not the defaults
    options[1] = 2  # nested dissection
    options[17] = -1  # report the non-zeros of the factor
    # The two-level factorisation is faster by a tenth, its solves are slower by a third, and a
    # factor in single precision is made for few of these.
    options[23] = single
    options[27] = single  # precision of all numbers
    options[30] = 2 if sparse_loads else 0  # rows without load are skipped by the forward half
    options[34] = 1  # indices count from zero
    return options


def _call_pardiso(
    handle: NDArray[np.int64],
    options: NDArray[np.int32],
    phase: int,
    size: int,
    matrix: tuple[NDArray[Any], NDArray[np.int32], NDArray[np.int32]] | None = None,
    load: NDArray[Any] | None = None,
    solution: NDArray[Any] | None = None,
    order: NDArray[np.int32] | None = None,
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
        *(pointer(values), pointer(indptr), pointer(indices), pointer(order), integer(columns)),
        *(pointer(options), integer(0), pointer(load), pointer(solution), ctypes.byref(error)),
    )
    return error.value
