r"""Frictionless unilateral contact of a rigid tip with an elastic surface, by an active set.

The surface near the tip is a grid of square patches, each with a uniform pressure. With S_ij the
displacement of patch i under a unit force on patch j (m/N), p_j the forces, d the travel of the tip
and f_i the height of its face above its lowest point,

    S p - (d - f) >= 0,    p >= 0,    p' (S p - d + f) = 0:

no patch is pulled, none lies inside the tip. S is symmetric and positive definite, so that the
solution is unique; patches that pull leave the contact, patches that lie inside enter it, until
none does either (Hintermueller, Ito & Kunisch, SIAM J. Optim. 13, 2003).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg import cho_factor, cho_solve

from fem.errors import SolverError

_ROUNDS = 100


class PressedTip(NamedTuple):
    """Equilibrium of a tip.

    Attributes
    ----------
    force_n, travel_m : of the tip
    forces_n : (i,) on each patch
    """

    force_n: float
    travel_m: float
    forces_n: np.ndarray


def sphere_gap(centres: np.ndarray, radius_m: float) -> np.ndarray:
    """Height f of a rigid sphere's face above its lowest point, (i,) m; inf beside the sphere."""
    square = (centres**2).sum(axis=1)
    root = np.sqrt(np.maximum(radius_m**2 - square, 0))
    return np.where(square < radius_m**2, radius_m - root, np.inf)


def press_by(matrix: np.ndarray, gap_m: np.ndarray, travel_m: float) -> PressedTip:
    """Push a tip in by a given travel.

    Parameters
    ----------
    matrix : (i, i) S, m/N
    gap_m : (i,) f, m; inf where the tip has no face
    travel_m : d, m, not negative

    Raises
    ------
    SolverError
        No end of patches that enter and leave: the matrix is not that of an elastic surface.
    """
    sunk = travel_m - np.asarray(gap_m, float)
    scale = float(np.trace(matrix)) / len(matrix)
    forces = np.zeros(len(sunk))
    active = sunk > 0
    for _ in range(_ROUNDS):
        index = np.flatnonzero(active)
        forces[:] = 0
        if len(index):
            block = cho_factor(matrix[np.ix_(index, index)])
            forces[index] = cho_solve(block, sunk[index])
        inside = sunk - matrix @ forces
        inside[index] = 0
        wanted = forces * scale + inside > 0
        if (wanted == active).all():
            return PressedTip(float(forces.sum()), travel_m, forces)
        active = wanted
    raise SolverError(f"the contact did not settle in {_ROUNDS} rounds; is the matrix symmetric?")


def press_with(matrix: np.ndarray, gap_m: np.ndarray, force_n: float) -> PressedTip:
    """Push a tip in by a given force (secant steps on `press_by`).

    The force rises with the travel, and its slope does too, so that the steps converge from any
    start.
    """
    travel = force_n * float(np.trace(matrix)) / len(matrix) / 10
    low, high = 0.0, np.inf
    for _ in range(_ROUNDS):
        found = press_by(matrix, gap_m, travel)
        if abs(found.force_n - force_n) <= 1e-10 * force_n:
            return found
        if found.force_n < force_n:
            low = max(low, travel)
        else:
            high = min(high, travel)
        index = np.flatnonzero(found.forces_n > 0)
        step = np.inf
        if len(index):
            block = cho_factor(matrix[np.ix_(index, index)])
            slope = float(cho_solve(block, np.ones(len(index))).sum())
            step = travel + (force_n - found.force_n) / slope
        if not low < step < high:
            step = 2 * travel if np.isinf(high) else (low + high) / 2
        travel = step
    raise SolverError(f"no travel found for {force_n:.3g} N; reached {found.force_n:.6g} N")
