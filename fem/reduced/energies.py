"""Strain energies of pairs of fields with their near fields, by modulus sample, and their sums.

The energies are bilinear in strains and near-field amplitudes, so that each field's strains are
found once, whatever the number of its pairs.
"""

from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from fem.linear.assembly import split_lame
from fem.linear.modulus_samples import CLOSE_RULE, by_sample
from fem.near_field.enrichment import sample_basis
from fem.near_field.sums import CellIntegrals
from fem.palpation.model import PalpationModel, Response


class Strains(NamedTuple):
    """Strains of every press's displacement, finite element part and near field.

    Attributes
    ----------
    cells : (e, q, 6, j) xx, yy, zz and twice xy, xz, yz of the finite element part at the points of
        the stiffness matrix's rule, in single precision
    dilatation : (e, j) mean change of volume of each cell; None where nothing resists it
    amplitude : (j, m) of the near-field functions
    works : of the functions' stresses on the finite element part, (t, m, q) for E = 1 at each
        modulus sample, for each of the model's near-field integrals
    """

    cells: np.ndarray
    dilatation: np.ndarray | None
    amplitude: np.ndarray
    works: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, response: Response) -> Strains:
        """Return the strains of a full solution."""
        model, stiffness = response.model, response.model.stiffness
        nodal = response._body.stiffness.prolong(response._free)
        by_node = np.ascontiguousarray(nodal.transpose(1, 2, 0))
        mesh, points = model.mesh, stiffness.samples
        cells = np.empty((len(mesh.cells), points, 6, len(nodal)), np.float32)
        _strains(cells, by_node, mesh.cells, stiffness.gradients, stiffness.rule_derivatives)
        dilatation = None
        if stiffness.mean_lame > 0:
            dilatation = np.zeros((len(mesh.cells), len(nodal)))
            for i, nodes in enumerate(mesh.cells.T):
                means = stiffness.mean_gradients[:, i]
                dilatation += np.einsum("ea,eaj->ej", means, by_node[nodes])
        by_press = np.ascontiguousarray(nodal)
        works = tuple(part.works(mesh.cells, by_press) for part in _near_parts(model))
        return cls(cells, dilatation, response.amplitude, works)


def _near_parts(model: PalpationModel) -> tuple[CellIntegrals, ...]:
    """Integrals of the near fields: at the mesh's samples, then at those of the close cells."""
    enrichment = model.enrichment
    return () if enrichment is None else (*enrichment.ordinary, enrichment.close)


def mixed_energies(model: PalpationModel, first: Strains, second: Strains) -> np.ndarray:
    """Twice the energy of two fields in each other at each modulus sample for E = 1, (j, p).

    The samples are those of all cells, then those of the close ones: the model's `points_m` without
    the contact points.
    """
    stiffness, close = model.stiffness, model.close_cells
    presses, points = first.cells.shape[3], stiffness.samples
    lam, mu, mean_lame = split_lame(stiffness.poisson_ratio)
    ordinary, at_close = len(stiffness.points_m), close_table(model)
    result = np.empty((ordinary + len(close) * at_close.shape[1], presses))
    by_cell = result[:ordinary].reshape(-1, points, presses)
    by_close = result[ordinary:].reshape(len(close), at_close.shape[1], presses)
    weights = stiffness.volumes[:, None] * stiffness.rule[1]
    _mixed(by_cell, first.cells, second.cells, weights, lam, mu)
    if len(close):
        by_cell[close] = 0.0
        volumes = stiffness.volumes[close]
        _mixed_close(by_close, first.cells, second.cells, close, volumes, at_close, lam, mu)
    if first.dilatation is not None and second.dilatation is not None:
        product = first.dilatation * second.dilatation
        by_cell += mean_lame * weights[:, :, None] * product[:, None]
    parts = _near_parts(model)
    for number, part in enumerate(parts):
        samples = by_close if number + 1 == len(parts) else by_cell
        _add_near(samples, first.amplitude, second.amplitude, first.works[number],
                  second.works[number], part.begin, part.table, part.rows, part.energy)  # fmt: skip
    return result.T


def close_table(model: PalpationModel) -> np.ndarray:
    """Weights (pairs, s) of the close cells' modulus samples, over the volume.

    Of the energy of the strains at two points q >= r of the stiffness matrix's rule, that of either
    field at either point: strains are linear in a cell.
    """
    at_rule = CLOSE_RULE[0] @ sample_basis(model.stiffness).T
    q, r = np.tril_indices(at_rule.shape[1])
    return by_sample((CLOSE_RULE[1][:, None] * at_rule[:, q] * at_rule[:, r]).T)


