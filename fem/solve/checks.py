"""Checks of the input to a sparse solver; each failure names the fault."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

from fem.errors import SolverError

WHAT_TO_DO = (
    "check that the body is held (fixed surface not empty), that every Young's modulus is "
    "positive, that -1 < Poisson's ratio < 0.5 and that no cell is inverted"
)


def checked_pattern(
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


def checked_values(values: ArrayLike, count: int) -> NDArray[np.float64]:
    """Return the values (count,) as float64, or say which one is not finite."""
    data = np.ascontiguousarray(values, np.float64)
    if data.shape != (count,):
        raise SolverError(f"The pattern has {count} entries, but the values are {data.shape}.")
    if not np.isfinite(data).all():
        bad = int(np.flatnonzero(~np.isfinite(data))[0])
        raise SolverError(f"Entry {bad} of the matrix is {data[bad]}: {WHAT_TO_DO}.")
    return data


def checked_rows(rows: ArrayLike, size: int) -> NDArray[np.bool_]:
    """Return which of all rows (n,) are among those numbered (k,)."""
    numbers = np.asarray(rows, np.int64)
    if numbers.ndim != 1 or not numbers.size or numbers.min() < 0 or numbers.max() >= size:
        raise SolverError(f"Loaded rows must be numbers from 0 to {size - 1}, and one at least.")
    among = np.zeros(size, bool)
    among[numbers] = True
    return among


def checked_rhs(rhs: ArrayLike, size: int) -> NDArray[np.float64]:
    """Return the right-hand side (n,) or (n, r) as float64."""
    load = np.asarray(rhs, np.float64)
    if load.ndim not in (1, 2) or load.shape[0] != size:
        raise SolverError(
            f"The right-hand side must be ({size},) or ({size}, r), but is {load.shape}."
        )
    return load
