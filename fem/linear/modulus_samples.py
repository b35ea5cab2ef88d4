"""Samples of the modulus in the cells around the tips, and its interpolation between them.

Elsewhere a cell's samples are the points of the stiffness matrix's rule. Under a tip the strain
varies so much that the course of the modulus within a cell counts: there it is the quadratic
through ten samples, in the stiffness matrix as in the near field (`fem.near_field.enrichment`).
With a different course in each, the near field's energy, a small difference of large numbers, could
vanish.

Through ten samples of a steep field the quadratic may fall below zero in between. There the cell's
samples s are drawn towards its mean modulus m, s' = m + t (s - m), until it is positive
(`QuadraticModulus`); all computations then use s', derivatives included.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from fem.errors import SolverError
from fem.linear.quadrature import TET_RULES, monomials

# lambda_a lambda_b, a <= b: the ten products that span the quadratics of a cell
PRODUCTS = monomials(2)
# Places between which a quadratic modulus is fitted best: the ten nodes, drawn inwards
CLOSE_SAMPLES = 0.25 + 0.7 * ((PRODUCTS[:, :, None] == np.arange(4)).mean(axis=1) - 0.25)
CLOSE_BASIS = np.linalg.inv(CLOSE_SAMPLES[:, PRODUCTS].prod(axis=2)).T
CLOSE_RULE = TET_RULES[5]  # exact for a quadratic modulus times quadratic strains, and more
_AT_RULE = CLOSE_RULE[0][:, PRODUCTS].prod(axis=2) @ CLOSE_BASIS.T  # (points, samples)
_MEAN = CLOSE_RULE[1] @ _AT_RULE  # (samples,) all positive
_LEAST = 0.05  # of a cell's smallest sample: lower bound of the quadratic at the rule


def checked_modulus(modulus_pa: np.ndarray | float, count: int) -> np.ndarray:
    """Return Young's modulus (p,) at `count` points, Pa, as a read-only copy.

    A copy, for derivatives are often asked for later than the caller reuses the array.
    """
    given = np.array(modulus_pa, float)
    if given.shape not in ((), (1,), (count,)):
        raise SolverError(
            f"Young's modulus must be one number or ({count},), one at each of the model's "
            f"points_m, but is {given.shape}"
        )
    modulus = np.broadcast_to(given, count)
    if not (np.isfinite(modulus).all() and modulus.min() > 0):
        raise SolverError(
            "Young's modulus must be positive and finite everywhere; its smallest value is "
            f"{np.nanmin(modulus):.4g} Pa"
        )
    modulus.setflags(write=False)
    return modulus


def close_points_m(corners: np.ndarray) -> np.ndarray:
    """Places (c s, 3) m of the samples of cells with corners (c, 4, 3)."""
    return np.einsum("qv,cvi->cqi", CLOSE_SAMPLES, corners).reshape(-1, 3)


@dataclass(frozen=True)
class QuadraticModulus:
    """A quadratic modulus through samples (c, s) of some cells, wherever that is positive.

    Attributes
    ----------
    asked : (c, s) Pa
    """

    asked: np.ndarray

    @cached_property
    def values(self) -> np.ndarray:
        """Samples s' (c, s) of the head of this file, Pa; in most cells those asked for."""
        result = self.asked.copy()
        mean, share = self._mean[:, None], self._share[:, None]
        result[self._steep] = mean + share * (self.asked[self._steep] - mean)
        return result

    def by_asked(self, by_value: np.ndarray) -> np.ndarray:
        """Return derivatives by `asked` (..., c, s) from those by `values` (..., c, s)."""
        steep, mean, share = self._steep, self._mean, self._share
        if not len(steep):
            return by_value
        samples, given = self.asked[steep], by_value[..., steep, :]
        low = at_rule(samples)
        by_share = (given * (samples - mean[:, None])).sum(axis=-1) / (mean - low.min(axis=1))
        by_mean = (1 - share) * (given.sum(axis=-1) + by_share)
        towards = share[:, None] * _AT_RULE[low.argmin(axis=1)]
        towards[np.arange(len(steep)), samples.argmin(axis=1)] -= _LEAST
        result = by_value.copy()
        result[..., steep, :] = (
            share[:, None] * given + by_mean[..., None] * _MEAN + by_share[..., None] * towards
        )
        return result

    @property
    def steep(self) -> bool:
        """Whether any cell's samples are not those asked for."""
        return len(self._steep) > 0

    @cached_property
    def _steep(self) -> np.ndarray:
        """Cells (r,) whose quadratic falls too low."""
        return np.flatnonzero(at_rule(self.asked).min(axis=1) < _LEAST * self.asked.min(axis=1))

    @cached_property
    def _mean(self) -> np.ndarray:
        """Mean modulus m (r,) of the steep cells, which they keep."""
        return self.asked[self._steep] @ _MEAN

    @cached_property
    def _share(self) -> np.ndarray:
        """Share t (r,) that brings the lowest value in each steep cell to the least allowed."""
        samples, mean = self.asked[self._steep], self._mean
        return (mean - _LEAST * samples.min(axis=1)) / (mean - at_rule(samples).min(axis=1))


def at_rule(modulus_pa: np.ndarray) -> np.ndarray:
    """Modulus (c, points) at `CLOSE_RULE` for samples (c, s)."""
    return modulus_pa @ _AT_RULE.T


def by_sample(by_point: np.ndarray) -> np.ndarray:
    """Return derivatives by the samples (..., s) from those by the modulus at the rule (..., p)."""
    return by_point @ _AT_RULE
