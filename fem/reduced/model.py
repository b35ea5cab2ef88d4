"""Compliance of every press in a reduced basis of its own.

The field of press j is sought among the full solutions at a few modulus fields, the snapshots:
u = V_j y, near fields included. The stiffness is linear in the modulus samples, K = sum_p E_p K_p;
with the modulus in few modes, E = sum_q c_q phi_q (`fem.reduced.modulus_modes`),

    G_j = V_j' K V_j = sum_q c_q G_jq,    G_j y = V_j' B,    C_j = B' V_j y,
    dC_j/dc_q = -y' G_jq y,

so that an evaluation with all derivatives needs no mesh. C_j is an energy: for a modulus within the
modes it is never above the full one, and its error is of second order in that of the field.

The full compliance lies between two bounds from the residual r = B - K V_j y of the true modulus,

    C_low = 2 B'u - u'K u,    C_high = C_low + r' K0^-1 r / min(E / E0),

for K >= min(E / E0) K0 with a reference body E0. The error over its bound lies between
min(E / E0) / max(E / E0) and 1.

Source: Rozza, Huynh, Patera, Arch. Comput. Methods Eng. 15 (2008) 229.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.errors import SolverError
from fem.palpation.model import PalpationModel
from fem.reduced.energies import (
    Fields,
    by_sample,
    dual_norm_squared,
    forces,
    loads,
    positive_samples,
    samples,
)
from fem.reduced.modulus_modes import ModulusModes

SNAPSHOTS = 12
_MODES = 1e-5  # part of the training fields that their modes may leave out


class ReducedModel:
    """A palpation model in a basis for each press, for modulus fields like those of a training set.

    Without fibres, skin and elastic supports.

    Parameters
    ----------
    full : the model, on a bonded support
    training_pa : (n, p) Young's modulus at the full model's `points_m`, Pa; the first is the
        reference of the error bound, and the first ones are the snapshots
    snapshots : number of full solutions that span each basis
    """

    def __init__(
        self, full: PalpationModel, training_pa: np.ndarray, snapshots: int = SNAPSHOTS
    ) -> None:
        training = np.atleast_2d(np.asarray(training_pa, float))
        if not full.support.bonded:
            raise SolverError("a reduced model needs a bonded support; take the full model")
        if not 1 <= snapshots <= len(training):
            raise SolverError(
                f"snapshots must be between 1 and the {len(training)} training fields, "
                f"not {snapshots}"
            )
        self.full, self.contacts = full, full.contacts
        self._training = training
        self._materials = [full.material(modulus) for modulus in training]
        self._fields = [Fields.of(full.evaluate(modulus)) for modulus in training[:snapshots]]
        self._build()

    def _build(self) -> None:
        """Modes, reduced matrices and loads from the training set and the fields."""
        full, count = self.full, len(self._fields)
        modulus = np.array([samples(material) for material in self._materials])
        alone = [by_sample(full, field) for field in self._fields]
        weight = np.abs(alone[0]).sum(axis=0)
        weight = np.maximum(weight, 1e-3 * weight.mean())
        asked = self._training[:, : modulus.shape[1]]
        usable = np.flatnonzero((np.abs(modulus - asked) <= 1e-9 * asked).all(axis=0))
        self.modes = ModulusModes.of(modulus, weight, usable, _MODES)
        #: where the modulus is asked for, (r, 3) m
        self.points_m = full.points_m[self.modes.points]
        columns = np.column_stack([self.modes.modes, modulus[0]])
        matrix = np.empty((len(self.contacts), count, count, columns.shape[1]))
        for a, first in enumerate(self._fields):
            matrix[:, a, a] = alone[a] @ columns
            for b in range(a):
                both = by_sample(full, first.plus(self._fields[b])) @ columns
                mixed = 0.5 * (both - matrix[:, a, a] - matrix[:, b, b])
                matrix[:, a, b] = matrix[:, b, a] = mixed
        # orthonormal in the energy of the reference body
        scale = np.linalg.inv(np.linalg.cholesky(matrix[..., -1]))  # (j, m, m)
        matrix = np.einsum("jab,jbcq->jacq", scale, matrix[..., :-1], optimize=True)
        matrix = np.einsum("jacq,jdc->jadq", matrix, scale, optimize=True)
        rows, columns = np.tril_indices(count)  # each pair once
        self._pairs = np.ascontiguousarray(matrix[:, rows, columns])  # (j, pairs, q)
        self._place = np.zeros((count, count), int)
        self._place[rows, columns] = self._place[columns, rows] = np.arange(len(rows))
        self._scale = scale
        load = loads(full)
        work = [
            np.einsum("dj,dj->j", load.free, field.free)
            + np.einsum("jm,jm->j", load.amplitude, field.amplitude)
            for field in self._fields
        ]
        self._load = np.einsum("jab,bj->ja", scale, np.array(work))

    @property
    def snapshots(self) -> int:
        """Number of full solutions in each basis."""
        return len(self._fields)

    def evaluate(self, modulus_pa: np.ndarray) -> ReducedResponse:
        """Solve for all presses and a modulus (r,) at `points_m`, Pa.

        Raises
        ------
        SolverError
            A modulus that is not positive and finite, or so far from the training set that its
            modes have no positive energy.
        """
        modulus = np.asarray(modulus_pa, float)
        if modulus.shape != (len(self.points_m),):
            raise SolverError(
                f"Young's modulus must be ({len(self.points_m)},), one at each of the reduced "
                f"model's points_m, but is {modulus.shape}"
            )
        if not (np.isfinite(modulus).all() and modulus.min() > 0):
            raise SolverError("Young's modulus must be positive and finite everywhere")
        pairs = self._pairs.reshape(-1, self._pairs.shape[-1]) @ (self.modes.by_point @ modulus)
        matrix = pairs.reshape(len(self.contacts), -1)[:, self._place]
        try:
            np.linalg.cholesky(matrix)
        except np.linalg.LinAlgError as error:
            raise SolverError(
                "the modulus is too far from the reduced model's training set; let it grow there"
            ) from error
        weights = np.linalg.solve(matrix, self._load[..., None])[..., 0]
        compliance = np.einsum("ja,ja->j", self._load, weights)
        compliance.setflags(write=False)
        return ReducedResponse(compliance, self, weights)

    def bounds(self, modulus_pa: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return bounds (j,) of the full compliance for the modulus (p,) at the full `points_m`.

        They cost one factorisation of the reference body; see the head of this file.
        """
        modulus = np.asarray(modulus_pa, float)
        material, reference = self.full.material(modulus), self._materials[0]
        weights = self.evaluate(modulus[self.modes.points]).weights
        weights = np.einsum("ja,jab->jb", weights, self._scale)
        field = self._fields[0].times(weights[:, 0])
        for weight, snapshot in zip(weights.T[1:], self._fields[1:], strict=True):
            field = field.plus(snapshot.times(weight))
        load, force = loads(self.full), forces(self.full, material, field)
        rest = Fields(load.free - force.free, load.amplitude - force.amplitude)
        low = np.einsum("dj,dj->j", load.free + rest.free, field.free)
        low += np.einsum("jm,jm->j", load.amplitude + rest.amplitude, field.amplitude)
        least = float((positive_samples(material) / positive_samples(reference)).min())
        return low, low + dual_norm_squared(self.full, reference, rest) / least

    def trusted(self, modulus_pa: np.ndarray, tolerance: float) -> bool:
        """Say if compliances at a modulus (p,) are certain to lie within a relative tolerance."""
        try:
            value = self.evaluate(np.asarray(modulus_pa)[self.modes.points]).compliance
        except SolverError:
            return False
        low, high = self.bounds(modulus_pa)
        return bool(
            np.maximum(np.abs(high / value - 1), np.abs(low / value - 1)).max() <= tolerance
        )

    def grow(self, modulus_pa: np.ndarray, tolerance: float) -> bool:
        """Add the full solution at a modulus (p,) where it is not trusted, and say if it did.

        The modulus joins the training set. Modes, points and reduced matrices are new afterwards.
        """
        modulus = np.array(modulus_pa, float)
        if self.trusted(modulus, tolerance):
            return False
        self._fields.append(Fields.of(self.full.evaluate(modulus)))
        self._training = np.vstack([self._training, modulus])
        self._materials.append(self.full.material(modulus))
        self._build()
        return True


@dataclass(frozen=True)
class ReducedResponse:
    """Compliances (j,) m/N of a reduced model, with their derivatives.

    Attributes
    ----------
    weights : (j, m) of each press's orthonormal basis, y
    """

    compliance: np.ndarray
    model: ReducedModel
    weights: np.ndarray

    @cached_property
    def by_mode(self) -> np.ndarray:
        """Derivative of each compliance by the coefficients of the modulus modes, (j, q)."""
        rows, columns = np.tril_indices(self.model.snapshots)
        products = (
            self.weights[:, rows] * self.weights[:, columns] * np.where(rows == columns, 1, 2)
        )
        return -(products[:, None] @ self.model._pairs)[:, 0]

    @cached_property
    def sensitivity(self) -> np.ndarray:
        """Derivative of each compliance by the modulus at the model's `points_m`, (j, r)."""
        return self.by_mode @ self.model.modes.by_point

    def gradient(self, modulus_gradient: np.ndarray) -> np.ndarray:
        """Return the derivative of the compliances with respect to parameters, (j, k).

        Parameters
        ----------
        modulus_gradient : (r, k) dE/dtheta at the model's `points_m`
        """
        return self.by_mode @ (self.model.modes.by_point @ modulus_gradient)
