"""Compliances of a finer model over the coarse model's, carried from one map to its neighbours.

A finer model answers a change of the map almost as the coarse model does: the logarithm of their
ratio is linear in the modulus far beyond either compliance. So one solution of the finer model
serves all maps nearby,

    ln(C'/C)(E) = ln(C'_0 + S' dE') - ln(C_0 + S dE) + e,    e about (b' - b),

where S' and S are the sensitivities, b' and b the bends: the parts of second order, relative to the
compliance. That of the coarse model is known, as it is solved at each map; the finer one's differs
from it by about the share by which the compliances differ, so that e is about b ln(C'/C).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fem.palpation import Response
from identify.body.state import ChangedMap


class _Linear(NamedTuple):
    """A model's compliances (j,) m/N at a modulus (p,) at points (p, 3), and their derivatives."""

    points_m: np.ndarray
    modulus_pa: np.ndarray
    compliance: np.ndarray
    sensitivity: np.ndarray

    @classmethod
    def of(cls, response: Response, there: ChangedMap) -> _Linear:
        points = response.model.points_m
        modulus = there.modulus(points)
        by_modulus = response.sensitivity.astype(np.float32)  # for small changes
        return cls(points, modulus, response.compliance, by_modulus)

    def compliance_at(self, there: ChangedMap) -> np.ndarray:
        change = there.modulus(self.points_m) - self.modulus_pa
        return self.compliance + self.sensitivity @ change.astype(np.float32)


@dataclass(frozen=True)
class LinearRatio:
    """The ratio of two models' compliances around the map of one solution of each."""

    _coarse: _Linear
    _other: _Linear

    @classmethod
    def of(cls, coarse: Response, other: Response, there: ChangedMap) -> LinearRatio:
        """Linearise the solutions of both models for a map."""
        return cls(_Linear.of(coarse, there), _Linear.of(other, there))

    @property
    def nbytes(self) -> int:
        """Memory of the derivatives."""
        return self._coarse.sensitivity.nbytes + self._other.sensitivity.nbytes

    def log_at(
        self, there: ChangedMap, compliance: np.ndarray, tolerance: float
    ) -> np.ndarray | None:
        """Logarithm (j,) of the ratio for a map, or None where its error exceeds the tolerance.

        Parameters
        ----------
        compliance : (j,) of the coarse model for this map
        tolerance : relative, of a compliance
        """
        log_ratio, error = self.estimated(there, compliance)
        return log_ratio if error <= tolerance else None

    def estimated(self, there: ChangedMap, compliance: np.ndarray) -> tuple[np.ndarray, float]:
        """Logarithm (j,) of the ratio for a map, and the scale of its largest error.

        That is infinite where a linear compliance is not positive. Parameters as of `log_at`.
        """
        coarse, other = self._coarse.compliance_at(there), self._other.compliance_at(there)
        if not (coarse.min() > 0 and other.min() > 0):
            return np.zeros_like(compliance), np.inf
        log_ratio = np.log(other / coarse)
        return log_ratio, float(np.abs((compliance / coarse - 1) * log_ratio).max())