@numba.njit(cache=True, fastmath=True, parallel=True)
def _strains(out, u, cells, gradients, derivatives):
    """Write to out (e, q, 6, j) the strains of fields u (n, 3, j)."""
    points, _, presses = out.shape[1:]
    for e in numba.prange(len(cells)):
        d = np.empty((6, presses))
        for q in range(points):
            d[:] = 0.0
            for i in range(cells.shape[1]):
                n, x, y, z = cells[e, i], 0.0, 0.0, 0.0
                for v in range(4):
                    x += derivatives[q, i, v] * gradients[e, v, 0]
                    y += derivatives[q, i, v] * gradients[e, v, 1]
                    z += derivatives[q, i, v] * gradients[e, v, 2]
                for j in range(presses):
                    r, s, t = u[n, 0, j], u[n, 1, j], u[n, 2, j]
                    d[0, j] += x * r
                    d[1, j] += y * s
                    d[2, j] += z * t
                    d[3, j] += y * r + x * s
                    d[4, j] += z * r + x * t
                    d[5, j] += z * s + y * t
            for a in range(6):
                for j in range(presses):
                    out[e, q, a, j] = d[a, j]


@numba.njit(cache=True, fastmath=True)
def _density(a, b, j, lam, mu):
    """Twice the energy density of two strains (6, j) of a press in each other."""
    trace = (a[0, j] + a[1, j] + a[2, j]) * (b[0, j] + b[1, j] + b[2, j])
    straight = a[0, j] * b[0, j] + a[1, j] * b[1, j] + a[2, j] * b[2, j]
    shear = a[3, j] * b[3, j] + a[4, j] * b[4, j] + a[5, j] * b[5, j]
    return lam * trace + mu * (2 * straight + shear)


@numba.njit(cache=True, fastmath=True, parallel=True)
def _mixed(out, first, second, weights, lam, mu):
    """Write to out (e, q, j) the energies of strains (e, q, 6, j) in each other."""
    for e in numba.prange(len(out)):
        for q in range(out.shape[1]):
            a, b, w = first[e, q], second[e, q], weights[e, q]
            for j in range(out.shape[2]):
                out[e, q, j] = w * _density(a, b, j, lam, mu)


@numba.njit(cache=True, fastmath=True, parallel=True)
def _mixed_close(out, first, second, close, volumes, table, lam, mu):
    """Write to out (c, s, j) the energies at the samples of the close cells."""
    samples, presses = out.shape[1:]
    for c in numba.prange(len(close)):
        both = np.empty(presses)
        out[c] = 0.0
        pair = 0
        for q in range(first.shape[1]):
            for r in range(q + 1):
                a, b = first[close[c], q], second[close[c], r]
                for j in range(presses):
                    both[j] = _density(a, b, j, lam, mu)
                if q > r:
                    a, b = first[close[c], r], second[close[c], q]
                    for j in range(presses):
                        both[j] += _density(a, b, j, lam, mu)
                for s in range(samples):
                    w = volumes[c] * table[pair, s]
                    for j in range(presses):
                        out[c, s, j] += w * both[j]
                pair += 1


@numba.njit(cache=True, fastmath=True, parallel=True)
def _add_near(samples, first, second, work, other, begin, table, rows, energies):
    """Add to samples (rows, q, j) what near fields of amplitudes (j, m) have part in."""
    for j in numba.prange(len(first)):
        for t in range(begin[j], begin[j + 1]):
            for q in range(samples.shape[1]):
                value = 0.0
                for m in range(first.shape[1]):
                    own = other[t, m, q]
                    for n in range(first.shape[1]):
                        pair = max(m, n) * (max(m, n) + 1) // 2 + min(m, n)
                        own += second[j, n] * energies[rows[t], pair, q]
                    value += first[j, m] * own + second[j, m] * work[t, m, q]
                samples[table[t], q, j] += value


@numba.njit(cache=True, fastmath=True)
def summed(energies, fields):
    """Return the sums (j, k) of energies (j, p), in single precision, over fields (k, p)."""
    presses, samples = energies.shape
    count = len(fields)
    result = np.zeros((presses, count))
    for j in range(presses):
        for k in range(count):
            total = 0.0
            for p in range(samples):
                total += energies[j, p] * fields[k, p]
            result[j, k] = total
    return result
