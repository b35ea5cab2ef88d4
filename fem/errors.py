"""Errors of the finite element part; each names the fault and its cure."""

import numpy as np


class MeshError(ValueError):
    """A mesh or surface that cannot be computed with."""


class FoldedSurfaceError(MeshError):
    """Contact points that lie nearly one above the other, two of them (2, 3) in `points_m`."""

    def __init__(self, message: str, points_m: np.ndarray) -> None:
        super().__init__(message)
        self.points_m = points_m


class SolverError(ValueError):
    """A linear system that cannot be solved (not positive definite, not finite)."""
