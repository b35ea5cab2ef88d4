"""A label volume: whole numbers on a grid of voxels, as a segmentation of images leaves them."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import groupby

import numpy as np

_MOST_VOXELS = 128  # along an axis of the part that is kept


@dataclass(frozen=True, eq=False)
class LabelVolume:
    """Labels of voxels; a point has the label of the voxel that it lies in.

    Attributes
    ----------
    labels : (nx, ny, nz) int
    to_index : (3, 4) m to voxel: the centre of voxel (i, j, k) is where that gives (i, j, k)
    """

    labels: np.ndarray
    to_index: np.ndarray

    @classmethod
    def of(cls, labels: np.ndarray, to_place: np.ndarray) -> LabelVolume:
        """Make a volume from the affine (3, 4) that takes voxel (i, j, k) to its centre, m."""
        inverse = np.linalg.inv(np.vstack([to_place, [0, 0, 0, 1]]))
        return cls(np.asarray(labels), inverse[:3])

    @property
    def names(self) -> tuple[int, ...]:
        """The labels that occur, in order."""
        return tuple(np.unique(self.labels).tolist())

    @property
    def edges_m(self) -> np.ndarray:
        """Lengths (3,) of the volume along its own axes, m."""
        voxels = np.linalg.inv(self.to_index[:, :3])
        return np.linalg.norm(voxels, axis=0) * self.labels.shape

    def _voxel(self, points_m: np.ndarray) -> np.ndarray:
        return np.rint(self._index(points_m)).astype(int)

    def _index(self, points_m: np.ndarray) -> np.ndarray:
        return np.asarray(points_m, float) @ self.to_index[:, :3].T + self.to_index[:, 3]

    def covers(self, points_m: np.ndarray) -> np.ndarray:
        """Return whether points (p, 3) m lie in the volume, (p,) bool."""
        index, edge = self._index(points_m), 0.5 + 1e-6  # its outermost faces belong to it
        return np.all((index > -edge) & (index < np.array(self.labels.shape) - 1 + edge), axis=1)

    def at(self, points_m: np.ndarray) -> np.ndarray:
        """Labels (p,) int at points (p, 3) m; beyond the volume those of its edge."""
        voxel = np.clip(self._voxel(points_m), 0, np.array(self.labels.shape) - 1)
        return self.labels[tuple(voxel.T)]

    def moved(self, shift_m: np.ndarray) -> LabelVolume:
        """Return the volume in a frame whose positions are larger by a shift (3,) m."""
        offset = self.to_index[:, 3] - self.to_index[:, :3] @ np.asarray(shift_m, float)
        return LabelVolume(self.labels, np.column_stack([self.to_index[:, :3], offset]))

    def cropped(self, box_m: np.ndarray) -> LabelVolume:
        """Return the part around a box (2, 3) m, of at most 128 voxels along each of its axes."""
        corners = np.array([[box_m[i][0], box_m[j][1], box_m[k][2]]
                            for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip
        voxel = self._voxel(corners)
        last = np.array(self.labels.shape) - 1
        low = np.clip(voxel.min(axis=0) - 1, 0, last)
        high = np.clip(voxel.max(axis=0) + 1, 0, last)
        step = np.maximum(np.ceil((high - low + 1) / _MOST_VOXELS).astype(int), 1)
        i, j, k = (slice(a, b + 1, s) for a, b, s in zip(low, high, step, strict=True))
        rows = (self.to_index - np.column_stack([np.zeros((3, 3)), low])) / step[:, None]
        return LabelVolume(np.ascontiguousarray(self.labels[i, j, k]), rows)

    def to_dict(self) -> dict[str, list]:
        """Return plain data; the labels, the last axis fastest, as pairs of label and run."""
        runs = [[int(label), len(list(same))] for label, same in groupby(self.labels.ravel())]
        shape, rows = list(self.labels.shape), self.to_index.tolist()
        return {"shape": shape, "to_index": rows, "runs": runs}

    @classmethod
    def from_dict(cls, content: dict[str, list]) -> LabelVolume:
        """Return the volume of `to_dict`."""
        labels, counts = np.array(content["runs"]).T
        volume = np.repeat(labels, counts).reshape(content["shape"])
        return cls(volume, np.array(content["to_index"], float))
