"""Solvers of the sparse systems: direct, two-grid, mixed precision, by threads over presses."""

from fem.solve.direct import Solver
from fem.solve.threads import available_cores, map_over_workers, solver_for_threads

__all__ = ["Solver", "available_cores", "map_over_workers", "solver_for_threads"]
