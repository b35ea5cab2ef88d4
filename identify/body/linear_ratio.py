"""Compliances of another model over the coarse model's, carried from one map to its neighbours.

A model of another Poisson's ratio, or of the body elsewhere, answers a change of the map almost as
the coarse model does: the logarithm of their ratio is linear in the modulus far beyond either
compliance. So one solution of the other model serves all maps nearby,

    ln(C'/C)(E) = ln(C'_0 + S' dE') - ln(C_0 + S dE) + e,    e about (b' - b),

and with the derivatives by fibres, support and skin the bodies nearby that have them, too. S' and S
are the sensitivities, b' and b the bends: the parts of second order, relative to the
compliance. That of the coarse model is known, as it is solved at each map; the other's differs from
it by about the share by which the compliances differ, so that e is about b ln(C'/C).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from fem.palpation import Response
from identify.body.state import BodyState, ChangedMap, fibres_of, has_skin


class _Linear(NamedTuple):
    """A model's compliances (j,) m/N at a modulus (p,) at points (p, 3), and their derivatives.

    `by_law` (j, q) those by the q numbers of the state's law, `law` (q,), see `law_of`.
    """

    points_m: np.ndarray
    modulus_pa: np.ndarray
    compliance: np.ndarray
    sensitivity: np.ndarray
    law: np.ndarray
    by_law: np.ndarray

    @classmethod
    def of(cls, response: Response, there: ChangedMap) -> _Linear:
        points = response.model.points_m
        modulus = there.modulus(points)
        by_modulus = response.sensitivity.astype(np.float32)  # for small changes
        law, by_law = law_of(there.state), _by_law(response, there.state, modulus)
        return cls(points, modulus, response.compliance, by_modulus, law, by_law)

    def compliance_at(self, there: ChangedMap) -> np.ndarray:
        change = there.modulus(self.points_m) - self.modulus_pa
        by_map = self.sensitivity @ change.astype(np.float32)
        law = law_of(there.state)
        step = np.subtract(
            law, self.law, out=np.zeros_like(law), where=law != self.law
        )  # free base
        return self.compliance + by_map + self.by_law @ step


def law_of(state: BodyState) -> np.ndarray:
    """Numbers (q,) of the fibres, support and skin that a state has, none for a plain body."""
    parts: list[np.ndarray | tuple[float, float]] = []
    if state.fibre_share:
        parts.append(fibres_of(state))
    if any(state.base_m_per_pa):
        parts.append(state.base_m_per_pa)
    if has_skin(state):
        parts.append((state.skin_thickness_m, state.skin_factor))
    return np.concatenate([np.zeros(0), *parts])


def _by_law(response: Response, state: BodyState, modulus: np.ndarray) -> np.ndarray:
    """Return the derivatives (j, q) of the compliances by these numbers."""
    parts = [np.zeros((len(response.compliance), 0))]
    if state.fibre_share:
        parts.append(-response.fibre_moments(modulus))
    if any(state.base_m_per_pa):
        parts.append(response.support_sensitivity)
    if has_skin(state):
        parts.append(response.skin_sensitivity)
    return np.hstack(parts)


@dataclass(frozen=True)
class LinearRatio:
    """The ratio of two models' compliances around the map of one solution of each."""

    _coarse: _Linear
    _other: _Linear

    @classmethod
    def of(cls, coarse: Response, other: Response, there: ChangedMap) -> LinearRatio:
        """Linearise the solutions of both models for a map."""
        return cls(_Linear.of(coarse, there), _Linear.of(other, there))

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
