"""Solutions in double precision by factors in single precision, which take half the memory.

For large bodies the factorisation takes all but a few seconds of an evaluation, and most of its
memory. Done in single precision it is a preconditioner so good that conjugate gradients in double
precision need two or three iterations; all right-hand sides go through them together.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray

from fem.solver import Factor

#: Relative error of a displacement in the energy norm; that of a compliance is its square.
RTOL = 1e-8
_MOST = 12  # iterations; more would take longer than factors in double precision


class SymmetricMatrix(NamedTuple):
    """Upper triangle, diagonal included, of a symmetric matrix in CSR layout.

    The diagonal is the first entry of each row.
    """

    indptr: NDArray[np.int32]
    indices: NDArray[np.int32]
    values: NDArray[np.float64]

    def product(self, x: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the product with a vector (n,)."""
        y = np.empty_like(x)
        _product(y, x, *self)
        return y

    def products(self, rows: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the products (k, n) with k vectors, on all cores."""
        result = np.empty_like(rows)
        _products(result, rows, *self)
        return result


def solve_with_rough_factor(
    matrix: SymmetricMatrix, factor: Factor, rhs: NDArray[np.float64]
) -> NDArray[np.float64] | None:
    """Solve A x = rhs to a relative error of `RTOL` in the energy norm, for every column (n, k).

    Conjugate gradients with the factor as preconditioner, from zero: x is then the best of its
    Krylov space, and rhs'x wrong by the square of the error only. None if the factor is too rough
    for that, or A is not positive definite.
    """
    residual = rhs.T.copy()
    x, direction = np.zeros_like(residual), np.zeros_like(residual)
    tiny = np.finfo(float).tiny
    first = error = np.ones(len(x))  # of the iterate, squared and in the energy norm
    for iteration in range(_MOST):
        correction = factor.solve(residual.T).T
        before, error = np.maximum(error, tiny), np.einsum("kn,kn->k", residual, correction)
        if iteration == 0:
            first, ratio = error, np.zeros_like(error)
        else:
            ratio = error / before
        direction *= ratio[:, None]
        direction += correction
        product = matrix.products(direction)
        curvature = np.einsum("kn,kn->k", direction, product)
        if not ((error >= 0) & (curvature >= 0)).all():
            return None
        step = (error / np.maximum(curvature, tiny))[:, None]
        x += step * direction
        product *= step
        residual -= product
        # this step leaves about as small a part of the error as the one before did
        if iteration > 0 and (error * ratio <= RTOL**2 * first).all():
            return x.T
    return None


@numba.njit(cache=True, nogil=True)
def _product(y, x, indptr, indices, values):
    y[:] = 0.0
    for i in range(len(indptr) - 1):
        s = values[indptr[i]] * x[i]
        for k in range(indptr[i] + 1, indptr[i + 1]):
            j = indices[k]
            s += values[k] * x[j]
            y[j] += values[k] * x[i]
        y[i] += s


@numba.njit(cache=True, parallel=True)
def _products(y, x, indptr, indices, values):
    for row in numba.prange(len(x)):
        _product(y[row], x[row], indptr, indices, values)
