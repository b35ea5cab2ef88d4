"""Meshes: blocks, surfaces from files, tetrahedra, and the checks that they pass."""

from fem.mesh.block import moved_sides
from fem.mesh.mesh import Mesh
from fem.mesh.surface import Surface, read_surface

__all__ = ["Mesh", "Surface", "moved_sides", "read_surface"]
