"""Response of a body to unit forces: compliance of every press and its derivatives.

The problem is self-adjoint, so that the fields that give the compliances give their derivatives:

    dC_j/dE_p = -(twice the strain energy of press j at sample p for E = 1).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from fem.linear.kernels import transpose
from fem.linear.modulus_samples import CLOSE_SAMPLES
from fem.near_field.enrichment import sample_basis
from fem.palpation.fibres import HORIZONTAL
from fem.palpation.skin import Skin, by_skin

if TYPE_CHECKING:
    from fem.mesh.mesh import Mesh
    from fem.palpation.constrained_body import ConstrainedBody
    from fem.palpation.material import Material
    from fem.palpation.model import PalpationModel


_GROUP = 32  # presses whose energies are summed together


@dataclass(frozen=True)
class Response:
    """Response of the body to unit forces, for one modulus field.

    Attributes
    ----------
    compliance : (j,) m/N
    model : that was evaluated
    amplitude : (j, m) of the near-field functions, m/N
    """

    compliance: np.ndarray
    model: PalpationModel
    _body: ConstrainedBody
    _material: Material
    _free: np.ndarray  # (3 f, j) finite element part of the fields
    amplitude: np.ndarray
    _springs: tuple[float, float] | None  # of the support, None if it is bonded

    def displacement(self, j: int) -> np.ndarray:
        """Nodal displacement under 1 N at press j, (n, 3) m/N.

        The near-field functions are zero at the nodes; their part lies in between.
        """
        return self._body.stiffness.prolong(self._free[:, [j]])[0]

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """Derivative of each compliance with respect to the modulus samples, (j, p) m/(N Pa)."""
        stiffness, skin = self._body.stiffness, self._material.skin
        presses, own = len(self.compliance), len(stiffness.points_m)
        whole = np.empty((presses, len(self.model.points_m)))
        for group, nodal, by_press in self._fields():
            part = whole[group]
            transpose(part, stiffness.energies(nodal, self.model.close_cells).T)
            part[:, own:] = 0.0
            if self.model.enrichment is not None:
                by_cell = part[:, :own].reshape(len(part), -1, stiffness.samples)
                for integrals in self.model.enrichment.ordinary:
                    integrals.add_energies(
                        by_cell, group.start, stiffness.mesh.cells, by_press, self.amplitude[group]
                    )
                close = self._close_energies(group, nodal, by_press)
                part[:, own:-presses] = self._material.close.by_asked(close).reshape(len(part), -1)
            np.negative(part, out=part)
            if skin is not None:
                membrane = self._body.membrane
                stretched = membrane.strains(nodal)
                by_stretch = membrane.energies(stretched, stretched)
                part[:, membrane.samples] -= skin.stretch_m * by_stretch
        if skin is not None:
            near = self._body.near_skin(skin)
            np.fill_diagonal(whole[:, -presses:], -near.value / self._material.local**2)
        return whole

    def forget_sensitivity(self) -> None:
        """Free the sensitivity, which takes more memory than the fields; it is made again."""
        self.__dict__.pop("sensitivity", None)

    def _fields(self) -> Iterator[tuple[slice, np.ndarray, np.ndarray]]:
        """Fields (j, n, 3) of groups of presses, in the order of `Stiffness.prolong` and by press.

        In groups, as the copies of all fields would take more memory than what is made of them.
        """
        for first in range(0, len(self.compliance), _GROUP):
            group = slice(first, min(first + _GROUP, len(self.compliance)))
            nodal = self._body.stiffness.prolong(self._free[:, group])
            yield group, nodal, np.ascontiguousarray(nodal)

    def _close_energies(self, group: slice, nodal: np.ndarray, by_press: np.ndarray) -> np.ndarray:
        """Twice the energy of fields at the samples around the tips for E = 1, (j, c, s).

        Of `_fields`.
        """
        result = self._body.stiffness.close_energies(nodal, self.model.close_cells)
        result = np.ascontiguousarray(result)
        if self.model.enrichment is not None:
            self.model.enrichment.close.add_energies(
                result, group.start, self.model.mesh.cells, by_press, self.amplitude[group]
            )
        return result

    @cached_property
    def unevenness(self) -> np.ndarray:
        """Part of each compliance, (j,) >= 0, due to a modulus not linear in cells around the tip.

        To first order and without regard to sign: an upper estimate of the error with samples as
        elsewhere.
        """
        stiffness, material = self._body.stiffness, self._material
        by_cell = material.modulus.reshape(-1, stiffness.samples)[self.model.close_cells]
        linear = by_cell @ sample_basis(stiffness) @ CLOSE_SAMPLES.T
        if material.close.steep:
            close = np.concatenate([self._close_energies(*fields) for fields in self._fields()])
        else:  # as in the sensitivity, which whoever corrects a map asks for, too
            first, count = len(stiffness.points_m), material.close.asked.size
            close = -self.sensitivity[:, first : first + count]
            close = close.reshape(len(close), *material.close.asked.shape)
        bent = np.abs(close * (material.close.asked - linear))
        return bent.sum(axis=(1, 2)) / self.compliance

    @cached_property
    def skin_sensitivity(self) -> np.ndarray:
        """Derivative by the thickness and the modulus factor of the skin, (j, 2) 1/N, m/N.

        At f = 1 that towards harder skins; without a skin at all it is 0 or of no use.
        """
        return self._by_skin(self._material.skin or Skin(0.0, 1.0))

    def skin_sensitivity_at_null(self, thickness_m: float) -> np.ndarray:
        """Return the derivative by the factor of a skin that is like the body, (j,) m/N."""
        return self._by_skin(Skin(thickness_m, 1.0))[:, 1]

    def _by_skin(self, skin: Skin) -> np.ndarray:
        near = self._body.near_skin(skin)
        return by_skin(skin, near, self._material.local, self._stretch_energies)

    @cached_property
    def _stretch_energies(self) -> np.ndarray:
        """Twice the energy of a membrane of t (f - 1) = 1 m under each press, (j,)."""
        membrane = self._body.membrane
        strains = membrane.strains(self._body.stiffness.prolong(self._free))
        return membrane.energies(strains, strains) @ self._material.modulus[membrane.samples]

    def gradient(self, modulus_gradient: np.ndarray) -> np.ndarray:
        """Return the derivative of the compliances with respect to parameters, (j, k).

        Parameters
        ----------
        modulus_gradient : (p, k) dE/dtheta at the model's `points_m`.
        """
        return self.sensitivity @ modulus_gradient

    def fibre_moments(
        self, weight: np.ndarray | float = 1.0, plane: np.ndarray = HORIZONTAL
    ) -> np.ndarray:
        """Integrals of the products of in-plane strains, (j, 6) 1/(N Pa) for a weight of 1.

        With the strains e = (e_11, e_22, 2 e_12) under 1 N in the plane of two orthonormal
        directions (2, 3): of weight times e_1^2, e_2^2, e_3^2, e_1 e_2, e_1 e_3, e_2 e_3. If the
        modulus of fibres in the direction t_1 cos(p) + t_2 sin(p) is E_f = c weight,

            dC_j/dc = -(fibre_moments(weight, plane) @ fem.palpation.fibres.fibre_weights(p))_j.

        Parameters
        ----------
        weight : (p,) at the model's `points_m`, or one number
        """
        count = len(self._material.modulus)  # fibres have samples in the cells only
        weight = np.broadcast_to(np.asarray(weight, float), len(self.model.points_m))[:count]
        return np.array([weight @ products for products in self._plane_products(plane)])

    def fibre_sensitivity(self, direction: np.ndarray) -> np.ndarray:
        """Return dC/dE_f by the modulus samples for a unit direction (3,), (j, p) m/(N Pa)."""
        direction = np.asarray(direction, float)
        plane = self.model.fibre_plane(direction)
        weights = plane.weights(direction)
        result = np.zeros((len(self.compliance), len(self.model.points_m)))
        for j, products in enumerate(self._plane_products(plane.plane)):
            result[j, : len(products)] = -(products @ weights)
        return result

    def _plane_products(self, plane: np.ndarray) -> Iterator[np.ndarray]:
        """For each press the products (p, 6) by modulus sample."""
        fibre_plane = self.model.plane(plane)
        for j in range(len(self.compliance)):
            nodal = self._body.stiffness.prolong(self._free[:, [j]])[0]
            yield fibre_plane.products(nodal, self.amplitude[j], j)

    @cached_property
    def support_sensitivity(self) -> np.ndarray:
        """Derivative by the support's normal and tangential compliance, (j, 2) Pa/N.

        The integrals of the squared normal and tangential traction on the support, see
        `fem.linear.support`; at zero compliance too. Where the support slides freely the second is
        0.
        """
        body = self.model.floating
        if self._springs is not None:
            base = self._body.stiffness.prolong(self._free)[:, body.foundation.nodes]
            return body.foundation.products(base, base) / np.square(self._springs)
        traction = self.base_traction()
        return body.foundation.products(traction, traction)

    def compliance_moved(
        self, mesh: Mesh, modulus: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """Compliances (j,) of the body on a mesh with nodes a little elsewhere, to first order.

        With the fields u on the mesh as it is, C - u' dK u; near fields stay as they are, so that
        nodes around the tips must not move.

        Parameters
        ----------
        mesh : with the same cells
        modulus : Young's modulus (p,) Pa at points (p, 3)
        """
        body, material = self.model.moved(mesh, self._springs is not None), self._material
        there = material._replace(modulus=modulus(body.stiffness.points_m))
        change = self.model.values(body, there) - self.model.values(self._body, material)
        moved = self._body.stiffness.product(change, self._free)
        return self.compliance - np.einsum("dj,dj->j", self._free, moved)

    def base_traction(self) -> np.ndarray:
        """Traction (j, b, 3) Pa of the support on the body at the nodes of `Foundation`."""
        body = self.model.floating
        if self._springs is not None:
            base = self._body.stiffness.prolong(self._free)[:, body.foundation.nodes]
            normal, tangential = self._springs
            return body.foundation.scaled(base, -1 / normal, -1 / tangential)
        return body.foundation.tractions(self._reactions(body))

    def _reactions(self, floating: ConstrainedBody) -> np.ndarray:
        """Nodal forces (j, b, 3) of the bonded surface on the body."""
        stiffness = floating.stiffness
        field = stiffness.restrict(self._body.stiffness.prolong(self._free))
        force = stiffness.product(self.model.values(floating, self._material), field)
        force -= floating.loads
        for group, near in self.model.near_fields(stiffness, self._material):
            force[:, group] += np.einsum("jmd,jm->dj", near.coupling, self.amplitude[group])
        return stiffness.prolong(force)[:, floating.foundation.nodes]
