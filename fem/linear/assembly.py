"""Stiffness matrix of a tetrahedral mesh on a fixed sparsity pattern, and its strain energies.

The modulus enters at the quadrature points of the cells, E_eq; K is linear in it,

    K = sum_eq E_eq K_eq,    K_eq = w_q V_e B_eq' D B_eq,    D for E = 1 (paper, eqs. 8-10),

so a new modulus field refills the values of the same pattern. Degrees of freedom are numbered node
by node; nodes of the fixed surfaces (one name or several) are left out.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from fem.errors import MeshError
from fem.linear import kernels as kernels
from fem.linear.modulus_samples import CLOSE_RULE, at_rule, by_sample
from fem.linear.quadrature import TET_RULES
from fem.mesh.checks import check_nodes
from fem.mesh.mesh import TET_EDGES, Mesh

POINTWISE = 0.49  # greatest Poisson's ratio whose volumetric stiffness acts at every point


def lame(poisson_ratio: float) -> tuple[float, float]:
    """Lame constants (lambda, mu) for E = 1, eq. (10) of the paper."""
    if not -1 < poisson_ratio < 0.5:
        raise MeshError(f"Poisson's ratio must lie between -1 and 0.5, got {poisson_ratio}")
    nu = poisson_ratio
    return nu / ((1 + nu) * (1 - 2 * nu)), 1 / (2 * (1 + nu))


def split_lame(poisson_ratio: float) -> tuple[float, float, float]:
    """Lame constants (lambda, mu) taken at every point, and the part of lambda for cell means.

    Up to nu = 0.49 the last is zero. Beyond, the pressure that keeps the volume is a mean over each
    cell, for the cells would lock if they had to keep it at every point (mean dilatation).
    """
    lam, mu = lame(poisson_ratio)
    if poisson_ratio <= POINTWISE:
        return lam, mu, 0.0
    pointwise = 2 * mu * POINTWISE / (1 - 2 * POINTWISE)
    return pointwise, mu, lam - pointwise


def barycentric_gradients(nodes: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Gradients of the four barycentric coordinates of each cell, (e, 4, 3) 1/m."""
    v = nodes[cells[:, :4]]
    inverse = np.linalg.inv(v[:, 1:] - v[:, :1])  # columns are grad lambda_1..3
    gradients = np.empty((len(cells), 4, 3))
    gradients[:, 1:] = inverse.transpose(0, 2, 1)
    gradients[:, 0] = -gradients[:, 1:].sum(axis=1)
    return gradients


def shape_functions(barycentric: np.ndarray, order: int) -> np.ndarray:
    """Shape functions (p, nodes) of order 1 or 2 at barycentric points (p, 4) or (p, 3)."""
    if order == 1:
        return barycentric
    pairs = TET_EDGES if barycentric.shape[1] == 4 else TET_EDGES[:3]
    mids = 4 * barycentric[:, pairs[:, 0]] * barycentric[:, pairs[:, 1]]
    return np.hstack([barycentric * (2 * barycentric - 1), mids])


def shape_derivatives(barycentric: np.ndarray, order: int) -> np.ndarray:
    """Return the derivatives dN/dlambda at barycentric points of a tetrahedron, (p, nodes, 4)."""
    p = len(barycentric)
    if order == 1:
        return np.broadcast_to(np.eye(4), (p, 4, 4)).copy()
    d = np.zeros((p, 10, 4))
    for v in range(4):
        d[:, v, v] = 4 * barycentric[:, v] - 1
    for m, (i, j) in enumerate(TET_EDGES):
        d[:, 4 + m, i] = 4 * barycentric[:, j]
        d[:, 4 + m, j] = 4 * barycentric[:, i]
    return d


CloseModulus = tuple[np.ndarray, np.ndarray]


