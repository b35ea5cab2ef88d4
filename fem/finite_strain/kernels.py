"""Compiled loops over the cells at finite strain: forces, tangent and adjoint sensitivity.

Total Lagrangian: `gradients` (e, q, i, 3) are those of the shape functions in the unloaded body.
With `mean_dilatation` the law's volumetric term sees one dilatation a cell, theta = sum_q w_q J_q,

    W_cell = V [sum_q w_q E_q mu/2 g(Q_q) + mean(E) lambda/2 (ln theta)^2],

which is the three-field method of Simo, Taylor & Pister (1985) with constant pressure: volumetric
terms no longer lock the cell. `E` is that of the sample, lambda and mu are for E = 1.
"""

from __future__ import annotations

import math

import numba
import numpy as np

from fem.finite_strain.hyperelastic import stiffening

# No finite-math flags: an inverted cell has infinite energy, and must be seen to.
_FAST = {"contract", "reassoc", "nsz", "arcp"}


@numba.njit(inline="always")
def _gather(x, u, cell):
    """Fill the displacements (i, 3) of a cell's nodes."""
    for i in range(len(cell)):
        for a in range(3):
            x[i, a] = u[cell[i], a]


@numba.njit(inline="always")
def _kinematics(x, g, nodes, f, h):
    """Fill F and h = F^-T at one point; return J - 1, accurate for small strain."""
    for a in range(3):
        for b in range(3):
            s = 0.0
            for i in range(nodes):
                s += x[i, a] * g[i, b]
            f[a, b] = s
    m01 = f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0]
    m02 = f[0, 0] * f[2, 2] - f[0, 2] * f[2, 0]
    m12 = f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1]
    det = (
        f[0, 0] * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
        - f[0, 1] * (f[1, 0] * f[2, 2] - f[1, 2] * f[2, 0])
        + f[0, 2] * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
    )
    growth = f[0, 0] + f[1, 1] + f[2, 2] + m01 + m02 + m12 + det
    for a in range(3):
        f[a, a] += 1.0
    if growth <= -1.0:
        return growth
    r = 1.0 / (1.0 + growth)
    h[0, 0] = r * (f[1, 1] * f[2, 2] - f[1, 2] * f[2, 1])
    h[0, 1] = r * (f[1, 2] * f[2, 0] - f[1, 0] * f[2, 2])
    h[0, 2] = r * (f[1, 0] * f[2, 1] - f[1, 1] * f[2, 0])
    h[1, 0] = r * (f[0, 2] * f[2, 1] - f[0, 1] * f[2, 2])
    h[1, 1] = r * (f[0, 0] * f[2, 2] - f[0, 2] * f[2, 0])
    h[1, 2] = r * (f[0, 1] * f[2, 0] - f[0, 0] * f[2, 1])
    h[2, 0] = r * (f[0, 1] * f[1, 2] - f[0, 2] * f[1, 1])
    h[2, 1] = r * (f[0, 2] * f[1, 0] - f[0, 0] * f[1, 2])
    h[2, 2] = r * (f[0, 0] * f[1, 1] - f[0, 1] * f[1, 0])
    return growth


@numba.njit(inline="always")
def _invariant(f, log_j):
    """Q = I1 - 3 - 2 ln J, kept from being negative by rounding."""
    s = 0.0
    for a in range(3):
        for b in range(3):
            s += f[a, b] * f[a, b]
    return max(s - 3.0 - 2.0 * log_j, 0.0)


@numba.njit(inline="always")
def _add_forces(r, factor, stress, g, nodes):
    """Add a factor times the nodal forces of a stress (3, 3) at one point to r (i, 3)."""
    for i in range(nodes):
        for a in range(3):
            r[i, a] += factor * (
                stress[a, 0] * g[i, 0] + stress[a, 1] * g[i, 1] + stress[a, 2] * g[i, 2]
            )


