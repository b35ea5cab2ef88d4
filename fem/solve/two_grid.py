"""A preconditioner for large bodies: smoothing on the mesh, and a coarse grid.

The coarse grid is a box of cubes around the body, about `_COARSER` of the mesh's nodes wide, that
takes no notice of its cells: displacements that are trilinear in each cube, at the mesh's free
nodes. So it serves bodies of any shape. Its matrix is the mesh's, P'KP (Galerkin), and is
factorised. The smoother is a Chebyshev polynomial in D^-1 K with D the blocks of the nodes, the
same before and after, so that the whole is symmetric (Saad, Iterative Methods for Sparse Linear
Systems, Algorithm 12.1; Adams et al., J. Comput. Phys. 188, 2003). All in single precision.

Time grows as the number of unknowns, where a factorisation's grows as its square. The nearer
Poisson's ratio comes to 1/2, the more iterations (to 1e-6 at 0.3, 0.45, 0.49, 0.499: 8, 14, 28
and more than 60): above `NU_LIMIT` factors in single precision are faster.
"""

from __future__ import annotations

import numba
import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from fem.solve.block_matrix import BlockMatrix, add_row
from fem.solve.direct import Factor, Pattern, Solver

#: Poisson's ratio above which factors are the better preconditioner
NU_LIMIT = 0.49
_COARSER = 3.0  # width of a cube in distances between nodes
_DEGREE = 3  # of the smoother's polynomial
_DAMPED = 12.0  # the smoother takes what lies within this factor of the largest eigenvalue
_POWER_STEPS, _POWER_VECTORS = 10, 8
_SUPPORT = 1e-3  # functions of the coarse grid that are smaller at all nodes are left out
_STIFFENED = 1e-5  # part of its diagonal that the coarse matrix gets more: nearly dependent ones


class TwoGrid:
    """The coarse grid of a body, whose numbers change with the modulus field.

    Parameters
    ----------
    nodes_m : (f, 3) that may move
    solver : for the coarse matrix
    """

    most = 40  # iterations; more would take longer than a factorisation

    def __init__(self, nodes_m: NDArray[np.float64], solver: Solver) -> None:
        self._solver = solver
        self._prolong = trilinear(nodes_m)
        self._restrict = self._prolong.T.tocsr()
        self._by_axis = sp.kron(self._prolong, sp.eye_array(3), format="csr")
        self._pattern: Pattern | None = None

    def prepare(self, matrix: BlockMatrix, values: NDArray[np.float64]) -> TwoGridPreconditioner:
        """Return the preconditioner of a matrix; the values of its upper triangle are not needed.

        Raises
        ------
        SolverError
            The matrix is not positive definite.
        """
        del values
        starts, columns, blocks = matrix
        fine = sp.bsr_array((blocks.reshape(-1, 3, 3), columns, starts)).tocsr()
        coarse = (self._by_axis.T @ (fine @ self._by_axis)).tocsr()
        coarse = coarse + sp.diags_array(_STIFFENED * coarse.diagonal())
        upper = sp.csr_array(sp.triu(coarse))
        upper.sort_indices()
        if self._pattern is None:
            self._pattern = self._solver.analyse(upper.indptr, upper.indices, approximate=True)
        return TwoGridPreconditioner(
            matrix.single(), self._prolong, self._restrict, self._pattern.factorize(upper.data)
        )


def trilinear(nodes_m: NDArray[np.float64]) -> sp.csr_array:
    """Return the functions (f, c) of the coarse grid at nodes (f, 3), single precision."""
    low, size = nodes_m.min(axis=0), np.ptp(nodes_m, axis=0)
    distance = (np.prod(size) / len(nodes_m)) ** (1 / 3)
    cubes = np.maximum(np.rint(size / (_COARSER * distance)).astype(int), 1)
    place = (nodes_m - low) / size * cubes
    cube = np.minimum(place.astype(int), cubes - 1)
    place -= cube
    corners = np.stack(np.meshgrid(*[[0, 1]] * 3, indexing="ij"), axis=-1).reshape(8, 3)
    weight = np.where(corners, place[:, None], 1 - place[:, None]).prod(axis=-1)
    number = np.ravel_multi_index(
        tuple(np.moveaxis(cube[:, None] + corners, -1, 0)), tuple(cubes + 1)
    )
    starts = np.arange(0, weight.size + 1, 8)
    whole = sp.csr_array(
        (weight.ravel(), number.ravel(), starts), (len(nodes_m), np.prod(cubes + 1))
    )
    whole.eliminate_zeros()
    kept = whole.power(2).sum(axis=0) > _SUPPORT
    return whole[:, np.flatnonzero(kept)].astype(np.float32)


