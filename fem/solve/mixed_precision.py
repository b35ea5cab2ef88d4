"""Solutions of large bodies in double precision by a preconditioner in single precision.

A factorisation in double precision takes nearly all of a large body's time and memory. In its
place conjugate gradients, all right-hand sides together, with a preconditioner of two kinds: two
grids (`fem.solve.two_grid`), and beyond their Poisson's ratio factors in single precision, which
take half the memory and two or three iterations.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

import numba
import numpy as np
from numpy.typing import NDArray

from fem.errors import SolverError
from fem.solve.block_matrix import BlockMatrix
from fem.solve.direct import Factor, Pattern

#: Relative error of a displacement in the energy norm; that of a compliance is its square.
RTOL = 1e-8
_SURE = 10  # iterations after which the rate tells whether it goes on


class Preconditioner(Protocol):
    """An approximate inverse, symmetric and positive definite."""

    def __call__(self, residual: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the correction (f, 3, k); it lasts until the next call."""
        ...


class PreconditionerFactory(Protocol):
    """Maker of preconditioners of one body, for one modulus field after another."""

    @property
    def most(self) -> int:
        """Iterations that are worth their time."""
        ...

    def prepare(self, matrix: BlockMatrix, values: NDArray[np.float64]) -> Preconditioner:
        """Return that of a matrix, also given as the values of its upper triangle.

        Raises
        ------
        SolverError
            The matrix is not positive definite, as far as single precision can tell.
        """
        ...


class SinglePrecisionFactors:
    """Factors in single precision."""

    most = 12

    def __init__(self, analyse: Callable[[], Pattern]) -> None:
        self._analyse = analyse
        self._pattern: Pattern | None = None

    def prepare(self, matrix: BlockMatrix, values: NDArray[np.float64]) -> Preconditioner:
        """Factorise the values."""
        if self._pattern is None:
            self._pattern = self._analyse()
        return _SinglePrecisionFactor(self._pattern.factorize(values))


@dataclass(frozen=True)
class _SinglePrecisionFactor:
    factor: Factor

    def __call__(self, residual: NDArray[np.float32]) -> NDArray[np.float32]:
        solution = self.factor.solve(residual.reshape(-1, residual.shape[-1]))
        return np.ascontiguousarray(solution, np.float32).reshape(residual.shape)


def conjugate_gradients(
    matrix: BlockMatrix, precondition: Preconditioner, rhs: NDArray[np.float64], most: int
) -> NDArray[np.float64]:
    """Solve A x = rhs to a relative error of `RTOL` in the energy norm, for every column (n, k).

    From zero: x is then the best of its Krylov space, and rhs'x wrong by the square of the error
    only.

    Raises
    ------
    SolverError
        It takes more than `most` iterations, or A is not positive definite.
    """
    shape = (len(rhs) // 3, 3, rhs.shape[1])
    residual = np.array(rhs, float, order="C").reshape(shape)
    single = residual.astype(np.float32)
    x, direction, product = np.zeros(shape), np.zeros(shape), np.empty(shape)
    tiny = np.finfo(float).tiny
    first = error = np.ones(shape[2])  # of the iterate, squared and in the energy norm
    for iteration in range(most):
        correction = precondition(single)
        before, error = np.maximum(error, tiny), _dot(residual, correction)
        if iteration == 0:
            first, ratio = error, np.zeros_like(error)
        else:
            ratio = error / before
        _turn(direction, correction, ratio)
        curvature = _dot(direction, matrix.products(direction, product))
        if not ((error >= 0) & (curvature >= 0)).all():
            raise SolverError("the matrix or its preconditioner is not positive definite")
        _advance(x, residual, single, direction, product, error / np.maximum(curvature, tiny))
        # this step leaves about as small a part of the error as the one before did
        left = (error * ratio / np.maximum(first, tiny)).max()
        if iteration > 0 and left <= RTOL**2:
            return x.reshape(rhs.shape)
        if iteration >= _SURE and left ** (most / iteration) > RTOL**2:
            break
    raise SolverError(f"conjugate gradients do not arrive in {most} iterations")


@numba.njit(cache=True, parallel=True, fastmath=True)
def _turn(direction, correction, ratio):
    for i in numba.prange(len(direction)):
        for a in range(3):
            for c in range(len(ratio)):
                direction[i, a, c] = correction[i, a, c] + ratio[c] * direction[i, a, c]


@numba.njit(cache=True, parallel=True, fastmath=True)
def _advance(x, residual, single, direction, product, step):
    for i in numba.prange(len(x)):
        for a in range(3):
            for c in range(len(step)):
                x[i, a, c] += step[c] * direction[i, a, c]
                left = residual[i, a, c] - step[c] * product[i, a, c]
                residual[i, a, c] = left
                single[i, a, c] = left


_PARTS = 64  # sums of a fixed partition, so that they do not hang on the number of threads


@numba.njit(cache=True, parallel=True, fastmath=True)
def _dot(u, v):
    n, k = len(u), u.shape[2]
    sums = np.zeros((_PARTS, k))
    for part in numba.prange(_PARTS):
        for i in range(part * n // _PARTS, (part + 1) * n // _PARTS):
            for a in range(3):
                for c in range(k):
                    sums[part, c] += u[i, a, c] * v[i, a, c]
    return sums.sum(axis=0)