@numba.njit(cache=True, fastmath=_FAST, nogil=True)
def internal_force(force, u, cells, gradients, weights, modulus, lam, mu, code, c, mean_dilatation):
    """Fill the nodal forces (n, 3) N and return the strain energy, J; infinite where J <= 0.

    weights (e, q) are volumes, m^3; u (n, 3) m; modulus (e, q) Pa.
    """
    points, nodes = gradients.shape[1], gradients.shape[2]
    force[:] = 0.0
    x = np.empty((nodes, 3))
    r = np.empty((nodes, 3))
    f = np.empty((3, 3))
    h = np.empty((points, 3, 3))
    growth = np.empty(points)
    p = np.empty((3, 3))
    energy = 0.0
    for e in range(cells.shape[0]):
        _gather(x, u, cells[e])
        r[:] = 0.0
        volume = dilated = stiff = 0.0
        for q in range(points):
            growth[q] = _kinematics(x, gradients[e, q], nodes, f, h[q])
            if growth[q] <= -1.0:
                return np.inf
            w = weights[e, q]
            volume += w
            dilated += w * growth[q]
            stiff += w * modulus[e, q]
            log_j = math.log1p(growth[q])
            invariant = _invariant(f, log_j)
            g, g1, _ = stiffening(code, c, invariant)
            scale = w * modulus[e, q]
            energy += scale * 0.5 * mu * g
            pressure = 0.0
            if not mean_dilatation:
                energy += scale * 0.5 * lam * log_j * log_j
                pressure = scale * lam * log_j
            shear = scale * mu * g1
            for a in range(3):
                for b in range(3):
                    p[a, b] = shear * (f[a, b] - h[q, a, b]) + pressure * h[q, a, b]
            _add_forces(r, 1.0, p, gradients[e, q], nodes)
        if mean_dilatation:
            log_theta = math.log1p(dilated / volume)
            energy += stiff * 0.5 * lam * log_theta * log_theta
            factor = stiff * lam * log_theta / (volume + dilated)
            for q in range(points):
                pressure = factor * weights[e, q] * (1.0 + growth[q])
                _add_forces(r, pressure, h[q], gradients[e, q], nodes)
        for i in range(nodes):
            for a in range(3):
                force[cells[e, i], a] += r[i, a]
    return energy


@numba.njit(inline="always")
def _spatial(hg, sg, sw, f, h, g, nodes, second):
    """Fill F^-T g, (F - F^-T) g and `second` times the latter at one point, each (3, i)."""
    for a in range(3):
        for i in range(nodes):
            t = 0.0
            s = 0.0
            for b in range(3):
                t += h[a, b] * g[i, b]
                s += f[a, b] * g[i, b]
            hg[a, i] = t
            sg[a, i] = s - t
            sw[a, i] = second * (s - t)


@numba.njit(inline="always")
def _add_pair(block, r, k, points, g, hg, sg, sw, first, swapped, direct):
    """Add dP/dF between the nodes r and k of a cell to their block; return its isotropic part."""
    trace = 0.0
    for q in range(points):
        trace += first[q] * (
            g[q, r, 0] * g[q, k, 0] + g[q, r, 1] * g[q, k, 1] + g[q, r, 2] * g[q, k, 2]
        )
        for a in range(3):
            d = direct[q] * hg[q, a, r]
            t = swapped[q] * hg[q, a, k]
            s = sw[q, a, r]
            for b in range(3):
                block[a, b] += d * hg[q, b, k] + t * hg[q, b, r] + s * sg[q, b, k]
    return trace


@numba.njit(inline="always")
def _add_dilatation(mean, direct, swapped, hg, weights, growth, volume, pressure):
    """Add what a cell's mean dilatation gives to the factors of its points; fill its mean F^-T g.

    `volume` is that of the deformed cell, `pressure` the mean one times its volume.
    """
    mean[:] = 0.0
    for q in range(len(growth)):
        part = weights[q] * (1.0 + growth[q]) / volume
        direct[q] += pressure * part
        swapped[q] -= pressure * part
        for a in range(3):
            for i in range(mean.shape[1]):
                mean[a, i] += part * hg[q, a, i]


@numba.njit(inline="always")
def _put_block(data, indptr, row, rank, block, trace):
    """Add a block (3, 3) and its isotropic part to three rows of the upper triangle."""
    for a in range(3):
        start = indptr[row + a] + 3 * rank - a
        for b in range(a if rank == 0 else 0, 3):
            data[start + b] += block[a, b] + (trace if a == b else 0.0)


