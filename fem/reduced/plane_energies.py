"""Integrals of products of two fields' in-plane strains, which the energies of fibres are made of.

With the strains e = (e_xx, e_yy, 2 e_xy) and fibres of the modulus s E in the direction a, so that
a.eps.a = T.e (`fem.palpation.fibres`), two fields have the energy

    int s E (T.e_a)(T.e_b) = s T' M_ab T,    M_ab = sum_p E_p int_p e_a e_b',

in each other. The stresses of a snapshot with fibres s_a, T_a do work on the strains that they
cause in a body of other fibres s, T. By the formula of Sherman and Morrison for its flexibility,

    H_ab += sum over (E_a E_b / E) of  e_a' W e_b,
    W = s_b T_b T_b' + s_a T_a T_a' + s_a s_b k(a, b) T_a T_b'
        - s/(1 + s) (T + s_a k(., a) T_a)(T + s_b k(., b) T_b)',

where k(a, b) = (1 + nu)(a.b)^2 - nu is the strain along one direction by a unit stress along the
other. This takes the strains at each point; that nearly incompressible cells have one change of
volume each makes the bound no longer strict, in second order.
"""

from __future__ import annotations

from functools import cached_property

import numba
import numpy as np

from fem.palpation.fibres import HORIZONTAL
from fem.palpation.model import PalpationModel
from fem.reduced.energies import Strains
from fem.reduced.snapshot import Law

_IN_PLANE = np.array([0, 1, 3])  # of the six strains of `Strains.cells`
_CHUNK = 64  # cells


class PlaneEnergies:
    """Products of the in-plane strains of two fields of every press."""

    def __init__(self, model: PalpationModel, first: Strains, second: Strains) -> None:
        stiffness = model.stiffness
        self._first, self._second = first.cells, second.cells
        self._weights = stiffness.volumes[:, None] * stiffness.rule[1]
        plane = model.plane(HORIZONTAL)
        cells = [] if plane.parts is None else plane.parts.cells
        self._cells = np.concatenate([np.zeros(0, int), *cells])
        lengths = [len(one) for one in cells] or [0] * first.cells.shape[3]
        self._begin = np.concatenate([[0], np.cumsum(lengths)])
        self._near = np.zeros((len(self._cells), stiffness.samples, 9), np.float32)
        if plane.parts is not None:
            at_vertices = np.linalg.pinv(stiffness.rule[0])  # strains are linear in a cell
            mixed = np.ascontiguousarray(plane.parts.mixed @ at_vertices)
            _near_products(self._near, first.cells, second.cells, first.amplitude,
                           second.amplitude, self._begin, self._cells,
                           np.concatenate(plane.parts.rows), mixed,
                           plane.near_products)  # fmt: skip

    def summed(self, fields: np.ndarray) -> np.ndarray:
        """Return the sums (j, 9, k) over fields (k, p) at the samples, those of the cells first."""
        count = self._weights.size
        by_point = np.ascontiguousarray(fields[:, :count]).reshape(-1, *self._weights.shape)
        weighted = (by_point * self._weights).astype(np.float32)
        presses = self._first.shape[3]
        total = np.zeros((len(fields), 9 * presses))
        for begin in range(0, len(self._weights), _CHUNK):  # products that stay in the cache
            part = slice(begin, begin + _CHUNK)
            a, b = (one[part][:, :, _IN_PLANE] for one in (self._first, self._second))
            products = a[:, :, :, None] * b[:, :, None]
            products = products.reshape(-1, 9 * presses)
            total += weighted[:, part].reshape(len(fields), len(products)) @ products
        result = np.ascontiguousarray(total.reshape(-1, 9, presses).transpose(2, 1, 0))
        _add_near(result, self._near, self._begin, self._cells, by_point)
        return result


class FibreWeights:
    """Weights (9,) of the products of in-plane strains by the fibres of a body.

    Parameters
    ----------
    law : of the body
    poisson_ratio : of its material
    """

    def __init__(self, law: Law, poisson_ratio: float) -> None:
        self._law, self._nu = law, poisson_ratio

    @cached_property
    def of_energy(self) -> np.ndarray:
        """That of the energy of two fields in each other."""
        along = self._law.projection
        return self._law.share * np.outer(along, along).ravel()

    def of_stress(self, first: Law, second: Law) -> np.ndarray:
        """Return that of the work of the stresses of two snapshots of these laws."""
        own = self._law
        (t, along), (ta, by_a), (tb, by_b) = (
            (law.projection, law.share) for law in (own, first, second)
        )
        strain_a = t + by_a * self._strain(own, first) * ta
        strain_b = t + by_b * self._strain(own, second) * tb
        weights = by_b * np.outer(tb, tb) + by_a * np.outer(ta, ta)
        weights += by_a * by_b * self._strain(first, second) * np.outer(ta, tb)
        weights -= along / (1 + along) * np.outer(strain_a, strain_b)
        return weights.ravel()

    def _strain(self, first: Law, second: Law) -> float:
        """Strain along one direction by a stress of E along another."""
        cosine = np.dot(first.direction, second.direction)
        return float((1 + self._nu) * cosine**2 - self._nu)


@numba.njit(cache=True, fastmath=True, parallel=True)
def _add_near(out, near, begin, cells, fields):
    """Add to out (j, 9, k) the near fields' part (t, q, 9), weighted with (k, e, q)."""
    for j in numba.prange(len(out)):
        for t in range(begin[j], begin[j + 1]):
            for k in range(out.shape[2]):
                for q in range(near.shape[1]):
                    w = fields[k, cells[t], q]
                    for n in range(9):
                        out[j, n, k] += w * near[t, q, n]


@numba.njit(cache=True, fastmath=True, parallel=True)
def _near_products(out, first, second, own, other, begin, cells, rows, mixed, products):
    """Write to out (t, q, 9) what near fields of amplitudes (j, m) have part in.

    `first` and `second` (e, q, 6, j) are the strains of the finite element parts, `mixed`
    (n, m, 3, q, r) is that of `PlaneParts` at the rule's points r, `products` those of
    `FibrePlane.near_products`.
    """
    count, points = own.shape[1], out.shape[1]
    for j in numba.prange(len(own)):
        strain, near = np.empty((2, 3, points)), np.empty((2, 3, points, points))
        total = np.empty((points, 9))
        for t in range(begin[j], begin[j + 1]):
            row, cell = rows[t], cells[t]
            near[:] = 0.0
            total[:] = 0.0
            for m in range(count):
                a, b = own[j, m], other[j, m]
                for s in range(3):
                    for q in range(points):
                        for r in range(points):
                            near[0, s, q, r] += a * mixed[row, m, s, q, r]
                            near[1, s, q, r] += b * mixed[row, m, s, q, r]
                for n in range(count):
                    both = a * other[j, n]
                    for q in range(points):
                        for k in range(9):
                            total[q, k] += both * products[row, m, n, q, k]
            for s in range(3):
                for r in range(points):
                    strain[0, s, r] = first[cell, r, _IN_PLANE[s], j]
                    strain[1, s, r] = second[cell, r, _IN_PLANE[s], j]
            for s in range(3):
                for v in range(3):
                    for q in range(points):
                        value = total[q, 3 * s + v]
                        for r in range(points):
                            value += near[0, s, q, r] * strain[1, v, r]
                            value += near[1, v, q, r] * strain[0, s, r]
                        out[t, q, 3 * s + v] = value
