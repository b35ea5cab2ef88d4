"""Sparse direct solutions by scipy's SuperLU, see `fem.solve.direct`."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import ArrayLike, NDArray
from scipy.sparse.linalg import SuperLU, splu, spsolve_triangular

from fem.errors import SolverError
from fem.solve.checks import WHAT_TO_DO, checked_pattern, checked_rhs, checked_values


@dataclass(frozen=True)
class SuperLUSolver:
    """LU factorisation by scipy's SuperLU in symmetric mode: slower, larger, runs everywhere."""

    @property
    def name(self) -> str:
        """Name with version."""
        from scipy import __version__

        return f"SuperLU of scipy {__version__}"

    @property
    def single_precision(self) -> bool:
        """It has not: approximate factors are in double precision."""
        return False

    def analyse(
        self,
        indptr: ArrayLike,
        indices: ArrayLike,
        approximate: bool = False,
        loaded: ArrayLike | None = None,
    ) -> SuperLUPattern:
        """Prepare the full matrix of the upper triangle (SuperLU orders in `factorize`).

        Factors are always in double precision, and right-hand sides may be loaded anywhere.
        """
        del approximate, loaded
        return SuperLUPattern(*checked_pattern(indptr, indices))


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
        data = checked_values(values, int(self._source.max()) + 1)[self._source]
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
        return self.factor.solve(checked_rhs(rhs, self.size))

    # P A P' = L D L' with rows and columns in one order, so that G = P' L D^1/2

    def forward(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return y of G y = rhs, (n,) or (n, r)."""
        load = checked_rhs(rhs, self.size)
        ordered = np.empty_like(load)
        ordered[self.factor.perm_r] = load
        half = spsolve_triangular(self.factor.L, ordered, lower=True, unit_diagonal=True)
        return (half.T / self._root).T

    def backward(self, half: ArrayLike) -> NDArray[np.float64]:
        """Return x of G'x = half, (n,) or (n, r)."""
        scaled = (checked_rhs(half, self.size).T * self._root).T  # U = D L'
        return spsolve_triangular(self.factor.U, scaled, lower=False)[self.factor.perm_r]

    @cached_property
    def _root(self) -> NDArray[np.float64]:
        return np.sqrt(self.factor.U.diagonal())
