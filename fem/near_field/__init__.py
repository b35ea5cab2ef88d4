"""Enrichment of the finite elements by the singular field under a tip."""
