"""The readings of a scan, linear in a free map and in effects around an estimate, in data space.

Around compliances C_l and effects p_l with the residual r of m readings, whitened,

    r = A (s - s_l) + E (p - p_l) + noise,    s - s_mu = K dev

with s = ln C the logarithms of each press's compliance, dev (g,) the field about its prior mean and
p the effects' parameters. The compliances may be those of the presses themselves: far from the map,
the readings are linear there. The sums of products over each press hold all that the readings say
of s and p. The effects are eliminated under a flat prior; the rest is a target t of as many numbers
as presses:

    t = V' (s - s_mu) + N(0, I),      V V' = A'A - A'E (E'E)^-1 E'A
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from identify.measurement.linearised import Linearised
from identify.measurement.model import MeasurementModel

_LEAST_INFORMATION = 1e-10  # of the best known press: a press left out knows nothing
_FLAT = 1e-6  # precision of the effects' parameters, in scaled coordinates, where no reading asks


@dataclass(frozen=True, eq=False)
class PressSums:
    """Sums over each of j presses of products of a model's whitened columns.

    Attributes
    ----------
    normal : (j, c, c) products of the columns: by ln C, then by the effects' parameters
    gradient : (j, c) their products with the residual
    chi2 : (j,) the residual's own
    """

    normal: np.ndarray
    gradient: np.ndarray
    chi2: np.ndarray

    @classmethod
    def of(cls, model: MeasurementModel, at: Linearised) -> PressSums:
        """Sum a model at a point, its map's own error left out."""
        press = model.readings.press
        own = at.whitened(model.by_log_compliance(at)[:, None], press)
        columns = np.hstack([own, at.jacobian, at.residual[:, None]])
        j, c = model.readings.presses, columns.shape[1]
        sums = np.empty((j, c, c))
        for a in range(c):
            for b in range(a + 1):
                sums[:, a, b] = np.bincount(press, columns[:, a] * columns[:, b], j)
                sums[:, b, a] = sums[:, a, b]
        return cls(sums[:, :-1, :-1], sums[:, :-1, -1], sums[:, -1, -1])

    def weighted(self, weight: np.ndarray) -> PressSums:
        """Return the sums with a weight (j,) of each press."""
        return PressSums(
            weight[:, None, None] * self.normal, weight[:, None] * self.gradient, weight * self.chi2
        )

    def errors(self, shift: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Error (j,) of each press's ln C by the map, as its readings have it, and its variance.

        Beside the effects as they are; `shift` (j,) is ln C at the linearisation less the map's.
        """
        known = self.normal[:, 0, 0]
        known = np.maximum(known, _LEAST_INFORMATION * max(float(known.max()), 1e-300))
        return shift + self.gradient[:, 0] / known, 1 / known

    def some(self, presses: np.ndarray) -> PressSums:
        """Return the sums of some presses."""
        return PressSums(self.normal[presses], self.gradient[presses], self.chi2[presses])


@dataclass(frozen=True, eq=False)
class FieldData:
    """What readings say of a field, with the effects eliminated.

    Attributes
    ----------
    by_field : (j, g) derivative K of s by the field
    root : (j, j) lower triangular V
    target : (j,) t
    offset : (j,) s - s_mu where the readings are linear
    here : (j,) s - s_mu at the present field
    sums : of the presses
    doubt : (j,) variance of ln C beyond the map's error, of presses with errors of their own
    """

    by_field: np.ndarray
    root: np.ndarray
    target: np.ndarray
    offset: np.ndarray
    here: np.ndarray
    sums: PressSums
    doubt: np.ndarray | float = 0.0

    @classmethod
    def of(
        cls,
        sums: PressSums,
        by_field: np.ndarray,
        field: np.ndarray,
        shift: np.ndarray | float = 0.0,
        doubt: np.ndarray | float = 0.0,
    ) -> FieldData:
        """Gather the data around a field (g,), counted from its prior mean.

        `shift` (j,) is s where the readings are linear less s of the field.
        """
        precision = np.diag(sums.normal[:, 0, 0])
        gradient = sums.gradient[:, 0]
        effects = Effects.of(sums)
        if effects.count:
            precision = precision - effects.coupling @ effects.solve(effects.coupling.T)
            gradient = gradient - effects.coupling @ effects.solve(effects.gradient)
        least = _LEAST_INFORMATION * float(np.diag(precision).max())
        precision[np.diag_indices_from(precision)] += least
        root = cholesky(precision, lower=True)
        here = by_field @ field
        offset = here + shift
        target = solve_triangular(root, gradient, lower=True) + root.T @ offset
        return cls(by_field, root, target, offset, here, sums, doubt)

    @cached_property
    def effects(self) -> Effects:
        """The effects' parameters for a given field."""
        return Effects.of(self.sums)

    def error_variance(self, error: float) -> np.ndarray:
        """Variance (j,) of s by a relative error of each press's compliance, and its doubt."""
        return (error**2 + self.doubt) * np.ones(len(self.target))


@dataclass(frozen=True, eq=False)
class Effects:
    """Normal equations of the effects' parameters p (q,), scaled.

    Attributes
    ----------
    normal : (q, q)
    coupling : (j, q) with s
    gradient : (q,)
    """

    normal: np.ndarray
    coupling: np.ndarray
    gradient: np.ndarray

    @classmethod
    def of(cls, sums: PressSums) -> Effects:
        """Sum over the presses."""
        normal = sums.normal[:, 1:, 1:].sum(axis=0)
        flat = _FLAT * np.eye(len(normal))
        return cls(normal + flat, sums.normal[:, 0, 1:], sums.gradient[:, 1:].sum(axis=0))

    @property
    def count(self) -> int:
        """Number of parameters q."""
        return len(self.normal)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Apply the inverse of the normal matrix."""
        return cho_solve(cho_factor(self.normal), right)

    def step(self, moved: np.ndarray) -> np.ndarray:
        """Return p - p_k (q,) for a change (j,) of s."""
        if not self.count:
            return np.empty(0)
        return self.solve(self.gradient - self.coupling.T @ moved)
