"""Solvers of the sparse systems: direct, two-grid, mixed precision, by threads over presses."""
