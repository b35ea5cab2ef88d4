"""Quaternions of a pose."""

from __future__ import annotations

import numpy as np


def matrices(quaternion: np.ndarray) -> np.ndarray:
    """Return rotation matrices (m, 3, 3) of quaternions (m, 4) in the order w, x, y, z.

    >>> matrices(np.array([[2.0, 0.0, 0.0, 0.0]]))[0].tolist()
    [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    """
    w, x, y, z = (quaternion / np.linalg.norm(quaternion, axis=1, keepdims=True)).T
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
        [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
        [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def continuous(quaternion: np.ndarray) -> np.ndarray:
    """Return the quaternions (m, 4) with signs chosen so that neighbours lie on one side."""
    signs = np.where(np.einsum("mi,mi->m", quaternion[1:], quaternion[:-1]) < 0, -1.0, 1.0)
    return quaternion * np.concatenate([[1.0], np.cumprod(signs)])[:, None]
