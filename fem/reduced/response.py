"""The answer of a reduced model: compliances with bounds, and their derivatives.

The derivatives are energies of the field y, sums over pairs of snapshots, see `fem.reduced.model`.
"""

from __future__ import annotations

import weakref
from collections.abc import Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from fem.errors import SolverError
from fem.palpation.fibres import PAIRS
from fem.palpation.material import Material
from fem.palpation.skin import Skin, by_skin
from fem.reduced.plane_energies import FibreWeights
from fem.reduced.snapshot import Law

if TYPE_CHECKING:
    from fem.reduced.model import ReducedModel

_SPANNED_SLOPE = 1e-3  # of a derivative: its error by the part of the field beyond the span


@dataclass(frozen=True)
class ReducedResponse:
    """Compliances (j,) m/N of a reduced model, with bounds and derivatives.

    Attributes
    ----------
    compliance : (j,) never above the full model's
    high : (j,) never below it
    weights : (j, m) of the snapshots, y
    """

    compliance: np.ndarray
    high: np.ndarray
    weights: np.ndarray
    _model: weakref.ref[ReducedModel]
    _numbers: tuple[int, ...]
    _law: Law
    _material: Material

    @property
    def is_stale(self) -> bool:
        """Whether the basis no longer has the snapshots of this response, and no derivatives."""
        model = self._model()
        return model is None or not all(number in model._snapshots for number in self._numbers)

    @property
    def error(self) -> float:
        """Bound of the relative error of all compliances; infinite where a basis fails."""
        with np.errstate(all="ignore"):
            bound = float(np.max(np.abs(self.high / self.compliance - 1)))
        return bound if np.isfinite(bound) and self.compliance.min() > 0 else np.inf

    @property
    def _basis(self) -> ReducedModel:
        own = self._model()
        if own is None or self.is_stale:
            raise SolverError("the basis has dropped a snapshot of this response; evaluate anew")
        return own

    def _pairs(self) -> Iterator[tuple[int, int, np.ndarray]]:
        """Each pair of snapshots with its weight (j,) in an energy."""
        for column, b in enumerate(self._numbers):
            for row, a in enumerate(self._numbers[: column + 1]):
                often = 1 if a == b else 2
                yield a, b, often * self.weights[:, row] * self.weights[:, column]

    def gradient(self, modulus_gradient: np.ndarray) -> np.ndarray:
        """Return the derivative of the compliances with respect to parameters, (j, k).

        Parameters
        ----------
        modulus_gradient : (p, k) dE/dtheta at the full model's `points_m`, or (p,) of one

        Raises
        ------
        SolverError
            The response is stale.
        """
        own, law = self._basis, self._law
        modes, whole = own._primal, np.atleast_2d(np.asarray(modulus_gradient).T)
        columns = whole[:, : len(own._unit)] / own._unit
        length = np.linalg.norm(columns * modes._root, axis=1)
        by_mode = modes.coefficients(columns, _SPANNED_SLOPE * length, own._pairs)
        result = np.zeros((len(self.compliance), len(columns)))
        along = FibreWeights(law, own.full.stiffness.poisson_ratio).of_energy
        for a, b, weight in self._pairs():
            energy = modes.sums[a, b] @ by_mode.T
            if law.share:
                energy += along @ modes.in_plane[a, b] @ by_mode.T
            if law.stretch_m:
                energy += law.stretch_m * (
                    own._at_surface(a, b, "strains") @ whole[:, own._beside].T
                )
            result -= weight[:, None] * energy
        skin, local = self._material.skin, self._material.local
        if skin is not None:
            near = own.full.floating.near_skin(skin).value
            result -= (near / local**2)[:, None] * whole[:, -len(local) :].T
        return result if np.ndim(modulus_gradient) == 2 else result[:, 0]

    def fibre_moments(self, weight: np.ndarray) -> np.ndarray:
        """Integrals (j, 6) of products of horizontal strains, see `Response.fibre_moments`.

        Of a body with fibres; `weight` (p,) is read as in `gradient`.
        """
        own = self._basis
        column = weight[None, : len(own._unit)] / own._unit
        length = np.linalg.norm(column * own._primal._root, axis=1)
        by_mode = own._primal.coefficients(column, _SPANNED_SLOPE * length, own._pairs)[0]
        total = np.zeros((len(self.compliance), 9))
        for a, b, weights in self._pairs():
            total += weights[:, None] * (own._primal.in_plane[a, b] @ by_mode)
        square = total.reshape(-1, 3, 3)
        i, j = PAIRS.T
        return (square[:, i, j] + square[:, j, i]) / 2

    @property
    def support_sensitivity(self) -> np.ndarray:
        """Derivative by the support's compliances, (j, 2), see `Response.support_sensitivity`."""
        own, springs = self._basis, self._law.springs
        what, square = ("traction", 1.0) if springs is None else ("base", np.square(springs))
        parts = (weight[:, None] * own._at_surface(a, b, what) for a, b, weight in self._pairs())
        return sum(parts, np.zeros((len(self.compliance), 2))) / square

    @property
    def skin_sensitivity(self) -> np.ndarray:
        """Derivative by thickness and factor of the skin, see `Response.skin_sensitivity`."""
        return self._by_skin(self._material.skin or Skin(0.0, 1.0))

    def skin_sensitivity_at_null(self, thickness_m: float) -> np.ndarray:
        """Return the derivative by the factor of a skin that is like the body, (j,) m/N."""
        return self._by_skin(Skin(thickness_m, 1.0))[:, 1]

    def _by_skin(self, skin: Skin) -> np.ndarray:
        own = self._basis
        modulus = self._material.modulus[own._beside]
        parts = (
            weight * (own._at_surface(a, b, "strains") @ modulus) for a, b, weight in self._pairs()
        )
        stretched = sum(parts, np.zeros(len(self.compliance)))
        near = own.full.floating.near_skin(skin)
        return by_skin(skin, near, self._material.local, stretched)
