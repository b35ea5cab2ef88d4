"""The free map: its field under a prior, posterior, evidence, and the spots in it."""
