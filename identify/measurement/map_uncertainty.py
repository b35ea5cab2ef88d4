"""A map that is known only up to a Gaussian field: its uncertainty in the readings' covariance.

A field reaches the readings of a press by two numbers: s = ln C, under a homogeneous body of that
compliance, and under a ball, whose contact begins at the surface, by the contrast of the modulus
there against that body's. With the prior covariance of the field propagated to these q numbers of
j presses, S (q j, q j), and the whitened derivative A of the readings by them, the readings about
the prior mean of the field have the covariance I + A S A'. Whitened with its root, a residual and
the derivatives by further parameters are those of a model that has every map of that prior beside
it: no map can be taken for an effect.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class MapUncertainty:
    """Prior of a free map in the presses' compliances, and in their contrasts under a ball.

    Attributes
    ----------
    of_field : (q j, q j) covariance by the field: of s = ln C of all presses, then of the contrasts
    own : (q j,) further variance of each press
    offset : (q j,) these numbers at the map less those at the prior mean
    felt : (j,) weight of each press; 0 leaves it out
    prior : numbers of the prior, for a fit that goes on from here
    """

    of_field: np.ndarray
    own: np.ndarray
    offset: np.ndarray
    felt: np.ndarray
    prior: Any = None

    @classmethod
    def of(
        cls,
        covariance: Callable[[np.ndarray], np.ndarray],
        by_field: np.ndarray,
        own: np.ndarray,
        here: np.ndarray | float,
        felt: np.ndarray,
        prior: Any = None,
    ) -> MapUncertainty:
        """Propagate a prior to the presses' numbers.

        Parameters
        ----------
        covariance : multiplies fields (n, g) with the prior's
        by_field : (q j, g) derivatives of the numbers by the field
        own : (j,) variance of each press's own, of either number
        here : (j,) ln C at the map less that at the prior mean; readings begin without contrasts
        """
        j, numbers = len(felt), len(by_field) // len(felt)
        offset = np.zeros(len(by_field))
        offset[:j] = here
        of_field = covariance(by_field) @ by_field.T
        return cls(of_field, np.tile(own, numbers), offset, felt, prior)

    @property
    def numbers(self) -> int:
        """Numbers of each press, q."""
        return len(self.own) // len(self.felt)

    def counted(self, press: np.ndarray) -> int:
        """Return the number of readings, each of a `press` (m,), that are not left out."""
        return int(np.count_nonzero(self.felt[press]))


@dataclass(frozen=True, eq=False)
class MarginalMap:
    """Readings whose map is uncertain.

    Attributes
    ----------
    map : its uncertainty
    columns : (q, m) derivative of the readings by the numbers of their press, whitened by the noise
    press : (m,)
    """

    map: MapUncertainty
    columns: np.ndarray
    press: np.ndarray

    @property
    def weight(self) -> np.ndarray:
        """Root of each reading's weight, (m,)."""
        return np.sqrt(self.map.felt)[self.press]

    @cached_property
    def _basis(self) -> tuple[np.ndarray, np.ndarray]:
        """Orthonormal columns (q, m) of each press; their products with the columns (q j, q j)."""
        q, j = len(self.columns), len(self.map.felt)
        unit, products = self.columns.copy(), np.zeros((q, j, q, j))
        each = np.arange(j)
        for b in range(q):
            for a in range(b):
                along = np.bincount(self.press, unit[a] * unit[b], j)
                unit[b] -= along[self.press] * unit[a]
                products[a, each, b, each] = along
            length = np.sqrt(np.maximum(np.bincount(self.press, unit[b] ** 2, j), 1e-300))
            unit[b] /= length[self.press]
            products[b, each, b, each] = length
        return unit, products.reshape(q * j, q * j)

    @cached_property
    def _modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues and vectors of the map's covariance in units of the noise."""
        products = self._basis[1]
        whole = self.map.of_field + np.diag(self.map.own)
        value, vector = np.linalg.eigh(products @ whole @ products.T)
        return np.maximum(value, 0.0), vector

    def about_mean(self, residual: np.ndarray) -> np.ndarray:
        """Return the residual (m,) about the prior mean from that at the map."""
        return residual + self.moving(self.map.offset)

    def moving(self, numbers: np.ndarray) -> np.ndarray:
        """Return the change (m,) of the readings by changes (q j,) of the presses' numbers."""
        by_press = numbers.reshape(len(self.columns), -1)
        return np.sum(self.columns * by_press[:, self.press], axis=0)

    def whitened(self, x: np.ndarray) -> np.ndarray:
        """Apply the inverse root of I + A S A' to x (m,) or (m, k)."""
        value, vector = self._modes
        wide = x if x.ndim == 2 else x[:, None]
        gain = vector.T @ self._along(wide)
        gain = vector @ (((1 + value) ** -0.5 - 1)[:, None] * gain)
        white = wide.copy()
        for unit, own in zip(self._basis[0], np.split(gain, len(self.columns)), strict=True):
            white += unit[:, None] * own[self.press]
        return white.reshape(x.shape)

    def moved(self, about_mean: np.ndarray) -> np.ndarray:
        """Return the change (q j,) from here to the most probable map for a residual."""
        return self.map.of_field @ self._weights(about_mean) - self.map.offset

    def probable(self, about_mean: np.ndarray) -> np.ndarray:
        """Return the same with each press's own error, as its readings have it."""
        weights = self._weights(about_mean)
        return self.map.of_field @ weights + self.map.own * weights - self.map.offset

    def _weights(self, about_mean: np.ndarray) -> np.ndarray:
        value, vector = self._modes
        along = vector.T @ self._along(about_mean[:, None])[:, 0]
        return self._basis[1].T @ (vector @ (along / (1 + value)))

    def _along(self, x: np.ndarray) -> np.ndarray:
        j = len(self.map.felt)
        found = np.empty((len(self.columns) * j, x.shape[1]))
        for number, unit in enumerate(self._basis[0]):
            for k, column in enumerate(x.T):
                found[number * j : (number + 1) * j, k] = np.bincount(self.press, unit * column, j)
        return found