@numba.njit(cache=True, fastmath=_FAST, nogil=True)
def tangent(data, indptr, free, pairs, pair_node, pair_rank, u, cells, gradients, weights, modulus,
            lam, mu, code, c, mean_dilatation):  # fmt: skip
    """Fill the upper triangle of the tangent stiffness (see `fem.linear.assembly.Stiffness`).

    `free` (e, i) are the cells' nodes numbered among the free ones; J > 0 everywhere is assumed
    (a state whose energy is finite).
    """
    points, nodes = gradients.shape[1], gradients.shape[2]
    data[:] = 0.0
    x = np.empty((nodes, 3))
    f = np.empty((3, 3))
    h = np.empty((3, 3))
    growth = np.empty(points)
    hg = np.empty((points, 3, nodes))  # F^-T g, spatial gradients
    sg = np.empty((points, 3, nodes))  # (F - F^-T) g
    sw = np.empty((points, 3, nodes))
    mean = np.empty((3, nodes))
    first = np.empty(points)  # factors of the four terms of dP/dF
    swapped = np.empty(points)
    direct = np.empty(points)
    block = np.empty((3, 3))
    for e in range(cells.shape[0]):
        _gather(x, u, cells[e])
        volume = dilated = stiff = 0.0
        for q in range(points):
            growth[q] = _kinematics(x, gradients[e, q], nodes, f, h)
            w = weights[e, q]
            volume += w
            dilated += w * growth[q]
            stiff += w * modulus[e, q]
            log_j = math.log1p(growth[q])
            _, g1, g2 = stiffening(code, c, _invariant(f, log_j))
            scale = w * modulus[e, q]
            first[q] = scale * mu * g1
            second = scale * 2.0 * mu * g2
            swapped[q] = first[q] - (0.0 if mean_dilatation else scale * lam * log_j)
            direct[q] = 0.0 if mean_dilatation else scale * lam
            _spatial(hg[q], sg[q], sw[q], f, h, gradients[e, q], nodes, second)
        bulk = 0.0
        if mean_dilatation:
            log_theta = math.log1p(dilated / volume)
            bulk = stiff * lam * (1.0 - log_theta)
            _add_dilatation(
                mean, direct, swapped, hg, weights[e], growth, volume + dilated,
                stiff * lam * log_theta,
            )  # fmt: skip
        m = -1
        for i in range(nodes):
            for j in range(i, nodes):
                m += 1
                pair = pairs[e, m]
                if pair < 0:
                    continue
                r, k = (j, i) if free[e, i] > free[e, j] else (i, j)
                for a in range(3):
                    for b in range(3):
                        block[a, b] = bulk * mean[a, r] * mean[b, k] if mean_dilatation else 0.0
                trace = _add_pair(
                    block, r, k, points, gradients[e], hg, sg, sw, first, swapped, direct
                )
                _put_block(data, indptr, 3 * pair_node[pair], pair_rank[pair], block, trace)


@numba.njit(cache=True, fastmath=_FAST, nogil=True)
def sensitivity(out, u, z, cells, gradients, weights, lam, mu, code, c, mean_dilatation):
    """Fill z . d(internal force)/dE of every sample (e, q).

    u (n, 3) is the state, z (n, 3) the adjoint.
    """
    points, nodes = gradients.shape[1], gradients.shape[2]
    x = np.empty((nodes, 3))
    y = np.empty((nodes, 3))
    f = np.empty((3, 3))
    h = np.empty((3, 3))
    for e in range(cells.shape[0]):
        _gather(x, u, cells[e])
        _gather(y, z, cells[e])
        volume = dilated = change = 0.0
        for q in range(points):
            growth = _kinematics(x, gradients[e, q], nodes, f, h)
            w = weights[e, q]
            log_j = math.log1p(growth)
            _, g1, _ = stiffening(code, c, _invariant(f, log_j))
            shear = 0.0  # S : grad z
            dilation = 0.0  # F^-T : grad z
            for a in range(3):
                for b in range(3):
                    s = 0.0
                    for i in range(nodes):
                        s += y[i, a] * gradients[e, q, i, b]
                    shear += (f[a, b] - h[a, b]) * s
                    dilation += h[a, b] * s
            out[e, q] = w * mu * g1 * shear
            if not mean_dilatation:
                out[e, q] += w * lam * log_j * dilation
            volume += w
            dilated += w * growth
            change += w * (1.0 + growth) * dilation
        if mean_dilatation:
            each = lam * math.log1p(dilated / volume) * change / (volume + dilated)
            for q in range(points):
                out[e, q] += weights[e, q] * each
