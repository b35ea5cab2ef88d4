"""Meshes: blocks, surfaces from files, tetrahedra, and the checks that they pass."""

from fem.mesh.block import lower_base, moved_sides, under_surface, widened_margins
from fem.mesh.contact_surface import ContactSurface, SmoothedSurface
from fem.mesh.focus import (
    FEWEST_CELLS,
    focused_planes,
    mesh_between,
    planes_over,
    probed_box,
    refined_planes,
)
from fem.mesh.mesh import Mesh
from fem.mesh.surface import Surface, read_surface

__all__ = [
    "FEWEST_CELLS",
    "ContactSurface",
    "Mesh",
    "SmoothedSurface",
    "Surface",
    "focused_planes",
    "lower_base",
    "mesh_between",
    "moved_sides",
    "planes_over",
    "probed_box",
    "read_surface",
    "refined_planes",
    "under_surface",
    "widened_margins",
]