class TwoGridPreconditioner:
    """An approximate inverse of one matrix, symmetric and positive definite."""

    def __init__(
        self, matrix: BlockMatrix, prolong: sp.csr_array, restrict: sp.csr_array, coarse: Factor
    ) -> None:
        self._matrix, self._coarse = matrix, coarse
        self._prolong, self._restrict = prolong, restrict
        self._inverse = np.linalg.inv(matrix.diagonal)
        self._steps = _chebyshev_steps(_largest_eigenvalue(matrix, self._inverse))
        self._work: tuple[NDArray[np.float32], ...] = ()

    def __call__(self, residual: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the correction (f, 3, k); it lasts until the next call."""
        f, _, k = residual.shape
        if not self._work or self._work[0].shape != residual.shape:
            self._work = tuple(np.empty((f, 3, k), np.float32) for _ in range(3))
        x, other, change = self._work
        _begin(x, change, residual, self._inverse, self._steps[0][0])
        for step in self._steps[1:]:
            _smooth(other, x, change, residual, self._inverse, *self._matrix, *step)
            x, other = other, x
        self._matrix.products(x, other)
        other -= residual
        rough = self._restrict @ other.reshape(f, 3 * k)
        found = self._coarse.solve(rough.reshape(-1, k))
        x -= (self._prolong @ found.astype(np.float32).reshape(rough.shape)).reshape(x.shape)
        for step in self._steps:
            _smooth(other, x, change, residual, self._inverse, *self._matrix, *step)
            x, other = other, x
        return x


def _largest_eigenvalue(matrix: BlockMatrix, inverse: NDArray[np.float32]) -> float:
    """Upper estimate of the largest eigenvalue of D^-1 K (power iteration)."""
    x = np.random.default_rng(0).normal(size=(len(inverse), 3, _POWER_VECTORS)).astype(np.float32)
    product, largest = np.empty_like(x), np.ones(_POWER_VECTORS)
    for _ in range(_POWER_STEPS):
        x /= np.linalg.norm(x, axis=(0, 1))
        x = inverse @ matrix.products(x, product)
        largest = np.linalg.norm(x, axis=(0, 1))
    return 1.1 * float(largest.max())


def _chebyshev_steps(largest: float) -> list[tuple[np.float32, np.float32]]:
    """Weights of the residual and of the previous change in each step."""
    middle = largest * (1 + 1 / _DAMPED) / 2
    half = largest * (1 - 1 / _DAMPED) / 2
    rho = half / middle
    steps = [(1 / middle, 0.0)]
    for _ in range(_DEGREE - 1):
        new = 1 / (2 * middle / half - rho)
        steps.append((2 * new / half, new * rho))
        rho = new
    return [(np.float32(taken), np.float32(kept)) for taken, kept in steps]


@numba.njit(cache=True, parallel=True, fastmath=True)
def _begin(x, change, b, inverse, taken):
    for i in numba.prange(len(x)):
        for c in range(x.shape[2]):
            u, v, w = b[i, 0, c], b[i, 1, c], b[i, 2, c]
            for a in range(3):
                t = taken * (inverse[i, a, 0] * u + inverse[i, a, 1] * v + inverse[i, a, 2] * w)
                change[i, a, c] = t
                x[i, a, c] = t


@numba.njit(cache=True, parallel=True, fastmath=True)
def _smooth(new, x, change, b, inverse, starts, columns, blocks, taken, kept):
    for i in numba.prange(len(x)):
        r = np.empty_like(b[i])
        for a in range(3):
            for c in range(x.shape[2]):
                r[a, c] = -b[i, a, c]
        add_row(r, x, starts[i], starts[i + 1], columns, blocks)
        for c in range(x.shape[2]):
            u, v, w = r[0, c], r[1, c], r[2, c]
            for a in range(3):
                t = inverse[i, a, 0] * u + inverse[i, a, 1] * v + inverse[i, a, 2] * w
                t = kept * change[i, a, c] - taken * t
                change[i, a, c] = t
                new[i, a, c] = x[i, a, c] + t
