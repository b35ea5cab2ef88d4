"""Meshes: blocks, surfaces from files, tetrahedra, and the checks that they pass."""
