"""Contact of a tip with the surface: pressures, curvature, half-space, unilateral contact."""
