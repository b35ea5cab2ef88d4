"""Optimisers: Gauss-Newton, BFGS, line search, and their common result."""
