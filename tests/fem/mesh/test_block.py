from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from fem.errors import MeshError
from fem.mesh.block import PAPER_SIZE_M, block_mesh, paper_mesh, widened_margins
from fem.mesh.mesh import TET_EDGES, TET_FACES, TRIANGLE_EDGES, Mesh, promote_to_tet10

SIZE = (0.09, 0.07, 0.05)

every_block = pytest.mark.parametrize(
    "mesh",
    [
        block_mesh(SIZE, (3, 2, 4), grading, order, split)
        for grading in (1.0, 1.7)
        for order in (1, 2)
        for split in ("kuhn", "alternating")
    ],
    ids=lambda m: f"{len(m.cells)}x{m.cells.shape[1]}",
)


def area_vectors(mesh: Mesh, faces: np.ndarray) -> np.ndarray:
    a, b, c = mesh.nodes[faces[:, :3]].transpose(1, 0, 2)
    return np.cross(b - a, c - a) / 2


def test_the_papers_mesh_has_the_papers_counts():
    mesh = paper_mesh()
    assert (len(mesh.nodes), mesh.cells.shape) == (2601, (12288, 4))
    assert mesh.volume == pytest.approx(np.prod(PAPER_SIZE_M), rel=1e-12)
    assert len(mesh.surface_nodes("top")) == len(mesh.surface_nodes("base")) == 17 * 17
    np.testing.assert_allclose(np.ptp(mesh.nodes, axis=0), PAPER_SIZE_M, rtol=1e-14)


def test_margins_have_half_as_many_cells_and_the_middle_the_others():
    even = block_mesh(SIZE, (9, 7, 2))
    mesh = widened_margins(even, (9, 7), 0.02)
    corners = mesh.nodes[: mesh.cells[:, :4].max() + 1]
    x, y = (np.unique(corners[:, axis].round(12)) for axis in (0, 1))
    np.testing.assert_allclose(np.diff(x), [0.02, *np.full(7, 0.05 / 7), 0.02])
    np.testing.assert_allclose(np.diff(y), [0.02, *np.full(5, 0.03 / 5), 0.02])
    assert mesh.volume == pytest.approx(even.volume, rel=1e-12)
    assert mesh.cell_volumes.min() > 0
    np.testing.assert_array_equal(widened_margins(even, (9, 7), 0.0).nodes, even.nodes)


@every_block
def test_a_block_is_filled_without_gap_or_overlap(mesh):
    volumes = mesh.cell_volumes
    assert volumes.min() > 0
    assert mesh.volume == pytest.approx(np.prod(SIZE), rel=1e-12)
    # Every face belongs to one or two cells, and those of one form the closed boundary
    faces = np.sort(mesh.cells[:, TET_FACES].reshape(-1, 3), axis=1)
    count = np.unique(faces, axis=0, return_counts=True)[1]
    assert set(count) == {1, 2}
    assert (count == 1).sum() == len(mesh.boundary)
    assert np.unique(mesh.cells).size == len(mesh.nodes)


