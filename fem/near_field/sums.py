"""Sums over the cells of a press's near field, weighted with a modulus field.

The integrals of `fem.near_field.enrichment` stand for E = 1 at each modulus sample; here they are
weighted with E and added up, or with a field and kept apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from fem.arrays import read_only


class CellIntegrals(NamedTuple):
    """Integrals of every press's m functions over some cells, for E = 1 at each modulus sample.

    Cells that lie alike under their tips share a row (`fem.near_field.reuse`).

    Attributes
    ----------
    begin : (j + 1,) first of each press's t cells
    cells : (t,) numbers in the mesh
    table : (t,) rows of the cells in the table of modulus samples
    rows : (t,) rows of the two arrays
    coupling : (n, m, q, nodes, 3) contribution of each modulus sample to k, at each cell's nodes
    energy : (n, m, m, q) contribution of each modulus sample to a
    """

    begin: np.ndarray
    cells: np.ndarray
    table: np.ndarray
    rows: np.ndarray
    coupling: np.ndarray
    energy: np.ndarray

    def add(
        self,
        by_function: np.ndarray,
        energy: np.ndarray,
        first: int,
        numbers: np.ndarray,
        modulus: np.ndarray,
    ) -> None:
        """Add k to by_function (g, m, 3 f) and a to energy (g, m, m) for g presses from `first` on.

        `numbers` (e, nodes) are the mesh's nodes among the free ones, -1 where held; `modulus` is
        the table (rows, q).
        """
        _couple(by_function, energy, first, numbers, read_only(modulus), *self)

    def add_energies(
        self,
        samples: np.ndarray,
        first: int,
        nodes: np.ndarray,
        fields: np.ndarray,
        amplitude: np.ndarray,
    ) -> None:
        """Add near-field energies, doubled and for E = 1, to the modulus samples (g, rows, q).

        Of g presses from `first` on, from the finite element part `fields` (g, n, 3) m and the
        `amplitude` (g, m) of the functions; `nodes` (e, nodes) are the mesh's cells.
        """
        _add_energies(samples, first, nodes, fields, read_only(amplitude), *self)


@numba.njit(cache=True, fastmath=True, parallel=True)
def _couple(
    by_function, energy, first, numbers, modulus, begin, cells, table, rows, coupling, energies
):
    """Sum as `CellIntegrals.add` says."""
    kinds, count, samples, nodes, _ = coupling.shape
    size = 3 * nodes
    flat = coupling.reshape(kinds, count, samples, size)
    for i in numba.prange(len(by_function)):
        local = np.empty(size)
        for t in range(begin[first + i], begin[first + i + 1]):
            row, weights, free = rows[t], modulus[table[t]], numbers[cells[t]]
            for m in range(count):
                for n in range(count):
                    own = 0.0
                    for q in range(samples):
                        own += weights[q] * energies[row, m, n, q]
                    energy[i, m, n] += own
                local[:] = 0.0
                for q in range(samples):
                    weight = weights[q]
                    for a in range(size):
                        local[a] += weight * flat[row, m, q, a]
                for k in range(nodes):
                    if free[k] >= 0:
                        for a in range(3):
                            by_function[i, m, 3 * free[k] + a] += local[3 * k + a]


@numba.njit(cache=True, fastmath=True, parallel=True)
def _add_energies(
    samples, first, nodes, fields, amplitude, begin, cells, table, rows, coupling, energies
):
    """Sum as `CellIntegrals.add_energies` says."""
    kinds, count, per_cell, corners, _ = coupling.shape
    size = 3 * corners
    flat = coupling.reshape(kinds, count, per_cell, size)
    for j in numba.prange(len(samples)):
        local = np.empty(size)
        for t in range(begin[first + j], begin[first + j + 1]):
            row, own_nodes = rows[t], nodes[cells[t]]
            for k in range(corners):
                for a in range(3):
                    local[3 * k + a] = fields[j, own_nodes[k], a]
            for q in range(per_cell):
                value = 0.0
                for m in range(count):
                    mixed = 0.0
                    for a in range(size):
                        mixed += flat[row, m, q, a] * local[a]
                    own = 0.0
                    for n in range(count):
                        own += amplitude[j, n] * energies[row, m, n, q]
                    value += amplitude[j, m] * (2 * mixed + own)
                samples[j, table[t], q] += value
