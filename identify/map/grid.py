"""A regular grid of points in the box around a body, with trilinear interpolation between them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import product

import numpy as np
from scipy import sparse


@dataclass(frozen=True)
class Grid:
    """Points of a regular grid, g in all; the last axis runs fastest.

    Attributes
    ----------
    lower_m : (3,) first point
    spacing_m : (3,) between neighbours
    counts : (3,) points along each axis, at least two
    """

    lower_m: tuple[float, float, float]
    spacing_m: tuple[float, float, float]
    counts: tuple[int, int, int]

    @classmethod
    def over(cls, box_m: np.ndarray, spacing_m: float) -> Grid:
        """Return the grid over a box (2, 3) m with about that spacing.

        >>> Grid.over(np.array([[0, 0, 0], [0.04, 0.02, 0.01]]), 0.01).counts
        (5, 3, 2)
        """
        low, high = np.asarray(box_m, float)
        counts = np.maximum(np.rint((high - low) / spacing_m).astype(int), 1) + 1
        nx, ny, nz = counts.tolist()
        x, y, z = low.tolist()
        hx, hy, hz = ((high - low) / (counts - 1)).tolist()
        return cls((x, y, z), (hx, hy, hz), (nx, ny, nz))

    def __len__(self) -> int:
        nx, ny, nz = self.counts
        return nx * ny * nz

    @cached_property
    def points_m(self) -> np.ndarray:
        """The points, (g, 3) m."""
        axes = (
            low + step * np.arange(count)
            for low, step, count in zip(self.lower_m, self.spacing_m, self.counts, strict=True)
        )
        return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)

    @property
    def cell_m3(self) -> float:
        """Volume of a cell, m^3."""
        return float(np.prod(self.spacing_m))

    def interpolated(self, field: np.ndarray, points_m: np.ndarray) -> np.ndarray:
        """Interpolate a field (g,) to points (p, 3) m, (p,)."""
        return np.asarray(self.weights(points_m) @ field)

    def level(self, rows: np.ndarray) -> np.ndarray:
        """Sum fields (n, g) over all points, given to each point."""
        return np.broadcast_to(rows.sum(axis=1, keepdims=True), rows.shape)

    def levels_drawn(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random levels (count, g) of unit variance, one for all points."""
        return np.broadcast_to(rng.standard_normal((count, 1)), (count, len(self)))

    def weights(self, points_m: np.ndarray) -> sparse.csr_matrix:
        """Matrix (p, g) that interpolates to points (p, 3) m; beyond the grid its edge counts."""
        place = (np.asarray(points_m, float) - self.lower_m) / self.spacing_m
        last = np.array(self.counts) - 1
        place = np.clip(place, 0, last)
        cell = np.minimum(place.astype(int), last - 1)
        share = place - cell
        columns, values = [], []
        for corner in product((0, 1), repeat=3):
            at = cell + corner
            columns.append(np.ravel_multi_index(tuple(at.T), self.counts))
            values.append(np.prod(np.where(corner, share, 1 - share), axis=1))
        p = len(place)
        rows = np.tile(np.arange(p), 8)
        entries = (np.concatenate(values), (rows, np.concatenate(columns)))
        return sparse.csr_matrix(entries, shape=(p, len(self)))
