"""Energies that pairs of fields share, by modulus sample, and their sums.

Of two fields u and v, near fields included, the mixed energy at a sample for E = 1: the energy of
u + v there is that of u, that of v, and once this. Where u and v are one, twice its energy.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numba
import numpy as np

from fem.linear.modulus_samples import CLOSE_RULE, by_sample
from fem.near_field.sums import CellIntegrals
from fem.palpation.model import PalpationModel, Response

_CLOSE = by_sample(np.eye(len(CLOSE_RULE[1])))  # (points, samples)


class Field(NamedTuple):
    """Displacement of every press: at the nodes (n, 3, j), and near-field amplitudes (j, m).

    `works` have the work of each near-field function on the former, by sample of a cell (t, m, q).
    """

    nodal: np.ndarray
    amplitude: np.ndarray
    works: tuple[np.ndarray, ...]

    @classmethod
    def of(cls, response: Response, works: tuple[np.ndarray, ...] | None = None) -> Field:
        """Return the field of a full solution; `works` where they are known."""
        model, nodal = response.model, response._body.stiffness.prolong(response._free)
        by_node = np.ascontiguousarray(nodal.transpose(1, 2, 0))
        if works is None:
            works = tuple(_works(by_node, model, part) for _, part in _near_fields(model))
        return cls(by_node, response.amplitude, works)


def mixed_energies(model: PalpationModel, one: Field, others: Sequence[Field]) -> np.ndarray:
    """Return the mixed energies (k, p, j) of a field with each of k others.

    The samples are those of all cells, then those of the close ones: the model's `points_m` without
    the contact points.
    """
    s, close = model.stiffness, model.close_cells
    ordinary = s.samples * len(s.volumes)
    per_close = _CLOSE.shape[1]
    count = ordinary + per_close * len(close)
    out = np.zeros((len(others), count, len(one.amplitude)))
    nodal = np.array([other.nodal for other in others])
    far = np.setdiff1d(np.arange(len(s.volumes)), close)
    for cells, first, derivatives, rule, samples in (
        (far, far * s.samples, s._derivatives, s.rule[1], np.eye(s.samples)),
        (close, ordinary + per_close * np.arange(len(close)), s._close_derivatives,
         CLOSE_RULE[1], _CLOSE),
    ):  # fmt: skip
        weights = s.volumes[cells, None] * rule
        _of_cells(out, one.nodal, nodal, first, s.mesh.cells[cells], s.gradients[cells],
                  derivatives, weights, samples, *s._lame)  # fmt: skip
    if s.mean_lame > 0:
        change = [np.einsum("eia,eiaj->ej", s.mean_gradients, field[s.mesh.cells], optimize=True)
                  for field in (one.nodal, *nodal)]  # fmt: skip
        weights = s.mean_lame * s.volumes[:, None] * s.rule[1]
        for k, other in enumerate(change[1:]):
            both = weights[:, :, None] * (change[0] * other)[:, None]
            out[k, :ordinary] += both.reshape(ordinary, -1)
    for number, (first, part) in enumerate(_near_fields(model)):
        for k, other in enumerate(others):
            _add_near(out[k], first, one.amplitude, other.amplitude, one.works[number],
                      other.works[number], part.begin, part.table, part.rows,
                      part.energy)  # fmt: skip
    return out


def _near_fields(model: PalpationModel) -> list[tuple[int, CellIntegrals]]:
    """Near fields of a model, each with the first of its modulus samples."""
    if model.enrichment is None:
        return []
    ordinary = [(0, part) for part in model.enrichment.ordinary]
    first = model.stiffness.samples * len(model.stiffness.volumes)
    return [*ordinary, (first, model.enrichment.close)]


def _works(nodal: np.ndarray, model: PalpationModel, part: CellIntegrals) -> np.ndarray:
    count, samples = part.coupling.shape[1:3]
    # Where cells keep their mean volume, energies nearly cancel
    exact = np.float64 if model.stiffness.mean_lame > 0 else np.float32
    out = np.empty((len(part.cells), count, samples), exact)
    _work(out, nodal, model.mesh.cells, part.begin, part.cells, part.rows, part.coupling)
    return out


@numba.njit(cache=True, fastmath=True)
def _work(out, nodal, nodes, begin, cells, rows, coupling):
    """Write the products (t, m, q) of couplings with the press's own field (n, 3, j)."""
    count, samples = out.shape[1:]
    corners = nodes.shape[1]
    flat = coupling.reshape(len(coupling), count, samples, 3 * corners)
    local = np.empty(3 * corners)
    for j in range(len(begin) - 1):
        for t in range(begin[j], begin[j + 1]):
            for i in range(corners):
                for a in range(3):
                    local[3 * i + a] = nodal[nodes[cells[t], i], a, j]
            for m in range(count):
                for q in range(samples):
                    total = 0.0
                    for a in range(len(local)):
                        total += flat[rows[t], m, q, a] * local[a]
                    out[t, m, q] = total


