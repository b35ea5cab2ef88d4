"""Hyperelastic bodies at finite strain: laws, load stepping, tips."""
