from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest

from fem.errors import MeshError
from fem.mesh.block import block_mesh, paper_mesh
from fem.mesh.checks import cell_quality, check_mesh
from fem.mesh.mesh import Mesh

SIZE = (0.09, 0.07, 0.05)


def block(order: int = 1) -> Mesh:
    return block_mesh(SIZE, (3, 2, 2), order=order)


def changed(mesh: Mesh, edit: Callable[[np.ndarray, np.ndarray], object]) -> Mesh:
    nodes, cells = mesh.nodes.copy(), mesh.cells.copy()
    edit(nodes, cells)
    return Mesh(nodes, cells, mesh.surfaces)


def swap(table: np.ndarray, row: int, a: int, b: int) -> None:
    table[row, [a, b]] = table[row, [b, a]]


@pytest.mark.parametrize("split", ["kuhn", "alternating"])
@pytest.mark.parametrize("order", [1, 2])
def test_every_mesh_of_this_package_passes(order, split):
    check_mesh(block_mesh(SIZE, (3, 2, 4), grading=1.5, order=order, split=split))


def test_the_papers_mesh_passes():
    check_mesh(paper_mesh())


def test_a_mesh_far_from_the_origin_and_tiny_passes():
    mesh = block(2)
    check_mesh(Mesh(1e-3 * mesh.nodes + 1e-2, mesh.cells, mesh.surfaces))


def test_quality_is_one_for_the_regular_tetrahedron_and_signed():
    corners = np.array([(1, 1, 1), (1, -1, -1), (-1, 1, -1), (-1, -1, 1)], float)
    quality = cell_quality(Mesh(0.03 * corners, np.array([[0, 1, 2, 3], [0, 2, 1, 3]]), {}))
    np.testing.assert_allclose(np.sort(quality), [-1.0, 1.0], rtol=1e-12)


def test_a_cell_table_with_two_vertices_exchanged_is_inverted():
    for order in (1, 2):
        mesh = changed(block(order), lambda _, cells: swap(cells, 5, 1, 2))
        with pytest.raises(MeshError, match=r"Cell 5 .* inverted: volume -.*1 such"):
            check_mesh(mesh)


def test_a_flat_cell_is_named_with_its_quality():
    nodes = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.3, 0.3, -1e-6)]) * 0.1
    mesh = Mesh(nodes, np.array([[0, 1, 2, 3], [0, 2, 1, 4]]), {})
    with pytest.raises(MeshError, match=r"Cell 1 .* is flat: quality .*e-06"):
        check_mesh(mesh)


def test_non_finite_nodes_and_numbers_out_of_range_are_named():
    mesh = block()
    with pytest.raises(MeshError, match="Node 7 has the coordinates"):
        check_mesh(changed(mesh, lambda nodes, _: nodes[7].__setitem__(1, np.nan)))
    for wrong in (-1, len(mesh.nodes)):
        with pytest.raises(MeshError, match=r"Cell 3 uses the nodes .* go from 0 to 35"):
            check_mesh(changed(mesh, lambda _, c, w=wrong: c[3].__setitem__(2, w)))
        faces = mesh.surfaces["top"].copy()
        faces[2, 0] = wrong
        with pytest.raises(MeshError, match="'top': face 2 uses the nodes"):
            check_mesh(Mesh(mesh.nodes, mesh.cells, {"top": faces}))


def test_an_empty_mesh_is_refused():
    with pytest.raises(MeshError, match="0 cells"):
        check_mesh(Mesh(np.zeros((4, 3)), np.zeros((0, 4), int), {}))


def test_a_cell_that_uses_a_node_twice_is_named():
    mesh = changed(block(), lambda _, cells: cells[4].__setitem__(0, cells[4, 1]))
    with pytest.raises(MeshError, match="Cell 4 uses a node twice"):
        check_mesh(mesh)


def test_a_duplicate_cell_is_named_even_with_its_vertices_in_another_order():
    mesh = block()
    again = mesh.cells[6][[1, 2, 0, 3]]
    with pytest.raises(MeshError, match=r"Cell 6 .* more than once"):
        check_mesh(Mesh(mesh.nodes, np.vstack([mesh.cells, again]), mesh.surfaces))