class Stiffness:
    """The stiffness matrix of one mesh and support, to be refilled for any modulus field.

    Attributes
    ----------
    points_m : (e q, 3) where Young's modulus is sampled, q quadrature points a cell, cell by cell.
    indptr, indices : the upper triangle's CSR pattern over the free degrees of freedom.
    rule_derivatives : (q, nodes, 4) of the shape functions by the barycentric coordinates
    mean_gradients : (e, nodes, 3) 1/m, means of the shape functions' gradients over each cell
    mean_lame : the part of lambda (E = 1) that resists the mean change of volume of each cell, see
        `split_lame`
    free_number : (n,) number of each node among the free ones, -1 where held
    free_cells : (e, nodes) these numbers of each cell's nodes
    free_nodes : (f,) nodes that may move; degree of freedom 3 i + a is axis a of `free_nodes[i]`.
    """

    def __init__(
        self, mesh: Mesh, poisson_ratio: float, fixed_surface: str | tuple[str, ...] = "base"
    ) -> None:
        check_nodes(mesh)
        if mesh.cell_volumes.min() <= 0:
            worst = int(mesh.cell_volumes.argmin())
            raise MeshError(f"cell {worst} has volume {mesh.cell_volumes[worst]:.3g} m^3; "
                            "its nodes are in the wrong order or it is flat")  # fmt: skip
        self.mesh = mesh
        self.poisson_ratio = poisson_ratio
        self.rule = TET_RULES[1 if mesh.order == 1 else 2]
        self.gradients = barycentric_gradients(mesh.nodes, mesh.cells)
        self.volumes = mesh.cell_volumes
        points = np.einsum("qv,evi->eqi", self.rule[0], mesh.nodes[mesh.cells[:, :4]])
        self.points_m = points.reshape(-1, 3)
        *self._lame, self.mean_lame = split_lame(poisson_ratio)
        self.rule_derivatives = shape_derivatives(self.rule[0], mesh.order)
        self._close_derivatives = shape_derivatives(CLOSE_RULE[0], mesh.order)
        self.mean_gradients = np.einsum(
            "q,qiv,eva->eia", self.rule[1], self.rule_derivatives, self.gradients, optimize=True
        )
        free = np.ones(len(mesh.nodes), bool)
        for name in (fixed_surface,) if isinstance(fixed_surface, str) else fixed_surface:
            free[mesh.surface_nodes(name)] = False
        self.free_nodes = np.flatnonzero(free)
        self.free_number = np.where(free, np.cumsum(free) - 1, -1).astype(np.int32)
        self.free_cells = self.free_number[mesh.cells]
        self._build_pattern()

    @property
    def samples(self) -> int:
        """Number of modulus samples a cell."""
        return len(self.rule[1])

    def _build_pattern(self) -> None:
        cells = self.free_cells
        a, b = np.triu_indices(cells.shape[1])
        low = np.minimum(cells[:, a], cells[:, b]).ravel()
        high = np.maximum(cells[:, a], cells[:, b]).ravel()
        f = len(self.free_nodes)
        keys = np.where(low >= 0, low.astype(np.int64) * f + high, -1)
        pairs, inverse = np.unique(keys, return_inverse=True)
        if pairs[0] < 0:
            pairs, inverse = pairs[1:], inverse - 1
        i, j = np.divmod(pairs, f)
        first = np.searchsorted(i, np.arange(f + 1))
        neighbours = np.diff(first)  # of node i, itself included, none below it
        lengths = (3 * neighbours[:, None] - np.arange(3)).ravel()
        self.indptr = np.concatenate([[0], np.cumsum(lengths)]).astype(np.int32)
        self.indices = np.empty(self.indptr[-1], np.int32)
        # Where the 3 x 3 block of a node pair begins in rows 3 i, 3 i + 1, 3 i + 2.
        rank = np.arange(len(pairs)) - first[i]
        for axis in range(3):
            start = self.indptr[3 * i + axis] + 3 * rank - axis
            for column in range(3):
                keep = (rank > 0) | (column >= axis)
                self.indices[(start + column)[keep]] = (3 * j + column)[keep]
        self._pair_node = i.astype(np.int32)
        self._pair_rank = rank.astype(np.int32)
        self._pairs = inverse.reshape(len(cells), -1).astype(np.int32)

    def values(self, modulus_pa: np.ndarray, close: CloseModulus | None = None) -> np.ndarray:
        """CSR values of the upper triangle for the modulus at `points_m`.

        Parameters
        ----------
        close : cells (c,) and their modulus (c, s) at samples of their own, see
            `fem.linear.modulus_samples`, which takes the place of that at `points_m` (not where the
            mean change of volume of a cell is resisted)
        """
        modulus = np.ascontiguousarray(modulus_pa, float).reshape(len(self.volumes), -1)
        weights = modulus * self.rule[1] * self.volumes[:, None]
        mean = weights.sum(axis=1)
        data = np.zeros(len(self.indices))
        parts = [(np.arange(len(weights)), self.rule_derivatives, weights)]
        if close is not None and len(close[0]):
            cells, samples = close
            parts[0] = (np.setdiff1d(parts[0][0], cells), self.rule_derivatives, weights)
            weights = np.zeros((len(weights), len(CLOSE_RULE[1])))
            weights[cells] = at_rule(samples) * CLOSE_RULE[1] * self.volumes[cells, None]
            parts.append((cells, self._close_derivatives, weights))
        for cells, derivatives, weights in parts:
            kernels.fill(data, self.indptr, cells, self.free_cells, self._pairs, self._pair_node,
                         self._pair_rank, self.gradients, derivatives, weights,
                         *self._lame)  # fmt: skip
        if self.mean_lame > 0:
            kernels.fill_mean(data, self.indptr, self.free_cells, self._pairs,
                              self._pair_node, self._pair_rank, self.mean_gradients,
                              self.mean_lame * mean)  # fmt: skip
        return data

    def fibre_values(self, direction: np.ndarray, modulus_pa: np.ndarray) -> np.ndarray:
        """CSR values of fibres of that unit direction (3,) and modulus at `points_m`.

        The energy density is E_f/2 (a.eps.a)^2, see `fem.palpation.fibres`.
        """
        modulus = np.ascontiguousarray(modulus_pa, float).reshape(len(self.volumes), -1)
        weights = modulus * self.rule[1] * self.volumes[:, None]
        slopes = np.einsum("qiv,eva,a->eqi", self.rule_derivatives, self.gradients, direction,
                           optimize=True)  # fmt: skip
        data = np.zeros(len(self.indices))
        kernels.fill_fibres(data, self.indptr, self._pairs, self._pair_node, self._pair_rank,
                            slopes, weights, np.outer(direction, direction))  # fmt: skip
        return data

    def energies(
        self, displacement: np.ndarray, close_cells: np.ndarray | None = None
    ) -> np.ndarray:
        """Twice the strain energy for E = 1 that each modulus sample carries, (j, e q).

        Parameters
        ----------
        displacement : (j, n, 3) m
        close_cells : (c,) that have samples of their own, see `values` and `close_energies`
        """
        by_node = np.ascontiguousarray(displacement.transpose(1, 2, 0))
        count = len(self.volumes) * self.samples
        whole = np.empty((count, len(displacement)))
        out = whole.reshape(-1, self.samples, len(displacement))
        weights = self.volumes[:, None] * self.rule[1]
        kernels.energies(out, by_node, self.mesh.cells, self.gradients, self.rule_derivatives,
                         weights, *self._lame)  # fmt: skip
        if close_cells is not None:
            out[close_cells] = 0.0
        if self.mean_lame > 0:
            for j, field in enumerate(displacement):
                dilatation = np.einsum("eia,eia->e", self.mean_gradients, field[self.mesh.cells])
                out[:, :, j] += self.mean_lame * weights * dilatation[:, None] ** 2
        return whole.T

    def close_energies(self, displacement: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Return `energies` at the own samples of the cells around the tips, (j, c, s).

        Without the energy of a cell's mean change of volume.
        """
        by_node = np.ascontiguousarray(displacement.transpose(1, 2, 0))
        out = np.empty((len(cells), len(CLOSE_RULE[1]), len(displacement)))
        weights = self.volumes[cells, None] * CLOSE_RULE[1]
        nodes = self.mesh.cells[cells]
        nodes.setflags(write=False)  # as the mesh's own, so that one kernel is compiled
        kernels.energies(out, by_node, nodes, self.gradients[cells], self._close_derivatives,
                         weights, *self._lame)  # fmt: skip
        return by_sample(out.transpose(2, 0, 1))

    def places(self, row: np.ndarray, column: np.ndarray) -> np.ndarray:
        """Places of entries (row, column) of the upper triangle among its values."""
        size = len(self.indptr) - 1
        rows = np.repeat(np.arange(size, dtype=np.int64), np.diff(self.indptr))
        keys = rows * size + self.indices
        return np.searchsorted(keys, row.astype(np.int64) * size + column)

    def product(self, values: np.ndarray, free: np.ndarray) -> np.ndarray:
        """Product of the whole matrix, given by its upper triangle's values, with (3 f, r)."""
        upper = sp.csr_array((values, self.indices, self.indptr), shape=(len(free),) * 2)
        return upper @ free + upper.T @ free - upper.diagonal()[:, None] * free

    def restrict(self, nodal: np.ndarray) -> np.ndarray:
        """Nodal (r, n, 3) -> free degrees of freedom (3 f, r), Fortran order."""
        return np.asfortranarray(nodal[:, self.free_nodes].reshape(len(nodal), -1).T)

    def prolong(self, free: np.ndarray) -> np.ndarray:
        """Free degrees of freedom (3 f, r) -> nodal (r, n, 3), zero where held.

        In memory by node, which is how `energies` reads it.
        """
        nodal = np.zeros((len(self.mesh.nodes), 3, free.shape[1]))
        nodal[self.free_nodes] = free.reshape(-1, 3, free.shape[1])
        return nodal.transpose(2, 0, 1)