@numba.njit(cache=True, fastmath=True)
def _add_near(out, first, one, other, work, works, begin, table, rows, energies):
    """Add near fields to mixed energies (p, j), from `first` on; amplitudes (j, m)."""
    count, samples = work.shape[1:]
    for j in range(len(begin) - 1):
        for t in range(begin[j], begin[j + 1]):
            for q in range(samples):
                total = 0.0
                for m in range(count):
                    own = works[t, m, q]
                    for n in range(count):
                        own += energies[rows[t], m, n, q] * other[j, n]
                    total += one[j, m] * own + other[j, m] * work[t, m, q]
                out[first + samples * table[t] + q, j] += total


@numba.njit(cache=True, fastmath=True, parallel=True)
def _of_cells(out, one, others, first, cells, gradients, derivatives, weights, samples, lam, mu):
    """Add mixed energies of nodal fields (n, 3, j) and (k, n, 3, j) in some cells to (k, p, j).

    `samples` (q, s) has the share of each quadrature point in each sample, `first` (c,) a cell's
    first sample.
    """
    nodes, presses = cells.shape[1], one.shape[2]
    points, per_cell = samples.shape
    for e in numba.prange(len(cells)):
        g = np.empty((nodes, 3))
        d, o, both = np.empty((6, presses)), np.empty((6, presses)), np.empty(presses)
        for q in range(points):
            for i in range(nodes):
                for a in range(3):
                    s = 0.0
                    for v in range(4):
                        s += derivatives[q, i, v] * gradients[e, v, a]
                    g[i, a] = s
            _strains(d, one, cells[e], g)
            w = weights[e, q]
            for k in range(len(others)):
                _strains(o, others[k], cells[e], g)
                for j in range(presses):
                    trace = (d[0, j] + d[1, j] + d[2, j]) * (o[0, j] + o[1, j] + o[2, j])
                    same = d[0, j] * o[0, j] + d[1, j] * o[1, j] + d[2, j] * o[2, j]
                    shear = d[3, j] * o[3, j] + d[4, j] * o[4, j] + d[5, j] * o[5, j]
                    both[j] = w * (lam * trace + mu * (2 * same + shear))
                for s in range(per_cell):
                    if samples[q, s] != 0.0:
                        for j in range(presses):
                            out[k, first[e] + s, j] += samples[q, s] * both[j]


@numba.njit(cache=True, fastmath=True)
def _strains(d, u, nodes, g):
    """Write the strains xx, yy, zz and twice xy, xz, yz (6, j) of fields (n, 3, j) at a point."""
    d[:] = 0.0
    for i in range(0, len(nodes), 2):  # two nodes at once: half the traffic of d
        m, n = nodes[i], nodes[i + 1]
        mx, my, mz = g[i]
        nx, ny, nz = g[i + 1]
        for j in range(d.shape[1]):
            x, y, z = u[m, 0, j], u[m, 1, j], u[m, 2, j]
            r, s, t = u[n, 0, j], u[n, 1, j], u[n, 2, j]
            d[0, j] += mx * x + nx * r
            d[1, j] += my * y + ny * s
            d[2, j] += mz * z + nz * t
            d[3, j] += my * x + mx * y + ny * r + nx * s
            d[4, j] += mz * x + mx * z + nz * r + nx * t
            d[5, j] += mz * y + my * z + nz * s + ny * t


@numba.njit(cache=True, fastmath=True)
def summed(energies, fields):
    """Return the sums (j, k) of energies (p, j), in single precision, over fields (k, p)."""
    samples, presses = energies.shape
    result = np.zeros((len(fields), presses))
    for k in range(len(fields)):
        for p in range(samples):
            for j in range(presses):
                result[k, j] += energies[p, j] * fields[k, p]
    return result.T.copy()
