"""Sums over the cells of a press's near field, weighted with a modulus field.

The integrals of `fem.near_field.enrichment.Enrichment` stand for E = 1 at each modulus sample; here
they are weighted with E and added up, or with a field and kept apart.
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, fastmath=True, parallel=True)
def couple(by_function, energy, numbers, modulus, parts, part_energy):
    """Add a press's k to by_function (m, 3 f), and a to energy (m, m), for a modulus (c, q).

    `numbers` (c, nodes) are the cells' nodes among the free ones, -1 where held; `parts` and
    `part_energy` the coupling and energy of `Enrichment`.
    """
    count, cells, samples, nodes, _ = parts.shape
    flat = parts.reshape(count, cells, samples, 3 * nodes)
    for m in numba.prange(count):
        for n in range(count):
            own = 0.0
            for c in range(cells):
                for q in range(samples):
                    own += modulus[c, q] * part_energy[m, n, c, q]
            energy[m, n] += own
        local = np.empty(3 * nodes)
        for c in range(cells):
            local[:] = 0.0
            for q in range(samples):
                weight = modulus[c, q]
                for i in range(3 * nodes):
                    local[i] += weight * flat[m, c, q, i]
            for i in range(nodes):
                free = numbers[c, i]
                if free >= 0:
                    for a in range(3):
                        by_function[m, 3 * free + a] += local[3 * i + a]


@numba.njit(cache=True, fastmath=True, parallel=True)
def add_energies(samples, cells, nodes, field, amplitude, parts, part_energy):
    """Add a press's near-field energy, doubled and for E = 1, to each modulus sample (e, q).

    Of `cells` (c,) with `nodes` (c, nodes), from the finite element part `field` (n, 3) m and the
    `amplitude` (m,) of the near-field functions; `parts`, `part_energy` as in `couple`.
    """
    count, size, shape = len(amplitude), 3 * nodes.shape[1], parts.shape
    flat = parts.reshape(shape[0], shape[1], shape[2], size)
    for c in numba.prange(len(cells)):
        local = np.empty(size)
        for i in range(nodes.shape[1]):
            for a in range(3):
                local[3 * i + a] = field[nodes[c, i], a]
        for q in range(shape[2]):
            value = 0.0
            for m in range(count):
                mixed = 0.0
                for i in range(size):
                    mixed += flat[m, c, q, i] * local[i]
                own = 0.0
                for n in range(count):
                    own += amplitude[n] * part_energy[m, n, c, q]
                value += amplitude[m] * (2 * mixed + own)
            samples[cells[c], q] += value


@numba.njit(cache=True)
def scatter(by_function, numbers, vectors):
    """Add vectors (c, m, nodes, 3) of cells to by_function (m, 3 f); numbers as in `couple`."""
    for c in range(numbers.shape[0]):
        for i in range(numbers.shape[1]):
            free = numbers[c, i]
            if free < 0:
                continue
            for m in range(by_function.shape[0]):
                for a in range(3):
                    by_function[m, 3 * free + a] += vectors[c, m, i, a]
