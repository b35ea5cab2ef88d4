"""Compiled loops over the cells: values of the stiffness matrix, energies."""

import numba
import numpy as np


@numba.njit(cache=True, fastmath=True)
def fill(data, indptr, chosen, cells, pairs, pair_node, pair_rank, gradients, derivatives,
         weights, lam, mu):  # fmt: skip
    """Add the chosen cells to data; weights (e, q) are E times volume, as in `Stiffness`."""
    nodes = cells.shape[1]
    points = weights.shape[1]
    g = np.empty((points, nodes, 3))
    for e in chosen:
        for q in range(points):
            for i in range(nodes):
                for a in range(3):
                    s = 0.0
                    for v in range(4):
                        s += derivatives[q, i, v] * gradients[e, v, a]
                    g[q, i, a] = s
        m = -1
        for i in range(nodes):
            for j in range(i, nodes):
                m += 1
                pair = pairs[e, m]
                if pair < 0:
                    continue
                # h = sum_q E w g_i g_j'; the block is lam h + mu h' + mu tr(h) I
                h00 = h01 = h02 = h10 = h11 = h12 = h20 = h21 = h22 = 0.0
                swap = cells[e, i] > cells[e, j]
                r, c = (j, i) if swap else (i, j)
                for q in range(points):
                    w = weights[e, q]
                    x, y, z = w * g[q, r, 0], w * g[q, r, 1], w * g[q, r, 2]
                    u, v_, t = g[q, c, 0], g[q, c, 1], g[q, c, 2]
                    h00 += x * u
                    h01 += x * v_
                    h02 += x * t
                    h10 += y * u
                    h11 += y * v_
                    h12 += y * t
                    h20 += z * u
                    h21 += z * v_
                    h22 += z * t
                trace = mu * (h00 + h11 + h22)
                row = 3 * pair_node[pair]
                k = pair_rank[pair]
                s0 = indptr[row] + 3 * k
                s1 = indptr[row + 1] + 3 * k - 1
                s2 = indptr[row + 2] + 3 * k - 2
                data[s0] += (lam + mu) * h00 + trace
                data[s0 + 1] += lam * h01 + mu * h10
                data[s0 + 2] += lam * h02 + mu * h20
                data[s1 + 1] += (lam + mu) * h11 + trace
                data[s1 + 2] += lam * h12 + mu * h21
                data[s2 + 2] += (lam + mu) * h22 + trace
                if k > 0:
                    data[s1] += lam * h10 + mu * h01
                    data[s2] += lam * h20 + mu * h02
                    data[s2 + 1] += lam * h21 + mu * h12


@numba.njit(cache=True, fastmath=True)
def fill_mean(data, indptr, cells, pairs, pair_node, pair_rank, mean, weights):
    """Add the resistance to each cell's mean change of volume, weights (e,) times lambda."""
    nodes = cells.shape[1]
    for e in range(cells.shape[0]):
        m = -1
        for i in range(nodes):
            for j in range(i, nodes):
                m += 1
                pair = pairs[e, m]
                if pair < 0:
                    continue
                r, c = (j, i) if cells[e, i] > cells[e, j] else (i, j)
                k = pair_rank[pair]
                for a in range(3):
                    start = indptr[3 * pair_node[pair] + a] + 3 * k - a
                    for b in range(a if k == 0 else 0, 3):
                        data[start + b] += weights[e] * mean[e, r, a] * mean[e, c, b]


@numba.njit(cache=True, fastmath=True)
def fill_fibres(data, indptr, pairs, pair_node, pair_rank, slopes, weights, square):
    """Add fibres: slopes (e, q, i) of the shape functions along them, square a a'."""
    nodes = slopes.shape[2]
    for e in range(slopes.shape[0]):
        m = -1
        for i in range(nodes):
            for j in range(i, nodes):
                m += 1
                pair = pairs[e, m]
                if pair < 0:
                    continue
                s = 0.0
                for q in range(weights.shape[1]):
                    s += weights[e, q] * slopes[e, q, i] * slopes[e, q, j]
                k = pair_rank[pair]
                for a in range(3):
                    start = indptr[3 * pair_node[pair] + a] + 3 * k - a
                    for b in range(a if k == 0 else 0, 3):
                        data[start + b] += s * square[a, b]


@numba.njit(cache=True, fastmath=True, parallel=True)
def energies(out, u, cells, gradients, derivatives, weights, lam, mu):
    """Write to out (e, q, j) twice the strain energy for E = 1 of fields u (n, 3, j)."""
    nodes = cells.shape[1]
    presses = u.shape[2]
    for e in numba.prange(cells.shape[0]):
        g = np.empty((nodes, 3))
        d = np.empty((6, presses))  # strains xx, yy, zz and twice xy, xz, yz
        for q in range(weights.shape[1]):
            for i in range(nodes):
                for a in range(3):
                    s = 0.0
                    for v in range(4):
                        s += derivatives[q, i, v] * gradients[e, v, a]
                    g[i, a] = s
            d[:] = 0.0
            for i in range(0, nodes, 2):  # two nodes at once: half the traffic of d
                m, n = cells[e, i], cells[e, i + 1]
                mx, my, mz = g[i]
                nx, ny, nz = g[i + 1]
                for j in range(presses):
                    x, y, z = u[m, 0, j], u[m, 1, j], u[m, 2, j]
                    r, s, t = u[n, 0, j], u[n, 1, j], u[n, 2, j]
                    d[0, j] += mx * x + nx * r
                    d[1, j] += my * y + ny * s
                    d[2, j] += mz * z + nz * t
                    d[3, j] += my * x + mx * y + ny * r + nx * s
                    d[4, j] += mz * x + mx * z + nz * r + nx * t
                    d[5, j] += mz * y + my * z + nz * s + ny * t
            w = weights[e, q]
            for j in range(presses):
                trace = d[0, j] + d[1, j] + d[2, j]
                squares = d[0, j] ** 2 + d[1, j] ** 2 + d[2, j] ** 2
                shears = d[3, j] ** 2 + d[4, j] ** 2 + d[5, j] ** 2
                out[e, q, j] = w * (lam * trace**2 + mu * (2 * squares + shears))


_TILE = 64  # rows, whose lines the processor's cache holds at once


@numba.njit(cache=True, parallel=True)
def transpose(out, source):
    """Write to the first m columns of out (j, n) the transpose of source (m, j)."""
    rows, columns = source.shape
    for tile in numba.prange((rows + _TILE - 1) // _TILE):
        first, last = tile * _TILE, min((tile + 1) * _TILE, rows)
        for j in range(columns):
            for i in range(first, last):
                out[j, i] = source[i, j]
