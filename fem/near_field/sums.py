"""Sums over the cells of a press's near field, weighted with a modulus field.

The integrals of `fem.near_field.enrichment` stand for E = 1 at each modulus sample; here they are
weighted with E and added up, or with a field and kept apart.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from fem.arrays import read_only
from fem.mesh.mesh import TET_EDGES

_PLACE = np.array([[0, 3, 4], [3, 1, 5], [4, 5, 2]])  # of a stress's component by its axes
# Node in the middle between two corners, of ten nodes
_BETWEEN = np.zeros((4, 4), int)
_BETWEEN[tuple(TET_EDGES.T)] = _BETWEEN[tuple(TET_EDGES.T[::-1])] = 4 + np.arange(6)


class CellIntegrals(NamedTuple):
    """Integrals of every press's m functions over some cells, for E = 1 at each modulus sample.

    Cells that lie alike under their tips share a row (`fem.near_field.reuse`).

    Attributes
    ----------
    begin : (j + 1,) first of each press's t cells
    cells : (t,) numbers in the mesh
    table : (t,) rows of the cells in the table of modulus samples
    rows : (t,) rows of the next two arrays
    stress : (n, m, k, 6) moments of the functions' stress, see `fem.near_field.cells`
    energy : (n, m (m + 1) / 2, q) contribution of each modulus sample to a, by `pairs`
    basis : (q, a) samples by the terms of the modulus
    raised : (a, 4) number of the moment that is each term times lambda_b
    gradients : (e, 4, 3) 1/m of the mesh's barycentric coordinates
    """

    begin: np.ndarray
    cells: np.ndarray
    table: np.ndarray
    rows: np.ndarray
    stress: np.ndarray
    energy: np.ndarray
    basis: np.ndarray
    raised: np.ndarray
    gradients: np.ndarray

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
        terms = modulus @ self.basis
        _couple(by_function, energy, first, numbers, read_only(modulus), terms, *self)

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

    def works(self, nodes: np.ndarray, fields: np.ndarray) -> np.ndarray:
        """Products (t, m, q) of k with the presses' `fields` (j, n, 3), for each modulus sample."""
        result = np.empty((len(self.cells), self.stress.shape[1], len(self.basis)))
        _works(result, nodes, fields, *self)
        return result


def pairs(energy: np.ndarray) -> np.ndarray:
    """Energies (n, m, m, q) of each pair of functions, once."""
    return energy[:, *np.tril_indices(energy.shape[1])]


@numba.njit(cache=True, fastmath=True, parallel=True)
def _couple(
    by_function, energy, first, numbers, modulus, terms, begin, cells, table, rows, stress,
    energies, basis, raised, gradients,
):  # fmt: skip
    """Sum as `CellIntegrals.add` says."""
    count, samples = stress.shape[1], len(basis)
    for i in numba.prange(len(by_function)):
        parts, force = np.empty((4, 6)), np.empty((numbers.shape[1], 3))
        for t in range(begin[first + i], begin[first + i + 1]):
            row, at, free = rows[t], table[t], numbers[cells[t]]
            pair = 0
            for m in range(count):
                for n in range(m + 1):
                    own = 0.0
                    for q in range(samples):
                        own += modulus[at, q] * energies[row, pair, q]
                    energy[i, m, n] += own
                    if n < m:
                        energy[i, n, m] += own
                    pair += 1
                parts[:] = 0.0
                for a in range(len(raised)):
                    term = terms[at, a]
                    for b in range(4):
                        k = raised[a, b]
                        for s in range(6):
                            parts[b, s] += term * stress[row, m, k, s]
                _nodal(force, parts, gradients[cells[t]])
                for k in range(len(free)):
                    if free[k] >= 0:
                        for a in range(3):
                            by_function[i, m, 3 * free[k] + a] += force[k, a]


@numba.njit(cache=True, fastmath=True)
def _nodal(out, stress, gradients):
    """Write to out (nodes, 3) the forces of a stress (4, 6) times lambda_b in a cell."""
    out[:] = 0.0
    for v in range(4):
        for b in range(4):
            for a in range(3):
                force = 0.0
                for u in range(3):
                    force += stress[b, _PLACE[a, u]] * gradients[v, u]
                if len(out) == 4:
                    out[v, a] += force
                elif b == v:
                    out[v, a] += 3 * force
                else:
                    out[v, a] -= force
                    out[_BETWEEN[v, b], a] += 4 * force


@numba.njit(cache=True, fastmath=True)
def _strain(out, field, nodes, gradients):
    """Write to out (4, 6) a field's strain in a cell by lambda_b; twice xy, xz and yz."""
    out[:] = 0.0
    for v in range(4):
        for b in range(4):
            for a in range(3):
                value = field[nodes[v], a]
                if len(nodes) > 4:
                    if b == v:
                        value *= 3
                    else:
                        value = 4 * field[nodes[_BETWEEN[v, b]], a] - value
                for u in range(3):
                    out[b, _PLACE[a, u]] += value * gradients[v, u]


@numba.njit(cache=True, fastmath=True)
def _work(out, terms, stress, strain, basis, raised):
    """Write to out (q,) the work of moments of a stress (k, 6) in a strain (4, 6)."""
    for a in range(len(raised)):
        total = 0.0
        for b in range(4):
            k = raised[a, b]
            for s in range(6):
                total += strain[b, s] * stress[k, s]
        terms[a] = total
    for q in range(len(basis)):
        total = 0.0
        for a in range(len(raised)):
            total += basis[q, a] * terms[a]
        out[q] = total


@numba.njit(cache=True, fastmath=True, parallel=True)
def _add_energies(
    samples, first, nodes, fields, amplitude, begin, cells, table, rows, stress, energies, basis,
    raised, gradients,
):  # fmt: skip
    """Sum as `CellIntegrals.add_energies` says."""
    count = stress.shape[1]
    for j in numba.prange(len(samples)):
        strain, whole = np.empty((4, 6)), np.empty(stress.shape[2:])
        work, terms = np.empty(len(basis)), np.empty(len(raised))
        for t in range(begin[first + j], begin[first + j + 1]):
            row = rows[t]
            _strain(strain, fields[j], nodes[cells[t]], gradients[cells[t]])
            whole[:] = 0.0
            for m in range(count):
                for k in range(whole.shape[0]):
                    for s in range(6):
                        whole[k, s] += 2 * amplitude[j, m] * stress[row, m, k, s]
            _work(work, terms, whole, strain, basis, raised)
            pair = 0
            for m in range(count):
                for n in range(m + 1):
                    weight = amplitude[j, m] * amplitude[j, n] * (1 if m == n else 2)
                    for q in range(len(work)):
                        work[q] += weight * energies[row, pair, q]
                    pair += 1
            for q in range(len(work)):
                samples[j, table[t], q] += work[q]


@numba.njit(cache=True, fastmath=True, parallel=True)
def _works(
    out, nodes, fields, begin, cells, table, rows, stress, energies, basis, raised, gradients
):
    """Write as `CellIntegrals.works` says."""
    for j in numba.prange(len(fields)):
        strain, terms = np.empty((4, 6)), np.empty(len(raised))
        for t in range(begin[j], begin[j + 1]):
            _strain(strain, fields[j], nodes[cells[t]], gradients[cells[t]])
            for m in range(stress.shape[1]):
                _work(out[t, m], terms, stress[rows[t], m], strain, basis, raised)
