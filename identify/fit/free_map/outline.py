"""Outline of the presses, seen from above: what lies beyond it is felt from one side alone."""

from __future__ import annotations

import numpy as np
from scipy.spatial import ConvexHull, QhullError


def beyond_presses(points_m: np.ndarray, pressed_m: np.ndarray, across: np.ndarray) -> np.ndarray:
    """Distance (n,) m of points beyond the outline of the presses; less than 0 within it.

    Infinite where the presses stand in one line, or are fewer than three.

    Parameters
    ----------
    points_m : (n, 3)
    pressed_m : (j, 3) contact points
    across : (2, 3) directions along the surface

    Examples
    --------
    >>> square = np.array([[0, 0, 0], [2, 0, 0], [2, 2, 0], [0, 2, 0.1]])
    >>> beyond_presses(np.array([[1, 1, 5], [2, 1, 0], [4, 1, 0]]), square, np.eye(3)[:2]).tolist()
    [-1.0, 0.0, 2.0]
    """
    axes = (across / np.linalg.norm(across, axis=1, keepdims=True)).T
    try:
        hull = ConvexHull(pressed_m @ axes)
    except QhullError:
        return np.full(len(points_m), np.inf)
    return (points_m @ axes @ hull.equations[:, :2].T + hull.equations[:, 2]).max(axis=1)
