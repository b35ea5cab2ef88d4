"""A map that is known only up to a Gaussian field: its uncertainty in the readings' covariance.

With the prior covariance of the field propagated to s = ln C of the presses, S (j, j), and the
whitened derivative A of the readings by s, the readings about the prior mean of the field have the
covariance I + A S A'. Whitened with its root, a residual and the derivatives by further parameters
are those of a model that has every map of that prior beside it: no map can be taken for an effect.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np


@dataclass(frozen=True, eq=False)
class MapUncertainty:
    """Prior of a free map in the presses' compliances.

    Attributes
    ----------
    of_field : (j, j) covariance of s = ln C by the field
    own : (j,) further variance of each press
    offset : (j,) s at the map less s at the prior mean
    felt : (j,) weight of each press; 0 leaves it out
    prior : numbers of the prior, for a fit that goes on from here
    """

    of_field: np.ndarray
    own: np.ndarray
    offset: np.ndarray
    felt: np.ndarray
    prior: Any = None

    def counted(self, press: np.ndarray) -> int:
        """Return the number of readings, each of a `press` (m,), that are not left out."""
        return int(np.count_nonzero(self.felt[press]))


@dataclass(frozen=True, eq=False)
class MarginalMap:
    """Readings whose map is uncertain.

    Attributes
    ----------
    map : its uncertainty
    columns : (m,) derivative of the readings by s of their press, whitened by the noise
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
    def _length(self) -> np.ndarray:
        square = np.bincount(self.press, self.columns**2, len(self.map.offset))
        return np.sqrt(np.maximum(square, 1e-300))

    @cached_property
    def _unit(self) -> np.ndarray:
        return self.columns / self._length[self.press]

    @cached_property
    def _modes(self) -> tuple[np.ndarray, np.ndarray]:
        """Eigenvalues and vectors of the map's covariance in units of the noise."""
        whole = self.map.of_field + np.diag(self.map.own)
        scaled = self._length[:, None] * whole * self._length
        value, vector = np.linalg.eigh(scaled)
        return np.maximum(value, 0.0), vector

    def about_mean(self, residual: np.ndarray) -> np.ndarray:
        """Return the residual (m,) about the prior mean from that at the map."""
        return residual + self.columns * self.map.offset[self.press]

    def whitened(self, x: np.ndarray) -> np.ndarray:
        """Apply the inverse root of I + A S A' to x (m,) or (m, k)."""
        value, vector = self._modes
        wide = x if x.ndim == 2 else x[:, None]
        gain = vector.T @ self._along(wide)
        gain = vector @ (((1 + value) ** -0.5 - 1)[:, None] * gain)
        return (wide + self._unit[:, None] * gain[self.press]).reshape(x.shape)

    def moved(self, about_mean: np.ndarray) -> np.ndarray:
        """Return the change (j,) of s from here to the most probable map for a residual."""
        return self.map.of_field @ self._weights(about_mean) - self.map.offset

    def probable(self, about_mean: np.ndarray) -> np.ndarray:
        """Return the same with each press's own error, as its readings have it."""
        weights = self._weights(about_mean)
        return self.map.of_field @ weights + self.map.own * weights - self.map.offset

    def _weights(self, about_mean: np.ndarray) -> np.ndarray:
        value, vector = self._modes
        along = vector.T @ self._along(about_mean[:, None])[:, 0]
        return self._length * (vector @ (along / (1 + value)))

    def _along(self, x: np.ndarray) -> np.ndarray:
        moved = self._unit[:, None] * x
        return (
            np.column_stack(
                [np.bincount(self.press, column, len(self.map.offset)) for column in moved.T]
            )
            if x.shape[1]
            else np.zeros((len(self.map.offset), 0))
        )
