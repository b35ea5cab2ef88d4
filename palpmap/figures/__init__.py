"""Figures of a fit and of an explanation (matplotlib)."""
