"""A symmetric matrix in blocks of 3 x 3, for products with many vectors at once.

A block is what two nodes share. Vectors are stored (nodes, 3, k), the k values of a degree of
freedom side by side, so that a product runs over them with vector instructions: 80 GFlop/s in
single precision on two cores.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np
from numpy.typing import NDArray


class BlockMatrix(NamedTuple):
    """Both triangles in CSR layout by nodes.

    Attributes
    ----------
    starts : (f + 1,) where the blocks of each node begin
    columns : (b,) the other node of each block, ascending
    blocks : (b, 9) by rows
    """

    starts: NDArray[np.int64]
    columns: NDArray[np.int32]
    blocks: NDArray[np.floating]

    @classmethod
    def of_upper(
        cls, indptr: NDArray[np.int32], indices: NDArray[np.int32], values: NDArray[np.float64]
    ) -> BlockMatrix:
        """Return it for the upper triangle of `fem.linear.assembly.Stiffness`."""
        return cls(*_both_triangles(indptr, indices, values))

    @property
    def diagonal(self) -> NDArray[np.floating]:
        """The blocks on the diagonal, (f, 3, 3)."""
        rows = np.repeat(np.arange(len(self.starts) - 1), np.diff(self.starts))
        return self.blocks[self.columns == rows].reshape(-1, 3, 3)

    def single(self) -> BlockMatrix:
        """Return it in single precision."""
        return self._replace(blocks=self.blocks.astype(np.float32))

    def products(self, x: NDArray, out: NDArray) -> NDArray:
        """Write the products with vectors (f, 3, k) into `out` and return it."""
        _products(out, x, *self)
        return out


@numba.njit(cache=True)
def _both_triangles(indptr, indices, values):
    nodes = (len(indptr) - 1) // 3
    starts = np.zeros(nodes + 1, np.int64)
    for i in range(nodes):
        first = indptr[3 * i]
        count = (indptr[3 * i + 1] - first) // 3
        starts[i + 1] += count
        for k in range(1, count):
            starts[indices[first + 3 * k] // 3 + 1] += 1
    starts = np.cumsum(starts)
    free = starts[:-1].copy()
    columns = np.empty(starts[-1], np.int32)
    blocks = np.empty((starts[-1], 9))
    for i in range(nodes):  # ascending, so that what comes from above stands first in a row
        count = (indptr[3 * i + 1] - indptr[3 * i]) // 3
        for k in range(count):
            j = indices[indptr[3 * i] + 3 * k] // 3
            here, there = free[i], free[j]
            columns[here] = j
            free[i] += 1
            if k > 0:
                columns[there] = i
                free[j] += 1
            for a in range(3):
                for b in range(a if k == 0 else 0, 3):
                    value = values[indptr[3 * i + a] + 3 * k - a + b]
                    blocks[here, 3 * a + b] = value
                    blocks[there, 3 * b + a] = value  # of the diagonal: its lower triangle
    return starts, columns, blocks


@numba.njit(cache=True, parallel=True, fastmath=True)
def _products(y, x, starts, columns, blocks):
    for i in numba.prange(len(x)):
        y[i] = 0.0
        add_row(y[i], x, starts[i], starts[i + 1], columns, blocks)


@numba.njit(cache=True, fastmath=True, inline="always")
def add_row(y, x, first, end, columns, blocks):
    """Add to y (3, k) the product of one node's row with x (f, 3, k)."""
    for place in range(first, end):
        j = columns[place]
        b = blocks[place]
        b0, b1, b2, b3, b4, b5, b6, b7, b8 = b[0], b[1], b[2], b[3], b[4], b[5], b[6], b[7], b[8]
        for c in range(x.shape[2]):
            u, v, w = x[j, 0, c], x[j, 1, c], x[j, 2, c]
            y[0, c] += b0 * u + b1 * v + b2 * w
            y[1, c] += b3 * u + b4 * v + b5 * w
            y[2, c] += b6 * u + b7 * v + b8 * w
