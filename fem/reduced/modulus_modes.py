"""Modulus fields of a region in few modes, from few of their samples.

The fields of a training set E_i (p,) are spanned by their leading modes (proper orthogonal
decomposition), E = sum_q c_q phi_q. The coefficients follow from the field at few points by least
squares: empirical interpolation with twice as many points as modes. The points are those that a QR
factorisation with column pivoting of the modes picks.

Sources: Barrault, Maday, Nguyen, Patera, C. R. Acad. Sci. Paris I 339 (2004) 667 (empirical
interpolation); Drmac, Gugercin, SIAM J. Sci. Comput. 38 (2016) A631 (points by pivoted QR).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import qr


class ModulusModes(NamedTuple):
    """Modes of a set of modulus fields and the points that tell their coefficients.

    Attributes
    ----------
    modes : (p, q) phi_q at all modulus samples
    points : (r,) indices of the samples that are asked for
    by_point : (q, r) coefficients from the modulus at these points
    """

    modes: np.ndarray
    points: np.ndarray
    by_point: np.ndarray

    @classmethod
    def of(
        cls, fields: np.ndarray, weight: np.ndarray, usable: np.ndarray, tolerance: float
    ) -> ModulusModes:
        """Return the modes of a training set.

        Parameters
        ----------
        fields : (n, p) Pa
        weight : (p,) positive, of each sample's error squared
        usable : (u,) indices of the samples that may become points
        tolerance : modes go on until the rest of the fields is this part of them (weighted rms)
        """
        root = np.sqrt(weight)
        scaled = fields * root
        square, vectors = np.linalg.eigh(scaled @ scaled.T)
        square, vectors = square[::-1], vectors[:, ::-1]
        rest = np.append(np.cumsum(np.maximum(square, 0)[::-1])[::-1], 0.0)
        count = max(1, int(np.argmax(rest <= tolerance**2 * rest[0])))
        modes = (scaled.T @ vectors[:, :count]) / np.sqrt(square[:count]) / root[:, None]
        points = np.zeros(0, int)
        for _ in range(2):
            left = np.setdiff1d(usable, points)
            weighted = (modes * root[:, None])[left].T
            *_, order = qr(weighted, mode="r", pivoting=True)
            points = np.concatenate([points, left[order[:count]]])
        return cls(modes, points, np.linalg.pinv(modes[points]))
