"""Checks of a tetrahedral mesh on its way in; each failure names the cell or node and the cure."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.sparse.csgraph import connected_components
from scipy.spatial import KDTree

from fem.errors import MeshError
from fem.mesh.mesh import TET_EDGES, TET_FACES, Mesh

# 6 sqrt(2) volume / (rms edge)^3: 1 for the regular tetrahedron, 0 for a flat one
FLAT_QUALITY = 1e-4
# a mid-edge node may lie this part of its edge away from the middle
MIDDLE_TOLERANCE = 1e-6
# nodes closer than this part of the shortest edge are one
SAME_NODE = 1e-6


def check_mesh(mesh: Mesh) -> None:
    """Raise `MeshError` unless the mesh can be computed with.

    Looked for, in this order: no or non-finite nodes, node numbers out of range, cells that use a
    node twice, inverted or flat cells, duplicate cells, unused nodes, two nodes in one place,
    mid-edge nodes off the middle of their edge, cells that overlap at a face (without such, the
    boundary is closed), parts that share no face (an edge alone is a hinge: the stiffness matrix
    is singular), named surfaces with faces that are not on the boundary, twice there or turned.
    """
    _check_numbers(mesh)
    _check_shapes(mesh)
    _check_nodes(mesh)
    if mesh.order == 2:
        _check_mid_edge_nodes(mesh)
    _check_faces(mesh)
    boundary = mesh.boundary
    for name in mesh.surfaces:
        _check_surface(mesh, name, boundary)


def check_nodes(mesh: Mesh) -> None:
    """Do the quick part of `check_mesh`: finite nodes, each of which belongs to a cell."""
    _check_numbers(mesh)
    _check_used(mesh)


def cell_quality(mesh: Mesh) -> NDArray[np.float64]:
    """6 sqrt(2) V / (rms edge length)^3 of each cell, (e,): 1 regular, 0 flat, < 0 inverted."""
    ends = mesh.nodes[mesh.cells[:, TET_EDGES]]  # (e, 6, 2, 3)
    square = np.sum((ends[:, :, 1] - ends[:, :, 0]) ** 2, axis=2).mean(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        quality = 6 * np.sqrt(2.0) * mesh.cell_volumes / square**1.5
    return np.where(square > 0, quality, 0.0)


def _check_numbers(mesh: Mesh) -> None:
    if len(mesh.cells) == 0 or len(mesh.nodes) == 0:
        raise MeshError(
            f"The mesh has {len(mesh.nodes)} nodes and {len(mesh.cells)} cells; give it some."
        )
    bad = np.flatnonzero(~np.isfinite(mesh.nodes).all(axis=1))
    if bad.size:
        raise MeshError(
            f"Node {bad[0]} has the coordinates {mesh.nodes[bad[0]]} ({bad.size} such): all must "
            "be finite numbers in m; export the mesh again."
        )
    for what, table in [("Cell", mesh.cells), *((f"Surface '{k}': face", v) for k, v in
                                                mesh.surfaces.items())]:  # fmt: skip
        wrong = np.flatnonzero(((table < 0) | (table >= len(mesh.nodes))).any(axis=1))
        if wrong.size:
            raise MeshError(
                f"{what} {wrong[0]} uses the nodes {table[wrong[0]]}, but they go from 0 to "
                f"{len(mesh.nodes) - 1}; number them from 0 in the order of the node table."
            )


def _check_shapes(mesh: Mesh) -> None:
    ordered = np.sort(mesh.cells, axis=1)
    twice = np.flatnonzero((np.diff(ordered, axis=1) == 0).any(axis=1))
    if twice.size:
        raise MeshError(
            f"Cell {twice[0]} uses a node twice: {mesh.cells[twice[0]]}; remove such cells "
            f"({twice.size})."
        )
    quality = cell_quality(mesh)
    inverted = np.flatnonzero(quality < -FLAT_QUALITY)
    if inverted.size:
        worst = inverted[0]
        raise MeshError(
            f"Cell {worst} (nodes {mesh.cells[worst, :4]}) is inverted: volume "
            f"{mesh.cell_volumes[worst]:.3g} m^3 ({inverted.size} such of {len(mesh.cells)}); "
            "order its vertices so that the fourth lies where (1-0) x (2-0) points."
        )
    flat = np.flatnonzero(quality < FLAT_QUALITY)
    if flat.size:
        worst = flat[quality[flat].argmin()]
        raise MeshError(
            f"Cell {worst} (nodes {mesh.cells[worst, :4]}) is flat: quality {quality[worst]:.1e} "
            f"where a regular one has 1 ({flat.size} such of {len(mesh.cells)}); remesh the body."
        )
    _, first, count = np.unique(
        np.sort(mesh.cells[:, :4], axis=1), axis=0, return_index=True, return_counts=True
    )
    if (count > 1).any():
        cell = first[count > 1].min()
        raise MeshError(
            f"Cell {cell} (nodes {mesh.cells[cell]}) is there more than once "
            f"({(count > 1).sum()} such); remove the copies."
        )


def _check_used(mesh: Mesh) -> None:
    unused = np.flatnonzero(np.bincount(mesh.cells.ravel(), minlength=len(mesh.nodes)) == 0)
    if unused.size:
        raise MeshError(
            f"Node {unused[0]} at {mesh.nodes[unused[0]]} belongs to no cell ({unused.size} such); "
            "remove unused nodes, as they make the stiffness matrix singular."
        )


def _check_nodes(mesh: Mesh) -> None:
    _check_used(mesh)
    ends = mesh.nodes[mesh.cells[:, TET_EDGES]]
    shortest = float(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).min())
    pairs = KDTree(mesh.nodes).query_pairs(SAME_NODE * shortest, output_type="ndarray")
    if len(pairs):
        one, other = sorted(pairs[0].tolist())
        raise MeshError(
            f"Nodes {one} and {other} lie in one place, {mesh.nodes[one]} ({len(pairs)} such "
            "pairs): the body has a cut there; merge duplicate nodes."
        )


def _check_mid_edge_nodes(mesh: Mesh) -> None:
    ends = mesh.nodes[mesh.cells[:, TET_EDGES]]
    length = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    offset = np.linalg.norm(mesh.nodes[mesh.cells[:, 4:]] - ends.mean(axis=2), axis=2) / length
    if offset.max() > MIDDLE_TOLERANCE:
        cell, edge = np.unravel_index(int(offset.argmax()), offset.shape)
        raise MeshError(
            f"Node {mesh.cells[cell, 4 + edge]} of cell {cell} lies {offset.max():.2g} edge "
            f"lengths off the middle of vertices {mesh.cells[cell, TET_EDGES[edge]]}: the six "
            "mid-edge nodes must follow VTK's order (01)(12)(02)(03)(13)(23), and curved edges "
            "are not supported; export four-node cells and let promote_to_tet10 insert them."
        )


def _check_faces(mesh: Mesh) -> None:
    """Each face belongs to one cell, or to two on its two sides; over faces, all cells connect."""
    faces = mesh.cells[:, TET_FACES].reshape(-1, 3)
    keys = _face_keys(faces, len(mesh.nodes))
    order = np.argsort(keys, kind="stable")
    again = np.flatnonzero(keys[order[1:]] == keys[order[:-1]])
    one, other = order[again], order[again + 1]  # faces of neighbouring cells
    crowded = one[1:] == other[:-1]  # a third cell at the same face
    same_side = (_rolled(faces[one]) == _rolled(faces[other])).all(axis=1)
    wrong = np.append(crowded, False) | same_side
    if wrong.any():
        face, second = one[wrong][0], other[wrong][0]
        raise MeshError(
            f"Cells {face // 4} and {second // 4} overlap at their face of nodes {faces[face]} "
            f"({wrong.sum()} such); remesh the body."
        )
    links = sp.coo_array(
        (np.ones(one.size, np.int8), (one // 4, other // 4)), shape=2 * (len(mesh.cells),)
    )
    part = connected_components(links, directed=False)[1]
    _, first, count = np.unique(part, return_index=True, return_counts=True)
    if count.size > 1:
        small = count.argmin()
        raise MeshError(
            f"The mesh falls into {count.size} parts that share no face; the smallest has "
            f"{count[small]} of {len(mesh.cells)} cells (one is cell {first[small]}): keep one "
            "part, or merge the nodes of the interface."
        )


def _check_surface(mesh: Mesh, name: str, boundary: NDArray[np.int32]) -> None:
    faces = mesh.surfaces[name]
    width = boundary.shape[1]
    if faces.ndim != 2 or faces.shape[1] != width or len(faces) == 0:
        raise MeshError(
            f"Surface '{name}' has the shape {faces.shape}; cells of {mesh.cells.shape[1]} nodes "
            f"need (t, {width}) with t >= 1."
        )
    keys, outer = _face_keys(faces, len(mesh.nodes)), _face_keys(boundary, len(mesh.nodes))
    order = np.argsort(outer)
    match = order[np.searchsorted(outer, keys, sorter=order).clip(max=len(outer) - 1)]
    inside = np.flatnonzero(outer[match] != keys)
    if inside.size:
        raise MeshError(
            f"Face {inside[0]} of surface '{name}' (nodes {faces[inside[0]]}) is not on the "
            f"boundary ({inside.size} such): no cell has it, or two share it; take faces from "
            "mesh.boundary."
        )
    _, first, count = np.unique(keys, return_index=True, return_counts=True)
    if (count > 1).any():
        row = first[count > 1].min()
        raise MeshError(f"Face {row} of surface '{name}' (nodes {faces[row]}) is there twice.")
    turned = np.flatnonzero((_rolled(faces) != _rolled(boundary[match])).any(axis=1))
    if turned.size:
        row = turned[0]
        raise MeshError(
            f"Face {row} of surface '{name}' has the nodes {faces[row]}, but outwards and in order "
            f"they are {boundary[match[row]]} ({turned.size} such); take faces from mesh.boundary."
        )


def _face_keys(faces: NDArray[np.int32], nodes: int) -> NDArray[np.int64]:
    """One number for the set of each face's vertices (nodes below 2e6)."""
    a, b, c = np.sort(faces[:, :3], axis=1).astype(np.int64).T
    return (a * nodes + b) * nodes + c


def _rolled(faces: NDArray[np.int32]) -> NDArray[np.int32]:
    """Each face begun at its lowest vertex, orientation kept; mid-edge nodes follow."""
    turn = (faces[:, :3].argmin(axis=1)[:, None] + np.arange(3)) % 3
    order = turn if faces.shape[1] == 3 else np.hstack([turn, 3 + turn])
    return np.take_along_axis(faces, order, axis=1)
