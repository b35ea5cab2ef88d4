"""Meshes of a rectangular block, the paper's among them."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from itertools import permutations

import numpy as np

from fem.errors import MeshError
from fem.mesh.mesh import TET_EDGES, Mesh, boundary_faces, promote_to_tet10

PAPER_SIZE_M = (0.096, 0.096, 0.048)
PAPER_DIVISIONS = (16, 16, 8)
MARGIN_CELLS = 0.5  # of even cells' number, in a margin where nothing is pressed
MOVED_LAYERS = 2.0  # thickness of the layers along a moved side, over its shift


def block_mesh(
    size_m: Sequence[float],
    divisions: Sequence[int],
    grading: float = 1.0,
    order: int = 2,
    split: str = "kuhn",
    levels_m: Sequence[float] | None = None,
) -> Mesh:
    """Mesh a block of hexahedra cut into tetrahedra.

    Parameters
    ----------
    size_m : extent along x, y, z in m; x and y run over [0, size], z up from the base.
    divisions : number of hexahedra along x, y, z.
    grading : exponent that draws the layers towards the top, z = h (1 - (1 - s)^grading); 1 is
        uniform.
    order : 1 (four nodes a cell) or 2 (ten).
    split : "kuhn", six tetrahedra a hexahedron around its diagonal, or "alternating", five a
        hexahedron and mirrored from one to the next (no preferred direction).
    levels_m : heights of the planes between layers of hexahedra, rising from 0 to the block's, m,
        in place of `divisions[2]` and `grading`.

    Returns
    -------
    Mesh with surfaces "top", "base", "sides", and of the sides "x0", "x1", "y0", "y1", where x or y
    is 0 or greatest.
    """
    size = np.asarray(size_m, float)
    counts = np.asarray(divisions)
    if size.shape != (3,) or not (np.isfinite(size).all() and (size > 0).all()):
        raise MeshError(f"block size must be three positive lengths in m, got {size_m}")
    if counts.shape != (3,) or counts.dtype.kind not in "iu" or (counts < 1).any():
        raise MeshError(f"block divisions must be three positive whole numbers, got {divisions}")
    if not grading > 0 or order not in (1, 2) or split not in _SPLITS:
        raise MeshError(
            f"block mesh needs grading > 0, order 1 or 2 and split in {sorted(_SPLITS)}, "
            f"got {grading}, {order}, '{split}'"
        )
    if levels_m is not None:
        levels = np.asarray(levels_m, float)
        if levels.ndim != 1 or levels.size < 2 or not (np.diff(levels) > 0).all() or (
            levels[0] != 0 or levels[-1] != size[2]
        ):  # fmt: skip
            raise MeshError(f"levels must rise from 0 to {size[2]} m, got {levels_m}")
        counts = np.array([counts[0], counts[1], levels.size - 1])
    nx, ny, nz = (int(c) for c in counts)
    axes = [np.linspace(0, 1, c + 1) for c in (nx, ny, nz)]
    axes[2] = 1 - (1 - axes[2]) ** grading if levels_m is None else levels / levels[-1]
    grid = np.meshgrid(*axes, indexing="ij")
    nodes = np.stack([g.ravel() for g in grid], axis=1) * size
    number = np.arange(len(nodes)).reshape(nx + 1, ny + 1, nz + 1)
    # corner[c] with c = 4 i + 2 j + k: node at (x+i, y+j, z+k) of each hexahedron
    corner = np.stack([number[i : nx + i, j : ny + j, k : nz + k].ravel()
                       for i in (0, 1) for j in (0, 1) for k in (0, 1)], axis=1)  # fmt: skip
    parity = np.indices((nx, ny, nz)).sum(axis=0).ravel() % 2
    cells = _SPLITS[split](corner, parity)
    faces = boundary_faces(cells)
    z = nodes[faces, 2]
    top, base = (z == size[2]).all(axis=1), (z == 0).all(axis=1)
    surfaces = {"top": faces[top], "base": faces[base], "sides": faces[~(top | base)]}
    for axis, letter in enumerate("xy"):
        for end, value in enumerate((0.0, size[axis])):
            surfaces[f"{letter}{end}"] = faces[(nodes[faces, axis] == value).all(axis=1)]
    mesh = Mesh(nodes, cells, surfaces)
    return promote_to_tet10(mesh) if order == 2 else mesh


def under_surface(
    mesh: Mesh, corner_m: Sequence[float], heights: Callable[[np.ndarray], np.ndarray]
) -> Mesh:
    """Return a block with its top moved onto a surface, and the nodes below in proportion.

    Parameters
    ----------
    corner_m : (3,) place of the block's lower corner, z that of the base
    heights : of the surface, (p,) m at places (p, 2) m
    """
    nodes = mesh.nodes[: mesh.cells[:, :4].max() + 1] + corner_m  # vertices come first
    share = mesh.nodes[: len(nodes), 2] / mesh.box_m[1, 2]
    nodes[:, 2] = corner_m[2] + share * (heights(nodes[:, :2]) - corner_m[2])
    every = np.empty_like(mesh.nodes)
    every[: len(nodes)] = nodes
    if mesh.order == 2:
        every[mesh.cells[:, 4:]] = nodes[mesh.cells[:, TET_EDGES]].mean(axis=2)
    return replace(mesh, nodes=every)


def widened_margins(mesh: Mesh, divisions: Sequence[int], margin_m: float) -> Mesh:
    """Return a block of even cells with those of its margins drawn out, to half as many.

    Parameters
    ----------
    divisions : number of cells along x and y
    margin_m : width of the margins along all four sides
    """
    nodes = mesh.nodes.copy()
    for axis, (count, edge) in enumerate(zip(divisions, mesh.box_m[1, :2].tolist(), strict=True)):
        outer = math.ceil(MARGIN_CELLS * count * margin_m / edge)
        if 2 * outer < count and 0 < 2 * margin_m < edge:
            share = [0, outer / count, 1 - outer / count, 1]
            places = [0, margin_m, edge - margin_m, edge]
            nodes[:, axis] = np.interp(nodes[:, axis] / edge, share, places)
    return replace(mesh, nodes=nodes)


def moved_sides(mesh: Mesh, shift_m: tuple[float, float]) -> Mesh:
    """Return the mesh with its sides moved along x and y, m, and its middle left where it is.

    Cells are stretched along one side and pressed together along the other, in as many layers as
    are twice as thick as the shift; all others stay, with the near fields of presses on them.
    """
    nodes = mesh.nodes.copy()
    low, high = mesh.box_m
    layer = np.cbrt(6 * mesh.cell_volumes.mean())
    for axis, shift in enumerate(shift_m):
        layers = np.ceil(MOVED_LAYERS * abs(shift) / layer - 1e-9)
        thick = min(layer * max(layers, 1.0), (high[axis] - low[axis]) / 2)
        from_side = np.minimum(nodes[:, axis] - low[axis], high[axis] - nodes[:, axis])
        nodes[:, axis] += shift * np.clip(1 - from_side / thick, 0.0, 1.0)
    if mesh.order == 2:  # an edge across the border of the layers is bent there
        nodes[mesh.cells[:, 4:]] = nodes[mesh.cells[:, TET_EDGES]].mean(axis=2)
    return replace(mesh, nodes=nodes)


def lower_base(mesh: Mesh, by_m: float) -> Mesh:
    """Return a block's mesh, bent or not, with a lower base: stretched in its lower half alone."""
    nodes = mesh.nodes.copy()
    base = nodes[:, 2].min()
    half = (nodes[mesh.surface_nodes("top"), 2].min() - base) / 2
    sinks = by_m * np.clip(1 - (nodes[:, 2] - base) / half, 0.0, 1.0)
    if mesh.order == 2:  # edges stay straight
        sinks[mesh.cells[:, 4:]] = sinks[mesh.cells[:, TET_EDGES]].mean(axis=2)
    nodes[:, 2] -= sinks
    return replace(mesh, nodes=nodes)


