"""The tetrahedral mesh as a frozen record, and its promotion from four to ten nodes a cell."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from types import MappingProxyType

import numpy as np

from fem.errors import MeshError

# Local vertex pairs of the mid-edge nodes 4..9 of a ten-node tetrahedron (VTK's order).
TET_EDGES = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
# Local vertices of the four faces, ordered so that the normal points outwards.
TET_FACES = np.array([(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)])
# Local vertex pairs of the mid-edge nodes 3..5 of a six-node triangle.
TRIANGLE_EDGES = np.array([(0, 1), (1, 2), (0, 2)])


def _frozen(array: np.ndarray, dtype: type) -> np.ndarray:
    array = np.array(array, dtype=dtype, order="C")
    array.setflags(write=False)
    return array


@dataclass(frozen=True)
class Mesh:
    """Nodes, tetrahedra and named parts of the boundary.

    Attributes
    ----------
    nodes : (n, 3) m
    cells : (e, 4) or (e, 10) node numbers; ten: vertices, then mid-edges in `TET_EDGES` order.
    surfaces : name -> (t, 3) or (t, 6) node numbers of boundary faces, normals outwards.
    focused : cells are wider outside the part that presses show, see `fem.mesh.focus`
    """

    nodes: np.ndarray
    cells: np.ndarray
    surfaces: Mapping[str, np.ndarray]
    focused: bool = False

    def __post_init__(self) -> None:
        object.__setattr__(self, "nodes", _frozen(self.nodes, np.float64))
        object.__setattr__(self, "cells", _frozen(self.cells, np.int32))
        surfaces = {name: _frozen(faces, np.int32) for name, faces in self.surfaces.items()}
        object.__setattr__(self, "surfaces", MappingProxyType(surfaces))
        if self.nodes.ndim != 2 or self.nodes.shape[1] != 3:
            raise MeshError(f"mesh nodes have shape {self.nodes.shape}, expected (n, 3)")
        if self.cells.ndim != 2 or self.cells.shape[1] not in (4, 10):
            raise MeshError(f"mesh cells have shape {self.cells.shape}, expected (e, 4) or (e, 10)")

    @property
    def order(self) -> int:
        """Polynomial order of the displacement: 1 (four nodes a cell) or 2 (ten)."""
        return 1 if self.cells.shape[1] == 4 else 2

    @property
    def cell_volumes(self) -> np.ndarray:
        """Signed volume of each (straight-edged) cell, (e,) m^3."""
        v = self.nodes[self.cells[:, :4]]
        return np.einsum("ei,ei->e", np.cross(v[:, 1] - v[:, 0], v[:, 2] - v[:, 0]),
                         v[:, 3] - v[:, 0]) / 6  # fmt: skip

    @property
    def volume(self) -> float:
        """Total volume, m^3."""
        return float(self.cell_volumes.sum())

    @property
    def box_m(self) -> np.ndarray:
        """Least and greatest coordinates of the nodes, (2, 3) m."""
        return np.array([self.nodes.min(axis=0), self.nodes.max(axis=0)])

    @cached_property
    def centres_m(self) -> np.ndarray:
        """Mean of each cell's corners, (e, 3) m."""
        return self.nodes[self.cells[:, :4]].mean(axis=1)

    @cached_property
    def diameters_m(self) -> np.ndarray:
        """Twice the greatest distance of a cell's corner from its centre, (e,) m."""
        away = self.nodes[self.cells[:, :4]] - self.centres_m[:, None]
        return 2 * np.sqrt((away**2).sum(axis=2).max(axis=1))

    def surface(self, name: str) -> np.ndarray:
        """Return the faces of a named surface; a wrong name lists the right ones."""
        if name not in self.surfaces:
            known = ", ".join(sorted(self.surfaces)) or "none"
            raise MeshError(f"mesh has no surface '{name}'; it has: {known}")
        return self.surfaces[name]

    def surface_nodes(self, name: str) -> np.ndarray:
        """Return the sorted node numbers of a named surface."""
        return np.unique(self.surface(name))

    @property
    def boundary(self) -> np.ndarray:
        """All boundary faces, (t, 3|6)."""
        return boundary_faces(self.cells)


def boundary_faces(cells: np.ndarray) -> np.ndarray:
    """Faces (t, 3) or (t, 6) that belong to one of the cells only, normals outwards."""
    faces = cells[:, TET_FACES].reshape(-1, 3)
    _, first, count = np.unique(
        np.sort(faces, axis=1), axis=0, return_index=True, return_counts=True
    )
    index = np.sort(first[count == 1])
    faces = faces[index]
    if cells.shape[1] == 4:
        return faces
    edge_local = {frozenset(pair.tolist()): 4 + k for k, pair in enumerate(TET_EDGES)}
    mid = np.array(
        [[edge_local[frozenset(face[pair].tolist())] for pair in TRIANGLE_EDGES]
         for face in TET_FACES]
    )  # fmt: skip
    cell, local = np.divmod(index, 4)
    return np.hstack([faces, cells[cell[:, None], mid[local]]])


def promote_to_tet10(mesh: Mesh) -> Mesh:
    """Insert a node in the middle of every edge of a four-node mesh.

    Surfaces keep their names; a mesh that has ten nodes a cell is returned unchanged.
    """
    if mesh.order == 2:
        return mesh
    edges = np.sort(mesh.cells[:, TET_EDGES].reshape(-1, 2), axis=1).astype(np.int64)
    n = len(mesh.nodes)
    keys, inverse = np.unique(edges[:, 0] * n + edges[:, 1], return_inverse=True)
    middle = (mesh.nodes[keys // n] + mesh.nodes[keys % n]) / 2
    cells = np.hstack([mesh.cells, n + inverse.reshape(-1, 6)])

    def quadratic(faces: np.ndarray) -> np.ndarray:
        pairs = np.sort(faces[:, TRIANGLE_EDGES].reshape(-1, 2), axis=1).astype(np.int64)
        position = np.searchsorted(keys, pairs[:, 0] * n + pairs[:, 1])
        return np.hstack([faces, n + position.reshape(-1, 3)])

    surfaces = {name: quadratic(faces) for name, faces in mesh.surfaces.items()}
    return Mesh(np.vstack([mesh.nodes, middle]), cells, surfaces, mesh.focused)
