"""Closed forms and reference solutions, for tests and benchmarks only."""