def paper_mesh() -> Mesh:
    """Return the paper's body: 2,601 nodes, 12,288 four-node tetrahedra (Sec. III.B.1)."""
    return block_mesh(PAPER_SIZE_M, PAPER_DIVISIONS, order=1)


def _kuhn(corner: np.ndarray, parity: np.ndarray) -> np.ndarray:
    del parity
    weight = np.array([4, 2, 1])
    tets = []
    for axes in permutations(range(3)):
        path = np.concatenate([[0], np.cumsum(weight[list(axes)])])
        even = np.linalg.det(np.eye(3)[list(axes)]) > 0
        tets.append(path if even else path[[0, 2, 1, 3]])
    return corner[:, np.array(tets)].reshape(-1, 4)


def _alternating(corner: np.ndarray, parity: np.ndarray) -> np.ndarray:
    even = np.array([(0, 4, 2, 1), (6, 2, 4, 7), (5, 4, 1, 7), (3, 1, 2, 7), (4, 2, 1, 7)])
    odd = np.array([(4, 5, 6, 0), (2, 3, 0, 6), (1, 0, 3, 5), (7, 6, 5, 3), (0, 3, 5, 6)])
    cells = np.where((parity == 0)[:, None, None], corner[:, even], corner[:, odd])
    return cells.reshape(-1, 4)


_SPLITS = {"kuhn": _kuhn, "alternating": _alternating}
