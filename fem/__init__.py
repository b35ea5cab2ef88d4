"""Tetrahedral finite elements for palpation."""
