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

from typing import Protocol

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fem.solve.pardiso import PardisoSolver, pardiso_works
from fem.solve.superlu import SuperLUSolver

__all__ = ["Factor", "PardisoSolver", "Pattern", "Solver", "SuperLUSolver", "default_solver"]


class Factor(Protocol):
    """A factorised matrix A."""

    def solve(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return x of A x = rhs, of the shape of rhs: (n,) or (n, r)."""
        ...

    def forward(self, rhs: ArrayLike) -> NDArray[np.float64]:
        """Return y (n, r) of G y = rhs, where A = G G', in an order of the solver's own.

        Half the work of `solve`, and enough for every product: b'A^-1 c = y_b'y_c.
        """
        ...

    def backward(self, half: ArrayLike) -> NDArray[np.float64]:
        """Return x (n, r) of G'x = y, y a result of `forward` or a combination of such."""
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

    @property
    def single_precision(self) -> bool:
        """Return True if approximate factors cost less than others."""
        ...

    def analyse(
        self,
        indptr: ArrayLike,
        indices: ArrayLike,
        approximate: bool = False,
        loaded: ArrayLike | None = None,
    ) -> Pattern:
        """Order and analyse the CSR pattern (n + 1,), (nnz,) of an upper triangle.

        `approximate` allows factors in single precision, where the solver has them: half the
        memory, two thirds of the time, and solutions good to 1e-5 to 1e-2, as for a preconditioner.
        `loaded` names the rows in which right-hand sides may differ from zero; where these are few,
        the forward half of a solve becomes nearly free. Others are then refused.
        """
        ...


def default_solver() -> Solver:
    """Return PARDISO where MKL is installed and works (x86-64), else SuperLU."""
    return PardisoSolver() if pardiso_works() else SuperLUSolver()
