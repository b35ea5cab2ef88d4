"""Interpolation between models that were built at a few values."""

from __future__ import annotations

import numpy as np


def lagrange_weights(at: float, nodes: np.ndarray) -> np.ndarray:
    """Weights (n,) of the values at distinct nodes (n,) in Lagrange's polynomial.

    >>> lagrange_weights(0.5, np.array([0.0, 1.0, 2.0])).round(3).tolist()
    [0.375, 0.75, -0.125]
    """
    return np.array([np.prod([(at - b) / (a - b) for b in nodes if b != a]) for a in nodes])
