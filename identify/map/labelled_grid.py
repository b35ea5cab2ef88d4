"""A grid whose field jumps between labelled regions, and is smooth within each."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy import sparse
from scipy.spatial import KDTree

from identify.map.grid import Grid
from models import LabelVolume


@dataclass(frozen=True, eq=False)
class LabelledGrid(Grid):
    """A grid over a body of regions: a point is interpolated from points of its own region.

    The volume says the region of every point, so that the border between two regions is as sharp as
    the voxels, however coarse the grid is. Each region has a level of its own.

    Attributes
    ----------
    regions : label volume, in the frame of the grid
    """

    regions: LabelVolume

    @cached_property
    def labels(self) -> np.ndarray:
        """Label of each point, (g,)."""
        return self.regions.at(self.points_m)

    def weights(self, points_m: np.ndarray) -> sparse.csr_matrix:
        """Matrix (p, g) that interpolates to points (p, 3) m within their regions."""
        points = np.asarray(points_m, float)
        own = self.regions.at(points)
        plain = super().weights(points).tocoo()
        same = self.labels[plain.col] == own[plain.row]
        values = np.where(same, plain.data, 0.0)
        total = np.bincount(plain.row, values, len(points))
        alone = np.flatnonzero(total < 1e-9)  # no neighbour in the point's region: the nearest is
        kept = same & (total[plain.row] >= 1e-9)
        row, column = plain.row[kept], plain.col[kept]
        values = values[kept] / total[row]
        nearest = self._nearest(points[alone], own[alone])
        entries = (
            np.concatenate([values, np.ones(len(alone))]),
            (np.concatenate([row, alone]), np.concatenate([column, nearest])),
        )
        return sparse.csr_matrix(entries, shape=(len(points), len(self)))

    def _nearest(self, points_m: np.ndarray, labels: np.ndarray) -> np.ndarray:
        """Nearest point (p,) of each point's region; of a region without points, of all."""
        found = np.empty(len(points_m), dtype=int)
        for label in np.unique(labels):
            among = np.flatnonzero(self.labels == label)
            among = among if len(among) else np.arange(len(self))
            rows = labels == label
            found[rows] = among[KDTree(self.points_m[among]).query(points_m[rows])[1]]
        return found

    def level(self, rows: np.ndarray) -> np.ndarray:
        """Sum fields (n, g) over the points of each region, given to each of its points."""
        found = np.empty_like(rows)
        for label in np.unique(self.labels):
            inside = self.labels == label
            found[:, inside] = rows[:, inside].sum(axis=1, keepdims=True)
        return found

    def levels_drawn(self, rng: np.random.Generator, count: int) -> np.ndarray:
        """Return random levels (count, g) of unit variance, one a region."""
        _, region = np.unique(self.labels, return_inverse=True)
        return rng.standard_normal((count, region.max() + 1))[:, region]
