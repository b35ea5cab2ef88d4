"""Errors of the finite element part; each names the fault and its cure."""


class MeshError(ValueError):
    """A mesh or surface that cannot be computed with."""


class SolverError(ValueError):
    """A linear system that cannot be solved (not positive definite, not finite)."""
