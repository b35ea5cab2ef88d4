"""Contact of a tip with the surface: pressures, curvature, half-space, unilateral contact."""

from fem.contact.contacts import PressedSurface, contact_weights
from fem.contact.half_space import half_space_matrix, patch_grid
from fem.contact.paraboloid import surface_curvature

__all__ = [
    "PressedSurface",
    "contact_weights",
    "half_space_matrix",
    "patch_grid",
    "surface_curvature",
]
