"""Meshes: blocks, surfaces from files, tetrahedra, and the checks that they pass."""

from fem.mesh.block import lower_base, moved_sides, under_surface, widened_margins
from fem.mesh.contact_surface import ContactSurface, SmoothedSurface
from fem.mesh.mesh import Mesh
from fem.mesh.surface import Surface, read_surface

__all__ = [
    "ContactSurface",
    "Mesh",
    "SmoothedSurface",
    "Surface",
    "lower_base",
    "moved_sides",
    "read_surface",
    "under_surface",
    "widened_margins",
]