def test_an_unused_node_is_named():
    mesh = block()
    nodes = np.vstack([mesh.nodes, [(1, 2, 3)]])
    with pytest.raises(MeshError, match=r"Node 36 .* belongs to no cell \(1 such\)"):
        check_mesh(Mesh(nodes, mesh.cells, mesh.surfaces))


def test_two_nodes_in_one_place_are_named():
    mesh = block()
    top = mesh.surfaces["top"][0, 0]
    cells = mesh.cells.copy()
    cells[np.flatnonzero((cells == top).any(axis=1))[0]] = np.where(
        (row := cells[np.flatnonzero((cells == top).any(axis=1))[0]]) == top, 36, row
    )
    nodes = np.vstack([mesh.nodes, mesh.nodes[top] + 1e-10])
    with pytest.raises(MeshError, match=f"Nodes {top} and 36 lie in one place"):
        check_mesh(Mesh(nodes, cells, {}))


def test_mid_edge_nodes_off_the_middle_or_in_another_order_are_named():
    mesh = block(2)
    node = mesh.cells[8, 6]
    with pytest.raises(MeshError, match=rf"Node {node} of cell .* off the middle"):
        check_mesh(changed(mesh, lambda nodes, _: nodes[node].__iadd__(1e-4)))
    gmsh = mesh.cells[:, [0, 1, 2, 3, 4, 5, 6, 7, 9, 8]]  # gmsh exchanges the last two
    with pytest.raises(MeshError, match="VTK's order"):
        check_mesh(Mesh(mesh.nodes, gmsh, {}))


def test_overlapping_cells_are_named():
    nodes = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0.5, 2), (0, 0, -1)]) * 0.1
    same_side = np.array([[0, 1, 2, 3], [0, 1, 2, 4], [0, 2, 1, 5]])
    with pytest.raises(MeshError, match="Cells 0 and 1 overlap"):
        check_mesh(Mesh(nodes, same_side, {}))
    with pytest.raises(MeshError, match="Cells 0 and 1 overlap"):
        check_mesh(Mesh(nodes[:5], same_side[:2], {}))


def test_parts_that_share_only_an_edge_are_refused():
    nodes = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1), (0, -1, 0), (0, 0, -1)]) * 0.1
    hinge = Mesh(nodes, np.array([[0, 1, 2, 3], [0, 1, 4, 5]]), {})
    assert (hinge.cell_volumes > 0).all()
    with pytest.raises(MeshError, match="falls into 2 parts that share no face"):
        check_mesh(hinge)
    mesh = block()
    apart = Mesh(
        np.vstack([mesh.nodes, mesh.nodes + 1]), np.vstack([mesh.cells, mesh.cells + 36]), {}
    )
    with pytest.raises(MeshError, match=r"2 parts .* has 72 of 144 cells"):
        check_mesh(apart)


@pytest.mark.parametrize("order", [1, 2])
def test_surfaces_must_be_outward_boundary_faces_and_unique(order):
    mesh = block(order)
    top = mesh.surfaces["top"]

    def with_top(faces: np.ndarray) -> Mesh:
        return Mesh(mesh.nodes, mesh.cells, {"top": faces})

    rolled = top[:, [1, 2, 0, 4, 5, 3][: top.shape[1]]]
    check_mesh(with_top(rolled))
    flipped = top.copy()
    flipped[4] = flipped[4][[0, 2, 1, 5, 4, 3][: top.shape[1]]]
    with pytest.raises(MeshError, match=r"Face 4 of surface 'top' .* outwards"):
        check_mesh(with_top(flipped))
    with pytest.raises(MeshError, match=r"Face 0 of surface 'top' .* twice"):
        check_mesh(with_top(np.vstack([top, top[:1]])))
    inner = top.copy()
    inner[2, 0] = np.setdiff1d(mesh.cells[:, :4], top)[0]
    with pytest.raises(MeshError, match=r"Face 2 of surface 'top' .* not on the boundary"):
        check_mesh(with_top(inner))
    with pytest.raises(MeshError, match=r"shape \(0,"):
        check_mesh(with_top(top[:0]))
    with pytest.raises(MeshError, match=r"need \(t, "):
        check_mesh(with_top(top[:, :2]))