@every_block
def test_the_three_surfaces_tile_the_boundary_and_look_outwards(mesh):
    lx, ly, lz = SIZE
    top, base, sides = (area_vectors(mesh, mesh.surface(n)) for n in ("top", "base", "sides"))
    np.testing.assert_allclose(top.sum(axis=0), (0, 0, lx * ly), rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(base.sum(axis=0), (0, 0, -lx * ly), rtol=1e-12, atol=1e-15)
    assert np.linalg.norm(sides, axis=1).sum() == pytest.approx(2 * lz * (lx + ly), rel=1e-12)
    centres = mesh.nodes[mesh.surface("sides")[:, :3]].mean(axis=1)
    outwards = (centres - np.array(SIZE) / 2) * [1, 1, 0]
    assert (np.einsum("ti,ti->t", sides, outwards) > 0).all()
    assert sum(len(mesh.surface(n)) for n in ("top", "base", "sides")) == len(mesh.boundary)
    four = {"x0": (-ly * lz, 0, 0), "x1": (ly * lz, 0, 0), "y0": (0, -lx * lz, 0),
            "y1": (0, lx * lz, 0)}  # fmt: skip
    for name, area in four.items():
        found = area_vectors(mesh, mesh.surface(name))
        np.testing.assert_allclose(found.sum(axis=0), area, rtol=1e-12, atol=1e-15)
    assert sum(len(mesh.surface(n)) for n in four) == len(mesh.surface("sides"))
    # Gauss: the outward boundary encloses the volume
    x, vector = mesh.nodes[mesh.boundary[:, :3]].mean(axis=1), area_vectors(mesh, mesh.boundary)
    assert np.einsum("ti,ti->", x, vector) / 3 == pytest.approx(mesh.volume, rel=1e-12)


@every_block
def test_mid_nodes_lie_in_the_middle_of_the_edges_that_their_place_stands_for(mesh):
    if mesh.order == 1:
        mesh = promote_to_tet10(mesh)
    for table, pairs, vertices in (
        (mesh.cells, TET_EDGES, 4),
        (mesh.boundary, TRIANGLE_EDGES, 3),
        *((faces, TRIANGLE_EDGES, 3) for faces in mesh.surfaces.values()),
    ):
        middle = mesh.nodes[table[:, pairs]].mean(axis=2)
        np.testing.assert_allclose(mesh.nodes[table[:, vertices:]], middle, rtol=0, atol=1e-16)
    assert promote_to_tet10(mesh) is mesh


def test_local_numbers_are_those_of_vtk():
    np.testing.assert_array_equal(TET_EDGES, [(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])
    np.testing.assert_array_equal(TRIANGLE_EDGES, [(0, 1), (1, 2), (0, 2)])


def test_an_edge_gets_one_mid_node_whoever_shares_it():
    coarse = block_mesh(SIZE, (3, 2, 4), order=1)
    edges = np.unique(np.sort(coarse.cells[:, TET_EDGES].reshape(-1, 2), axis=1), axis=0)
    fine = promote_to_tet10(coarse)
    assert len(fine.nodes) == len(coarse.nodes) + len(edges)
    assert len(np.unique(fine.nodes.round(12), axis=0)) == len(fine.nodes)


def test_grading_draws_the_layers_towards_the_top():
    z = np.unique(block_mesh(SIZE, (1, 1, 5), grading=1.6, order=1).nodes[:, 2])
    np.testing.assert_allclose(z, SIZE[2] * (1 - (1 - np.arange(6) / 5) ** 1.6), rtol=1e-12)
    assert (np.diff(z, 2) < 0).all()


def test_the_alternating_split_has_no_preferred_diagonal():
    mesh = block_mesh((1, 1, 1), (2, 2, 2), order=1, split="alternating")
    turned = Rotation.from_euler("z", 90, degrees=True).apply(mesh.nodes - 0.5) + 0.5
    centres = [m[mesh.cells].mean(axis=1) for m in (mesh.nodes, turned[:, [1, 0, 2]])]
    key = [c[np.lexsort(c.round(9).T)] for c in centres]
    np.testing.assert_allclose(key[0], key[1], atol=1e-12)


def test_a_mesh_cannot_be_written_to_and_keeps_its_own_copy():
    nodes = np.array([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], float)
    mesh = Mesh(nodes, np.array([[0, 1, 2, 3]]), {"base": np.array([[0, 2, 1]])})
    nodes[0] = 7.0
    assert mesh.volume == pytest.approx(1 / 6, rel=1e-14)
    for array in (mesh.nodes, mesh.cells, mesh.surfaces["base"]):
        with pytest.raises(ValueError, match="read-only"):
            array[0] = 0
    with pytest.raises(TypeError):
        mesh.surfaces["base"] = mesh.boundary  # type: ignore[index]


def test_a_wrong_surface_name_lists_the_right_ones():
    with pytest.raises(MeshError, match="no surface 'bottom'; it has: base, sides, top"):
        block_mesh(SIZE, (1, 1, 1)).surface("bottom")


@pytest.mark.parametrize(
    ("nodes", "cells"), [(np.zeros((4, 2)), np.zeros((1, 4))), (np.zeros((4, 3)), np.ones((1, 8)))]
)
def test_arrays_of_a_wrong_shape_are_no_mesh(nodes, cells):
    with pytest.raises(MeshError, match=r"shape .* expected"):
        Mesh(nodes, cells, {})


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (((0.1, 0.1), (1, 1, 1)), "three positive lengths"),
        (((0.1, 0.1, -0.1), (1, 1, 1)), "three positive lengths"),
        (((0.1, np.nan, 0.1), (1, 1, 1)), "three positive lengths"),
        ((SIZE, (1, 0, 1)), "three positive whole numbers"),
        ((SIZE, (1.0, 2.0, 3.0)), "three positive whole numbers"),
        ((SIZE, (1, 1, 1), 0.0), "grading > 0"),
        ((SIZE, (1, 1, 1), 1.0, 3), "order 1 or 2"),
        ((SIZE, (1, 1, 1), 1.0, 1, "five"), "alternating.*kuhn.*'five'"),
    ],
)
def test_a_block_that_cannot_be_is_refused_with_what_was_expected(arguments, complaint):
    with pytest.raises(MeshError, match=complaint):
        block_mesh(*arguments)
