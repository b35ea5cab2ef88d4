"""Contributions of near-field functions to the rows of a stiffness matrix, cell by cell.

Compiled sums over the nodes of each cell, for `fem.near_field.enrichment.Enrichment`. Vectors
come in the frame of the contact and leave in that of the body.
"""

from __future__ import annotations

import numba
import numpy as np


@numba.njit(cache=True, nogil=True, fastmath=True)
def interpolant(field, derivatives, points, gradients, frame, weights, lam, mu):
    """Less k, and a, of the functions' interpolants, by the stiffness matrix's own quadrature.

    Of functions `field` (m, c, nodes, 3) at the nodes; `derivatives` (nodes, 4, 4) are those of
    `fem.near_field.enrichment.linear_derivatives`, `points` (q, 4) barycentric, `gradients`
    (c, 4, 3) of the barycentric coordinates, `frame` (3, 3) has the contact's axes as rows,
    `weights` (c, q) m^3; lam and mu are for E = 1. Returns the coupling (m, c, q, nodes, 3) and the
    energy (m, m, c, q).
    """
    count, cells, nodes, _ = field.shape
    samples = len(points)
    coupling = np.empty((count, cells, samples, nodes, 3))
    energy = np.empty((count, count, cells, samples))
    g, slope, own = np.empty((3, nodes)), np.empty((3, 3)), np.empty((3, nodes))
    for c in range(cells):
        for q in range(samples):
            _shape_gradients(g, derivatives, points[q], gradients[c])
            for m in range(count):
                slope[:] = 0.0
                for i in range(nodes):
                    for s in range(3):
                        for t in range(3):
                            slope[s, t] += field[m, c, i, s] * g[t, i]
                trace = lam * (slope[0, 0] + slope[1, 1] + slope[2, 2])
                for s in range(3):
                    for i in range(nodes):
                        value = trace * g[s, i]
                        for t in range(3):
                            value += mu * (slope[s, t] + slope[t, s]) * g[t, i]
                        own[s, i] = weights[c, q] * value
                _store(coupling, energy, m, c, q, own, frame, field, -1.0)
    return coupling, energy


@numba.njit(cache=True, nogil=True, fastmath=True)
def exact(stress, raised, basis, derivatives, gradients, frame, field):
    """Rows k (m, c, q, nodes, 3) of the exact functions; their products with the interpolants.

    From `stress` (c, m, k, 3, 3), moments times the monomials of a degree + 1; `raised` (a, 4) are
    the monomials of that degree times a barycentric coordinate, among the k; `basis` (q, a) has the
    modulus samples by monomials; the rest is as in `interpolant`. The products (m, m, c, q) are
    function by interpolant.
    """
    count, cells, nodes, _ = field.shape
    samples, terms = basis.shape
    coupling = np.empty((count, cells, samples, nodes, 3))
    cross = np.empty((count, count, cells, samples))
    g, own = np.empty((4, 3, nodes)), np.empty((3, nodes))
    part, unit = np.empty((3, 3)), np.empty(4)
    for c in range(cells):
        for b in range(4):
            for a in range(4):
                unit[a] = 1.0 if a == b else 0.0
            _shape_gradients(g[b], derivatives, unit, gradients[c])
        for m in range(count):
            for q in range(samples):
                own[:] = 0.0
                for b in range(4):
                    part[:] = 0.0
                    for a in range(terms):
                        moment = stress[c, m, raised[a, b]]
                        for s in range(3):
                            for t in range(3):
                                part[s, t] += basis[q, a] * moment[s, t]
                    for s in range(3):
                        for t in range(3):
                            for i in range(nodes):
                                own[s, i] += part[s, t] * g[b, t, i]
                _store(coupling, cross, m, c, q, own, frame, field, 1.0)
    return coupling, cross


@numba.njit(cache=True, fastmath=True)
def _shape_gradients(g, derivatives, point, gradients):
    """Gradients (3, nodes) of a cell's shape functions at a barycentric point (4,)."""
    g[:] = 0.0
    for i in range(g.shape[1]):
        for v in range(4):
            slope = 0.0
            for b in range(4):
                slope += derivatives[i, v, b] * point[b]
            for t in range(3):
                g[t, i] += slope * gradients[v, t]


@numba.njit(cache=True, fastmath=True)
def _store(coupling, products, m, c, q, own, frame, field, sign):
    """Store sign times own (3, nodes) in the body's frame, and its products with each field."""
    nodes = own.shape[1]
    for i in range(nodes):
        for x in range(3):
            value = 0.0
            for s in range(3):
                value += own[s, i] * frame[s, x]
            coupling[m, c, q, i, x] = sign * value
    for n in range(len(field)):
        value = 0.0
        for i in range(nodes):
            for s in range(3):
                value += own[s, i] * field[n, c, i, s]
        products[m, n, c, q] = value
