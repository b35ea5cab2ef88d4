"""Quadrature on the tetrahedron: barycentric points and weights that sum to one.

Source of the rules: P. Keast (1986) and N. Walkington (2000), as tabulated in the literature; the
tests integrate all monomials up to the stated degree.
"""

from __future__ import annotations

from itertools import combinations_with_replacement, permutations

import numpy as np


def monomials(degree: int) -> np.ndarray:
    """Barycentric coordinates whose products span the polynomials of a degree, (k, degree)."""
    return np.array(list(combinations_with_replacement(range(4), degree)))


def _orbit(*coordinates: float) -> list[tuple[float, ...]]:
    return sorted(set(permutations(coordinates)))


def _rule(*orbits: tuple[float, list[tuple[float, ...]]]) -> tuple[np.ndarray, np.ndarray]:
    points = np.array([point for _, orbit in orbits for point in orbit])
    weights = np.array([weight for weight, orbit in orbits for _ in orbit])
    points.setflags(write=False)
    weights.setflags(write=False)
    return points, weights


_A2 = (5 - np.sqrt(5)) / 20
_W5 = ((0.31088591926330060980, 0.11268792571801585080),
       (0.09273525031089122640, 0.07349304311636194954))  # fmt: skip

#: degree -> (points (q, 4), weights (q,))
TET_RULES = {
    1: _rule((1.0, [(0.25, 0.25, 0.25, 0.25)])),
    2: _rule((0.25, _orbit(_A2, _A2, _A2, 1 - 3 * _A2))),
    5: _rule(
        *((weight, _orbit(a, a, a, 1 - 3 * a)) for a, weight in _W5),
        (0.04254602077708146644, _orbit(0.04550370412564964949, 0.04550370412564964949,
                                        0.5 - 0.04550370412564964949,
                                        0.5 - 0.04550370412564964949)),
    ),
}  # fmt: skip
