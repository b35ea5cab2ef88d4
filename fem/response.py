"""What a body answers to unit forces: compliance of every press and its derivatives.

The problem is self-adjoint, so that the fields that give the compliances give their derivatives:

    dC_j/dE_p = -(twice the strain energy of press j at sample p for E = 1).
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

if TYPE_CHECKING:
    from fem.palpation import HeldBody, PalpationModel


@dataclass(frozen=True)
class Response:
    """What the body answers to unit forces, for one modulus field.

    Attributes
    ----------
    compliance : (j,) m/N
    """

    compliance: np.ndarray
    _model: PalpationModel
    _body: HeldBody
    _modulus: np.ndarray  # (p,)
    _free: np.ndarray  # (3 f, j) finite element part of the fields
    _amplitude: np.ndarray  # (j, m) of the near-field functions
    _springs: tuple[float, float] | None  # of the support, None if it is bonded

    def displacement(self, j: int) -> np.ndarray:
        """Nodal displacement under 1 N at press j, (n, 3) m/N.

        The near-field functions are zero at the nodes: what they add lies in between.
        """
        return self._body.stiffness.prolong(self._free[:, [j]])[0]

    @cached_property
    def cross_compliance(self) -> np.ndarray:
        """Travel at press i under 1 N at press k, (j, j) m/N.

        Symmetric (Maxwell-Betti). With the near field each press's field comes from a space of its
        own: off the diagonal the functions around the loaded press are left out, so that there it
        is for presses whose tips are well apart, and symmetric only to the mesh's accuracy.
        """
        result = self._body.loads.T @ self._free
        result[np.diag_indices(len(result))] = self.compliance
        return result

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """Derivative of each compliance with respect to the modulus samples, (j, p) m/(N Pa)."""
        stiffness = self._body.stiffness
        nodal = stiffness.prolong(self._free)
        result = stiffness.energies(nodal).reshape(len(nodal), -1, stiffness.samples)
        for j, part in enumerate(self._model.enrichments):
            alpha = self._amplitude[j]
            field = nodal[j][stiffness.mesh.cells[part.cells]]
            mixed = np.einsum("m,mcqia,cia->cq", alpha, part.coupling, field, optimize=True)
            own = np.einsum("m,l,mlcq->cq", alpha, alpha, part.energy, optimize=True)
            result[j, part.cells] += 2 * mixed + own
        return -result.reshape(len(nodal), -1)

    def gradient(self, modulus_gradient: np.ndarray) -> np.ndarray:
        """Return the derivative of the compliances with respect to parameters, (j, k).

        Parameters
        ----------
        modulus_gradient : (p, k) dE/dtheta at the model's `points_m`.
        """
        return self.sensitivity @ modulus_gradient

    @cached_property
    def support_sensitivity(self) -> np.ndarray:
        """Derivative by the support's normal and tangential compliance, (j, 2) Pa/N.

        The integrals of the squared normal and tangential traction on the support, see
        `fem.support`; at zero compliance too. Where the support slides freely the second is 0.
        """
        body = self._model.floating
        if self._springs is not None:
            base = self._body.stiffness.prolong(self._free)[:, body.foundation.nodes]
            return body.foundation.displacement_squared(base) / np.square(self._springs)
        return body.foundation.traction_squared(self._reactions(body))

    def _reactions(self, floating: HeldBody) -> np.ndarray:
        """Nodal forces (j, b, 3) of the bonded surface on the body."""
        stiffness = floating.stiffness
        size = len(stiffness.indptr) - 1
        upper = sp.csr_array(
            (self._model.values(stiffness, self._modulus), stiffness.indices, stiffness.indptr),
            shape=(size, size),
        )
        field = stiffness.restrict(self._body.stiffness.prolong(self._free))
        force = upper @ field + upper.T @ field - upper.diagonal()[:, None] * field
        force -= floating.loads
        for group, near in self._model.near_fields(stiffness, self._modulus):
            force[:, group] += np.einsum("djm,jm->dj", near.coupling, self._amplitude[group])
        return stiffness.prolong(force)[:, floating.foundation.nodes]
