"""The readings of a scan, linear in a free map and in effects around an estimate, in data space.

Around an estimate with the residual r of m readings, whitened,

    r = A (s - s_k) + E (p - p_k) + noise,    s - s_mu = K dev

with s the logarithms of each press's compliance and, where travel and force are not proportional,
of its local modulus; dev (g,) the field about its prior mean; p the effects' parameters. The sums
of products over each press hold all that the readings say of s and p. The effects are eliminated
under a flat prior; the rest is a target t of as many numbers as s:

    t = V' (s - s_mu) + N(0, I),      V V' = A'A - A'E (E'E)^-1 E'A
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.linalg import cho_factor, cho_solve, cholesky, solve_triangular

from identify.measurement.model import Linearised, MeasurementModel

_LEAST_INFORMATION = 1e-10  # of the best known number of s: a press left out knows nothing
_FLAT = 1e-6  # precision of the effects' parameters, in scaled coordinates, where no reading asks


@dataclass(frozen=True, eq=False)
class PressSums:
    """Sums over each of j presses of products of a model's whitened columns.

    Attributes
    ----------
    normal : (j, c, c) products of the columns: by ln C, by ln of the local modulus where that
        counts, by the effects' parameters
    gradient : (j, c) their products with the residual
    chi2 : (j,) the residual's own
    of_press : columns that belong to the press itself, 1 or 2
    """

    normal: np.ndarray
    gradient: np.ndarray
    chi2: np.ndarray
    of_press: int

    @classmethod
    def of(cls, model: MeasurementModel, at: Linearised) -> PressSums:
        """Sum a model at a point, its map's own error left out."""
        press, body = model.readings.press, at.body
        parts = [at.by_compliance * body.compliance[press]]
        if at.by_modulus.any():
            parts.append(at.by_modulus * body.local_modulus[press])
        own = at.whitened(np.column_stack(parts), press)
        columns = np.hstack([own, at.jacobian, at.residual[:, None]])
        j, c = model.readings.presses, columns.shape[1]
        sums = np.empty((j, c, c))
        for a in range(c):
            for b in range(a + 1):
                sums[:, a, b] = np.bincount(press, columns[:, a] * columns[:, b], j)
                sums[:, b, a] = sums[:, a, b]
        return cls(sums[:, :-1, :-1], sums[:, :-1, -1], sums[:, -1, -1], len(parts))

    def some(self, presses: np.ndarray) -> PressSums:
        """Return the sums of some presses."""
        return PressSums(
            self.normal[presses], self.gradient[presses], self.chi2[presses], self.of_press
        )


@dataclass(frozen=True, eq=False)
class FieldData:
    """What readings say of a field, with the effects eliminated.

    Attributes
    ----------
    by_field : (n, g) derivative K of s by the field
    root : (n, n) lower triangular V
    target : (n,) t
    presses : j; n is j or 2 j
    offset : (n,) s - s_mu at the present field
    sums : of the presses
    """

    by_field: np.ndarray
    root: np.ndarray
    target: np.ndarray
    presses: int
    offset: np.ndarray
    sums: PressSums

    @classmethod
    def of(cls, sums: PressSums, by_field: np.ndarray, field: np.ndarray) -> FieldData:
        """Gather the data around a field (g,), counted from its prior mean."""
        j, own = len(sums.chi2), sums.of_press
        n = own * j
        precision = np.zeros((own, j, own, j))
        at = np.arange(j)
        for a in range(own):
            for b in range(own):
                precision[a, at, b, at] = sums.normal[:, a, b]
        precision = precision.reshape(n, n)
        gradient = sums.gradient[:, :own].T.ravel()
        effects = Effects.of(sums)
        if effects.count:
            precision = precision - effects.coupling @ effects.solve(effects.coupling.T)
            gradient = gradient - effects.coupling @ effects.solve(effects.gradient)
        least = _LEAST_INFORMATION * float(np.diag(precision).max())
        precision[np.diag_indices(n)] += least
        root = cholesky(precision, lower=True)
        offset = by_field @ field
        target = solve_triangular(root, gradient, lower=True) + root.T @ offset
        return cls(by_field, root, target, j, offset, sums)

    @cached_property
    def effects(self) -> Effects:
        """The effects' parameters for a given field."""
        return Effects.of(self.sums)

    def error_covariance(self, error: float) -> np.ndarray:
        """Covariance (n, n) of s by a relative error of each press's compliance."""
        found = np.diag(np.full(len(self.target), error**2))
        if len(self.target) > self.presses:
            # The map's error moves the stiffness under the tip with the compliance
            low, high = np.arange(self.presses), np.arange(self.presses) + self.presses
            found[low, high] = found[high, low] = -(error**2)
        return found


@dataclass(frozen=True, eq=False)
class Effects:
    """Normal equations of the effects' parameters p (q,), scaled.

    Attributes
    ----------
    normal : (q, q)
    coupling : (n, q) with s
    gradient : (q,)
    """

    normal: np.ndarray
    coupling: np.ndarray
    gradient: np.ndarray

    @classmethod
    def of(cls, sums: PressSums) -> Effects:
        """Sum over the presses."""
        own = sums.of_press
        normal = sums.normal[:, own:, own:].sum(axis=0)
        coupling = (
            sums.normal[:, :own, own:].swapaxes(0, 1).reshape(own * len(sums.chi2), len(normal))
        )
        return cls(
            normal + _FLAT * np.eye(len(normal)), coupling, sums.gradient[:, own:].sum(axis=0)
        )

    @property
    def count(self) -> int:
        """Number of parameters q."""
        return len(self.normal)

    def solve(self, right: np.ndarray) -> np.ndarray:
        """Apply the inverse of the normal matrix."""
        return cho_solve(cho_factor(self.normal), right)

    def step(self, moved: np.ndarray) -> np.ndarray:
        """Return p - p_k (q,) for a change (n,) of s."""
        if not self.count:
            return np.empty(0)
        return self.solve(self.gradient - self.coupling.T @ moved)

    def covariance(self, of_s: np.ndarray) -> np.ndarray:
        """Covariance (q, q) of p for that of s (n, n)."""
        if not self.count:
            return np.zeros((0, 0))
        gain = self.solve(self.coupling.T)
        return self.solve(np.eye(self.count)) + gain @ of_s @ gain.T


def field_derivatives(at: Linearised, of_press: int) -> np.ndarray:
    """Return the derivative (n, g) of s by the field."""
    by_c, by_local = at.body.by_field()
    return np.vstack([by_c, by_local]) if of_press > 1 else by_c
