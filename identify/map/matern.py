"""A Gaussian field on a grid with Matern covariance: a prior for a map of any shape.

    cov(r) = spread^2 (1 + s) exp(-s),    s = sqrt(3) r / length,    smoothness nu = 3/2
    cov(r) = spread^2 exp(-r / length),                              smoothness nu = 1/2

The second bends steeply where a wall asks for it; the first explains one by layers that are not
there. Beside the field stand a level common to all places, or to each labelled region, with a wide
prior of its own; and layers, a field of the height alone: bodies even from side to side are often
layered, and readings that show no change across the surface must not vouch for the depth. Products
with the covariance are convolutions, made exact on a grid padded to twice its size (circulant
embedding, Dietrich and Newsam, SIAM J. Sci. Comput. 18, 1997), so that the (g, g) covariance is
never formed.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from scipy import fft as scipy_fft
from scipy.sparse.linalg import LinearOperator, cg

from identify.map.grid import Grid

fft: Any = scipy_fft  # its stubs describe the dispatch, not the arrays

_BATCH = 8  # fields that are transformed together: more leave the processor's cache
_FAR = {1.5: 5.0, 0.5: 6.5}  # lengths beyond which a correlation does not count (below 0.2 %)

# Of the conjugate gradients that find a field's dual: the cost of a field is right to the square of
# the first, a field that the prior hardly draws has at least the cost that they find
_DUAL_TOL, _DUAL_STEPS = 1e-3, 300


@dataclass(frozen=True)
class MaternField:
    """Prior of a field (g,) on a grid, of mean zero.

    Attributes
    ----------
    grid : of the field
    length_m : distance over which the field changes
    spread : standard deviation of the field about its level
    level_spread : standard deviation of the level
    layer_spread, layer_length_m : of the layers; no spread for none
    untold_spread : standard deviation of further layers, which a map leaves out and its bands
        count; `product` leaves them out, too
    smoothness : nu, 1.5 or 0.5
    """

    grid: Grid
    length_m: float
    spread: float
    level_spread: float = 0.0
    layer_spread: float = 0.0
    layer_length_m: float = 1.0
    smoothness: float = 1.5
    untold_spread: float = 0.0

    def covariance(self, distance_m: np.ndarray) -> np.ndarray:
        """Covariance at distances, without those of level and layers."""
        return self.spread**2 * _correlation(distance_m, self.length_m, self.smoothness)

    @property
    def variance(self) -> float:
        """Variance of a point about the level."""
        return self.spread**2 + self.layer_spread**2 + self.untold_spread**2

    @cached_property
    def _by_height(self) -> np.ndarray:
        """Correlation (nz, nz) of the layers."""
        z = self.grid.spacing_m[2] * np.arange(self.grid.counts[2])
        return _correlation(np.abs(z[:, None] - z), self.layer_length_m, self.smoothness)

    def _layers(self, heights: np.ndarray) -> np.ndarray:
        """Fields (n, g) of values (n, nz) by height."""
        nx, ny, _ = self.grid.counts
        return np.tile(heights, nx * ny)

    @cached_property
    def untold(self) -> np.ndarray:
        """Independent fields (n, g) that the further layers are made of."""
        if self.untold_spread == 0:
            return np.empty((0, len(self.grid)))
        values, vectors = np.linalg.eigh(self._by_height)
        root = self.untold_spread * np.sqrt(np.maximum(values, 0.0))
        return self._layers((vectors * root).T)

    def common(self, rows: np.ndarray) -> np.ndarray:
        """Multiply fields (n, g) with the covariance of level and layers alone."""
        found = self.level_spread**2 * self.grid.level(rows)
        if self.layer_spread == 0:
            return found
        nx, ny, nz = self.grid.counts
        heights = rows.reshape(-1, nx * ny, nz).sum(axis=1) @ self._by_height
        return found + self.layer_spread**2 * self._layers(heights)

    def product(self, rows: np.ndarray) -> np.ndarray:
        """Multiply fields (n, g) with the covariance."""
        found = np.empty_like(rows)
        (sx, sy, sz), spectrum = self._embedded
        nx, ny, nz = self.grid.counts
        # One axis after the other: zeros of the padding are not transformed, nor what is cut away
        for first in range(0, len(rows), _BATCH):
            part = rows[first : first + _BATCH].reshape(-1, nx, ny, nz)
            moved = fft.rfft(part, sz, axis=3)
            moved = fft.fft(moved, sy, axis=2)
            moved = fft.fft(moved, sx, axis=1)
            moved *= spectrum
            moved = fft.ifft(moved, axis=1, overwrite_x=True)[:, :nx]
            moved = fft.ifft(moved, axis=2)[:, :, :ny]
            back = fft.irfft(moved, sz, axis=3)[..., :nz]
            found[first : first + _BATCH] = back.reshape(len(part), -1)
        return found + self.common(rows)

    def dual(self, field: np.ndarray) -> np.ndarray:
        """Return the dual (g,) whose product with the covariance is a field (g,), about."""
        size = len(field)
        covariance = LinearOperator(
            (size, size), lambda dual: self.product(dual.reshape(1, size))[0]
        )
        return cg(covariance, field, rtol=_DUAL_TOL, maxiter=_DUAL_STEPS)[0]

    def draws(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random fields (count, g), with the further layers."""
        size, spectrum = self._wide
        # Rounding and cut tails leave values slightly below zero
        root = np.sqrt(np.maximum(spectrum, 0.0))
        nx, ny, nz = self.grid.counts
        found = np.empty((count, len(self.grid)))
        for i in range(count):
            white = fft.rfftn(rng.standard_normal(size))
            white *= root
            found[i] = fft.irfftn(white, size)[:nx, :ny, :nz].ravel()
        found += self.level_spread * self.grid.levels_drawn(rng, count)
        layers = np.hypot(self.layer_spread, self.untold_spread)
        if layers == 0:
            return found
        heights = rng.multivariate_normal(np.zeros(nz), self._by_height, count, method="eigh")
        return found + layers * self._layers(heights)

    @cached_property
    def _embedded(self) -> tuple[tuple[int, ...], np.ndarray]:
        """Size of the padded grid for products, and the spectrum there."""
        return self._spectrum([2 * n - 1 for n in self.grid.counts])

    @cached_property
    def _wide(self) -> tuple[tuple[int, ...], np.ndarray]:
        """The same for draws: wide enough that no eigenvalue is much below zero."""
        reach = [round(_FAR[self.smoothness] * self.length_m / h) for h in self.grid.spacing_m]
        pairs = zip(self.grid.counts, reach, strict=True)
        return self._spectrum([max(2 * n - 1, n + min(r, 3 * n)) for n, r in pairs])

    def _spectrum(self, least: list[int]) -> tuple[tuple[int, ...], np.ndarray]:
        size = tuple(fft.next_fast_len(n, real=True) for n in least)
        lags = [
            np.minimum(np.arange(n), n - np.arange(n)) * h
            for n, h in zip(size, self.grid.spacing_m, strict=True)
        ]
        x, y, z = np.meshgrid(*lags, indexing="ij", sparse=True)
        kernel = self.covariance(np.sqrt(x**2 + y**2 + z**2))
        return size, fft.rfftn(kernel).real


def _correlation(distance_m: np.ndarray, length_m: float, smoothness: float) -> np.ndarray:
    if smoothness == 0.5:
        return np.exp(-distance_m / length_m)
    s = np.sqrt(3) * distance_m / length_m
    return (1 + s) * np.exp(-s)
