"""Compliance of every press on a body, and its derivative with respect to the modulus.

One factorisation and a solve with a few right-hand sides a press (the load and its near field) give
all compliances; the problem is self-adjoint, so that the same fields give their derivatives too:

    dC_j/dE_p = -(twice the strain energy of press j at sample p for E = 1).
"""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cached_property

import numba
import numpy as np

from fem.assembly import Stiffness
from fem.contact import Contacts, PressedSurface, contact_weights
from fem.errors import SolverError
from fem.mesh import Mesh
from fem.near_field import Enrichment, enrich
from fem.near_field_moments import FUNCTIONS
from fem.solver import Solver, default_solver

_GROUP = 16  # presses whose near fields are solved together


@dataclass(frozen=True)
class Response:
    """What the body answers to unit forces, for one modulus field.

    Attributes
    ----------
    compliance : (j,) m/N
    """

    compliance: np.ndarray
    _model: PalpationModel
    _free: np.ndarray  # (3 f, j) finite element part of the fields
    _amplitude: np.ndarray  # (j, m) of the near-field functions

    def displacement(self, j: int) -> np.ndarray:
        """Nodal displacement under 1 N at press j, (n, 3) m/N.

        The near-field functions are zero at the nodes: what they add lies in between.
        """
        return self._model.stiffness.prolong(self._free[:, [j]])[0]

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """Derivative of each compliance with respect to the modulus samples, (j, p) m/(N Pa)."""
        stiffness = self._model.stiffness
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


class PalpationModel:
    """A body on its support, pressed at given contacts; evaluated for any modulus field.

    Parameters
    ----------
    mesh : four or ten nodes a cell
    poisson_ratio : of the whole body
    contacts : the presses
    fixed_surface : name of the mesh surface that is bonded
    near_field : add the exact near field of each press (see `fem.near_field`); without it the
        result is that of the bare mesh, as in the paper. A nodal contact has none.
    solver : direct solver, default `fem.solver.default_solver()`
    """

    def __init__(
        self,
        mesh: Mesh,
        poisson_ratio: float,
        contacts: Contacts,
        fixed_surface: str = "base",
        near_field: bool = True,
        solver: Solver | None = None,
    ) -> None:
        self.mesh = mesh
        self.contacts = contacts
        self.stiffness = Stiffness(mesh, poisson_ratio, fixed_surface)
        self._pattern = (solver or default_solver()).analyse(
            self.stiffness.indptr, self.stiffness.indices
        )
        weights = contact_weights(mesh, contacts)
        self._loads = self.stiffness.restrict(weights)
        self.enrichments: list[Enrichment] = []
        if near_field and contacts.profile != "nodal":
            surface = PressedSurface(mesh)
            with ThreadPoolExecutor() as pool:  # the quadrature runs outside the interpreter lock
                self.enrichments = list(
                    pool.map(
                        lambda j: enrich(self.stiffness, surface, contacts, j, weights[j]),
                        range(len(contacts)),
                    )
                )

    @property
    def points_m(self) -> np.ndarray:
        """Where the modulus is sampled, (p, 3) m."""
        return self.stiffness.points_m

    def evaluate(self, modulus_pa: np.ndarray) -> Response:
        """Solve for all presses.

        Parameters
        ----------
        modulus_pa : (p,) Young's modulus at `points_m`, Pa, or one number for a homogeneous body.

        Raises
        ------
        SolverError
            A modulus that is not positive and finite.
        """
        modulus = np.broadcast_to(np.asarray(modulus_pa, float), len(self.points_m))
        if not (np.isfinite(modulus).all() and modulus.min() > 0):
            raise SolverError(
                "Young's modulus must be positive and finite everywhere; its smallest value is "
                f"{np.nanmin(modulus):.4g} Pa"
            )
        factor = self._pattern.factorize(self.stiffness.values(modulus))
        field = factor.solve(self._loads)
        compliance = np.einsum("dj,dj->j", self._loads, field)
        amplitude = np.zeros((len(compliance), FUNCTIONS if self.enrichments else 0))
        # In groups of presses, so that memory does not grow with their number
        for first in range(0, len(self.enrichments), _GROUP):
            group = slice(first, min(first + _GROUP, len(compliance)))
            k, energy = self._near_field(modulus, self.enrichments[group])
            z = factor.solve(k).reshape(len(k), -1, FUNCTIONS)
            k = k.reshape(z.shape)
            load = np.array([part.load for part in self.enrichments[group]])
            missing = load - np.einsum("djm,dj->jm", k, field[:, group])
            schur = energy - np.einsum("djm,djl->jml", k, z, optimize=True)
            amplitude[group] = np.linalg.solve(schur, missing[..., None])[..., 0]
            compliance[group] += np.sum(missing * amplitude[group], axis=1)
            field[:, group] -= np.einsum("djm,jm->dj", z, amplitude[group])
        return Response(compliance, self, field, amplitude)

    def _near_field(
        self, modulus: np.ndarray, parts: list[Enrichment]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Right-hand sides k (3 f, j m) and energies a (j, m, m) of some presses' functions."""
        by_cell = modulus.reshape(-1, self.stiffness.samples)
        j, m = len(parts), FUNCTIONS
        nodal = np.zeros((j, m, len(self.mesh.nodes), 3))
        energy = np.empty((j, m, m))
        for i, part in enumerate(parts):
            local = by_cell[part.cells]
            energy[i] = np.einsum("cq,mlcq->ml", local, part.energy)
            vectors = np.einsum("cq,mcqia->cmia", local, part.coupling)
            _scatter(nodal[i], self.mesh.cells[part.cells], vectors)
        return self.stiffness.restrict(nodal.reshape(j * m, -1, 3)), energy


@numba.njit(cache=True)
def _scatter(nodal, cells, vectors):
    for c in range(cells.shape[0]):
        for m in range(nodal.shape[0]):
            for i in range(cells.shape[1]):
                for a in range(3):
                    nodal[m, cells[c, i], a] += vectors[c, m, i, a]
