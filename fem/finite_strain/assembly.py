"""A hyperelastic body on a mesh: forces, energy and tangent stiffness at any displacement.

Degrees of freedom, sparsity pattern and modulus samples are those of
`fem.linear.assembly.Stiffness`, so that at zero displacement the tangent is the linear stiffness
matrix: up to nu = 0.49, and without mean dilatation. Beyond, `Stiffness` takes a part of lambda by
the mean change of a cell's volume (`fem.linear.assembly.split_lame`), while here all of it acts at
every point, or with mean dilatation none.
"""

from __future__ import annotations

import numpy as np

from fem.arrays import read_only
from fem.finite_strain import kernels as kernels
from fem.finite_strain.hyperelastic import HyperelasticLaw
from fem.linear.assembly import Stiffness, lame
from fem.mesh.mesh import Mesh


class FiniteStrainBody:
    """A body held at its fixed surface; total Lagrangian.

    Displacements and forces are vectors over the free degrees of freedom, (3 f,), in the order of
    `Stiffness.free_nodes`; a modulus is given at each sample, (p,) Pa.

    Parameters
    ----------
    mesh : four or ten nodes a cell
    poisson_ratio : of the whole body, at small strain
    law : the hyperelastic law
    fixed_surface : name of the mesh surface that is bonded
    mean_dilatation : the volumetric term sees the mean dilatation of a cell (see
        `fem.finite_strain.kernels`); for a four-node cell this changes nothing.
    """

    def __init__(
        self,
        mesh: Mesh,
        poisson_ratio: float,
        law: HyperelasticLaw,
        fixed_surface: str = "base",
        mean_dilatation: bool = False,
    ) -> None:
        self.mesh = mesh
        self.law = law
        self.mean_dilatation = mean_dilatation and mesh.order == 2
        self.stiffness = Stiffness(mesh, poisson_ratio, fixed_surface)
        s = self.stiffness
        self.gradients = np.ascontiguousarray(
            np.einsum("qiv,eva->eqia", s.rule_derivatives, s.gradients)
        )
        self.weights_m3 = s.volumes[:, None] * s.rule[1]
        self._free_cells = s.free_cells
        self._law = (*lame(poisson_ratio), law.code, float(law.coefficient), self.mean_dilatation)

    @property
    def size(self) -> int:
        """Number of free degrees of freedom."""
        return 3 * len(self.stiffness.free_nodes)

    def nodal(self, free: np.ndarray) -> np.ndarray:
        """Displacement of every node, (n, 3), of a vector (3 f,)."""
        full = np.zeros((len(self.mesh.nodes), 3))
        full[self.stiffness.free_nodes] = free.reshape(-1, 3)
        return full

    def _field(self, modulus_pa: np.ndarray) -> np.ndarray:
        return read_only(np.asarray(modulus_pa, float).reshape(self.weights_m3.shape))

    def internal_force(self, u: np.ndarray, modulus_pa: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the forces (3 f,) N with which the body resists, and its strain energy, J.

        The energy is infinite, and the forces mean nothing, where a cell is inverted.
        """
        force = np.empty((len(self.mesh.nodes), 3))
        energy = kernels.internal_force(
            force, self.nodal(u), self.mesh.cells, self.gradients,
            self.weights_m3, self._field(modulus_pa), *self._law,
        )  # fmt: skip
        return force[self.stiffness.free_nodes].ravel(), float(energy)

    def tangent_values(self, u: np.ndarray, modulus_pa: np.ndarray) -> np.ndarray:
        """Values of the tangent's upper triangle on the stiffness matrix's pattern.

        u must be a state of finite energy.
        """
        s = self.stiffness
        data = np.empty(len(s.indices))
        kernels.tangent(data, s.indptr, self._free_cells, s._pairs, s._pair_node, s._pair_rank,
                        self.nodal(u), self.mesh.cells, self.gradients, self.weights_m3,
                        self._field(modulus_pa), *self._law)  # fmt: skip
        return data

    def sensitivity(self, u: np.ndarray, z: np.ndarray) -> np.ndarray:
        """Work of z (3 f,) on the change of the internal force with each modulus sample, (p,)."""
        out = np.empty(self.weights_m3.shape)
        kernels.sensitivity(out, self.nodal(u), self.nodal(z), self.mesh.cells, self.gradients,
                            self.weights_m3, *self._law)  # fmt: skip
        return out.ravel()

    def linear_energies(self, u: np.ndarray) -> np.ndarray:
        """Twice the linear strain energy for E = 1 that each modulus sample carries, (p,)."""
        lam, mu = self._law[:2]
        slope = np.einsum(
            "eia,eqib->eqab", self.nodal(u)[self.mesh.cells], self.gradients, optimize=True
        )
        strain = (slope + slope.swapaxes(-1, -2)) / 2
        dilation = np.einsum("eqaa->eq", strain)
        if self.mean_dilatation:
            dilation = (dilation * self.stiffness.rule[1]).sum(axis=1, keepdims=True)
        shear = 2 * mu * np.einsum("eqab,eqab->eq", strain, strain)
        return (self.weights_m3 * (shear + lam * dilation**2)).ravel()
