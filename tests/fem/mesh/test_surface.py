from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest
import pyvista

import fem.mesh.tetrahedralize
from fem.errors import MeshError
from fem.mesh.block import block_mesh
from fem.mesh.checks import cell_quality, check_mesh
from fem.mesh.mesh import Mesh
from fem.mesh.subprocess_job import run_job
from fem.mesh.surface import Surface, check_surface, read_surface
from fem.mesh.surface_worker import decimated
from fem.mesh.tetrahedralize import mesh_cache_folder, tetrahedralize_surface


def organ(around: int = 40, down: int = 14, height: float = 0.035) -> Surface:
    """A bumpy half ellipsoid on a flat underside, from rings of vertices, in m."""
    angle = np.arange(around) * 2 * np.pi / around
    rings = [np.array([[0.0, 0.0, height]])]
    for s in np.linspace(0, np.pi / 2, down + 1)[1:]:
        bump = 1 + 0.08 * np.sin(3 * angle) * np.sin(s) ** 2
        ring = [0.05 * bump * np.sin(s) * np.cos(angle), 0.04 * bump * np.sin(s) * np.sin(angle)]
        rings.append(np.stack([*ring, np.full(around, height * np.cos(s))], axis=1))
    rim = rings[-1]
    rim[:, 2] = 0.0
    rings += [rim * f for f in (0.75, 0.5, 0.25)] + [np.zeros((1, 3))]
    start = np.cumsum([0] + [len(r) for r in rings])
    i, j = np.arange(around), (np.arange(around) + 1) % around
    fans = [np.stack([0 * i, 1 + i, 1 + j], axis=1)]
    for k in range(1, len(rings) - 2):
        a, b = start[k], start[k + 1]
        fans += [np.stack([a + i, b + i, b + j], 1), np.stack([a + i, b + j, a + j], 1)]
    last = start[-2]
    fans.append(np.stack([last + 0 * i, start[-3] + j, start[-3] + i], axis=1))
    return Surface(np.vstack(rings), np.vstack(fans).astype(np.int32))


def sphere(radius: float = 0.03, subdivisions: int = 2, centre: float = 0.0) -> Surface:
    ball = pyvista.Icosphere(radius=radius, nsub=subdivisions, center=(centre, 0, 0))
    return check_surface(np.array(ball.points, float), ball.regular_faces)


def joined(*parts: Surface) -> Surface:
    offset = np.cumsum([0] + [len(p.vertices) for p in parts])
    return Surface(
        np.vstack([p.vertices for p in parts]),
        np.vstack([p.triangles + o for p, o in zip(parts, offset[:-1], strict=True)]),
    )


def flipped(surface: Surface) -> Surface:
    return Surface(surface.vertices, surface.triangles[:, ::-1])


EDGE = 0.016


@pytest.fixture(scope="module")
def cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache with a space")


@pytest.fixture(scope="module")
def organ_mesh(cache: Path) -> Mesh:
    return tetrahedralize_surface(*organ(), EDGE, cache_folder=cache)


# ------------------------------------------------------------------------------- checking


def test_a_closed_surface_passes_with_its_volume_and_area():
    block = block_mesh((0.1, 0.08, 0.05), (3, 2, 2), order=1)
    surface = check_surface(block.nodes + 0.2, block.boundary)
    assert surface.volume == pytest.approx(0.1 * 0.08 * 0.05, rel=1e-12)
    area = 2 * (0.1 * 0.08 + 0.1 * 0.05 + 0.08 * 0.05)
    assert surface.area == pytest.approx(area, rel=1e-12)


def test_repeated_vertices_are_merged_and_degenerate_triangles_dropped():
    clean = organ()
    soup = clean.vertices[clean.triangles].reshape(-1, 3)
    faces = np.arange(len(soup)).reshape(-1, 3)
    faces = np.vstack([faces, [faces[0, [0, 0, 1]]]])
    welded = check_surface(soup, faces)
    assert (len(welded.vertices), len(welded.triangles)) == (
        len(clean.vertices),
        len(clean.triangles),
    )
    assert welded.volume == pytest.approx(clean.volume, rel=1e-12)


def test_a_cavity_is_allowed():
    hollow = joined(sphere(0.03), flipped(sphere(0.015)))
    assert check_surface(*hollow).volume == pytest.approx(0.875 * sphere().volume, rel=1e-9)


def edited(surface: Surface, row: int, value: float) -> Surface:
    vertices = surface.vertices.copy()
    vertices[row, 1] = value
    return Surface(vertices, surface.triangles)


BALL = sphere()
BAD = {
    "nan vertex": (edited(BALL, 5, np.nan), "Vertex 5 .* nan"),
    "inf vertex": (edited(BALL, 6, np.inf), "Vertex 6 .* inf"),
    "no vertices": (Surface(np.zeros((0, 3)), BALL.triangles), r"vertices must be \(n, 3\)"),
    "no faces": (Surface(BALL.vertices, BALL.triangles[:0]), r"\(t, 3\) with t >= 4"),
    "two coordinates": (Surface(BALL.vertices[:, :2], BALL.triangles), r"are \(162, 2\)"),
    "four-cornered faces": (
        Surface(BALL.vertices, np.hstack([BALL.triangles, BALL.triangles[:, :1]])),
        r"are \(320, 4\)",
    ),
    "fractional faces": (Surface(BALL.vertices, BALL.triangles.astype(float)), "float64"),  # type: ignore[arg-type]
    "index too large": (Surface(BALL.vertices, BALL.triangles + 1), "from 0 to 161"),
    "negative index": (Surface(BALL.vertices, BALL.triangles - 1), "from 0 to 161"),
    "one face missing": (Surface(BALL.vertices, BALL.triangles[1:]), "open: 3 edges"),
    "a fifth missing": (Surface(BALL.vertices, BALL.triangles[64:]), "is open"),
    "one triangle": (Surface(BALL.vertices, BALL.triangles[:1]), "t >= 4"),
    "flat": (Surface(BALL.vertices * [1, 1, 0], BALL.triangles), "is flat"),
    "one face turned": (
        Surface(BALL.vertices, np.vstack([BALL.triangles[:1, ::-1], BALL.triangles[1:]])),
        "twice in one direction",
    ),
    "doubled": (joined(BALL, BALL), "twice in one direction"),
    "inside out": (flipped(BALL), "point inwards"),
    "two bodies": (joined(BALL, sphere(centre=0.1)), "2 separate bodies"),
    "overlapping bodies": (joined(BALL, sphere(centre=0.03)), "2 separate bodies"),
    "millimetres": (Surface(1000 * BALL.vertices, BALL.triangles), r"millimetres.*scale=0\.001"),
    "nanometres": (Surface(1e-9 * BALL.vertices, BALL.triangles), "only .* m large"),
}


@pytest.mark.parametrize("case", BAD)
def test_a_bad_surface_is_refused_before_the_mesher_sees_it(case, tmp_path):
    surface, message = BAD[case]
    start = time.perf_counter()
    with pytest.raises(MeshError, match=message):
        tetrahedralize_surface(*surface, 0.01, cache_folder=tmp_path)
    assert time.perf_counter() - start < 0.5  # no process was started
    assert not list(tmp_path.iterdir())


# -------------------------------------------------------------------------------- reading


@pytest.mark.parametrize("suffix", [".stl", ".ply", ".obj"])
def test_a_surface_file_in_millimetres_is_refused_and_read_with_its_scale(suffix, tmp_path):
    surface = organ(20, 6)
    path = tmp_path / f"an organ{suffix}"
    pyvista.PolyData.from_regular_faces(1000 * surface.vertices, surface.triangles).save(path)
    with pytest.raises(MeshError, match=r"organ.*millimetres.*scale=0\.001"):
        read_surface(path)
    read = read_surface(path, scale=0.001)
    assert len(read.triangles) == len(surface.triangles)
    assert read.volume == pytest.approx(surface.volume, rel=1e-5)  # the file has single precision


def test_a_file_of_quadrilaterals_is_cut_into_triangles(tmp_path):
    corners = [
        "v 0 0 0",
        "v 1 0 0",
        "v 1 1 0",
        "v 0 1 0",
        "v 0 0 1",
        "v 1 0 1",
        "v 1 1 1",
        "v 0 1 1",
    ]
    quads = ["f 4 3 2 1", "f 5 6 7 8", "f 1 2 6 5", "f 2 3 7 6", "f 3 4 8 7", "f 4 1 5 8"]
    path = tmp_path / "cube.obj"
    path.write_text("\n".join(corners + quads) + "\n")
    assert read_surface(path, scale=0.1).volume == pytest.approx(1e-3, rel=1e-12)


def test_missing_foreign_and_cut_off_files_give_one_sentence_with_the_path(tmp_path):
    with pytest.raises(MeshError, match=r"none\.stl: there is no such file; check the path"):
        read_surface(tmp_path / "none.stl")
    with pytest.raises(MeshError, match=r"must end in one of \.stl, \.obj, \.ply"):
        read_surface(tmp_path / "mesh.vtk")
    foreign = tmp_path / "foreign.obj"
    foreign.write_text("hello\n" * 50)
    with pytest.raises(MeshError, match=r"foreign\.obj: no triangles in it"):
        read_surface(foreign)
    surface = organ(20, 6)
    whole = tmp_path / "whole.ply"
    pyvista.PolyData.from_regular_faces(surface.vertices, surface.triangles).save(whole)
    cut = tmp_path / "cut.ply"
    cut.write_bytes(whole.read_bytes()[:1500])
    with pytest.raises(MeshError, match=r"cut\.ply: .* export it again"):
        read_surface(cut)
    garbage = tmp_path / "garbage.stl"
    garbage.write_bytes(b"hello" * 100)
    with pytest.raises(MeshError, match=r"garbage\.stl: it cannot be read: cut off"):
        read_surface(garbage)
    for scale in (0.0, -1.0, np.nan):
        with pytest.raises(MeshError, match="scale"):
            read_surface(whole, scale=scale)


# -------------------------------------------------------------------------------- meshing


def test_an_organ_becomes_a_sound_mesh_of_its_volume(organ_mesh):
    check_mesh(organ_mesh)
    assert organ_mesh.order == 2
    assert organ_mesh.volume == pytest.approx(organ().volume, rel=0.02)
    assert cell_quality(organ_mesh).min() > 0.05
    ends = organ_mesh.nodes[organ_mesh.cells[:, [0, 1]]]
    mean = np.linalg.norm(ends[:, 0] - ends[:, 1], axis=1).mean()
    assert 0.5 * EDGE < mean < 1.5 * EDGE


def test_base_and_top_make_up_the_boundary_and_the_base_is_the_flat_underside(organ_mesh):
    base, top = organ_mesh.surface("base"), organ_mesh.surface("top")
    assert len(base) + len(top) == len(organ_mesh.boundary)
    assert np.ptp(organ_mesh.nodes[base, 2]) < 0.02 * 0.035
    assert Surface(organ_mesh.nodes, base[:, :3]).area == pytest.approx(
        np.pi * 0.05 * 0.04, rel=0.03
    )
    assert organ_mesh.nodes[top, 2].max() == pytest.approx(0.035, abs=5e-4)


def test_the_second_call_takes_the_mesh_from_the_cache(organ_mesh, cache):
    start = time.perf_counter()
    again = tetrahedralize_surface(*organ(), EDGE, cache_folder=cache)
    assert time.perf_counter() - start < 0.5  # importing the mesher alone takes longer
    np.testing.assert_array_equal(again.nodes, organ_mesh.nodes)
    np.testing.assert_array_equal(again.cells, organ_mesh.cells)
    linear = tetrahedralize_surface(*organ(), EDGE, order=1, cache_folder=cache)
    np.testing.assert_array_equal(linear.cells, organ_mesh.cells[:, :4])
    assert len(list(cache.iterdir())) == 1


def test_another_edge_length_surface_or_box_is_another_entry_of_the_cache():
    key = fem.mesh.tetrahedralize._content_hash
    other, box = organ(), np.array([[0, 0, 0], [0.02, 0.02, 0.02]])
    other.vertices[3, 0] += 1e-9
    same = {key(organ(), 0.012, None), key(organ(), 0.012, None)}
    others = {key(organ(), 0.0121, None), key(other, 0.012, None), key(organ(), 0.012, box)}
    assert len(same | others) == 4
    assert key(organ(), 0.012, box) != key(organ(), 0.012, box + 1e-6)


def test_edges_are_short_in_a_box_and_longer_outside(tmp_path):
    block = block_mesh((0.06, 0.06, 0.03), (1, 1, 1), order=1)
    box = np.array([[0.02, 0.02, 0.015], [0.04, 0.04, 0.03]])
    mesh = tetrahedralize_surface(
        block.nodes, block.boundary, 0.003, fine_box_m=box, order=1, cache_folder=tmp_path
    )
    corners = mesh.nodes[mesh.cells]
    edge = np.linalg.norm(corners[:, [0, 0, 0, 1, 1, 2]] - corners[:, [1, 2, 3, 2, 3, 3]], axis=2)
    middle = corners.mean(axis=1)
    inside = ((middle > box[0]) & (middle < box[1])).all(axis=1)
    far = (np.abs(middle[:, :2] - 0.03).max(axis=1) > 0.02) | (middle[:, 2] < 0.005)
    assert np.median(edge[inside]) == pytest.approx(0.003, rel=0.2)
    assert 0.006 < np.median(edge[far]) < 0.011
    assert len(mesh.cells) < 7.5 * block.volume / 0.003**3 / 4
    assert mesh.focused


@pytest.mark.parametrize("damage", ["cut off", "empty", "foreign", "other mesh"])
def test_a_damaged_cache_file_is_not_used(organ_mesh, cache, damage, tmp_path):
    (kept,) = cache.iterdir()
    copy = tmp_path / kept.name
    if damage == "other mesh":
        np.savez(copy, nodes=2 * organ_mesh.nodes, cells=organ_mesh.cells[:, :4])
    else:
        whole = kept.read_bytes()
        copy.write_bytes({"cut off": whole[: len(whole) // 2], "empty": b""}.get(damage, b"hello"))
    assert fem.mesh.tetrahedralize._load(copy, check_surface(*organ())) is None


@pytest.mark.slow
def test_a_damaged_cache_file_is_replaced_by_a_new_mesh(tmp_path):
    box = block_mesh((0.04, 0.04, 0.03), (1, 1, 1), order=1)
    surface = check_surface(box.nodes, box.boundary)
    kept = tmp_path / f"{fem.mesh.tetrahedralize._content_hash(surface, 0.03, None)}.npz"
    kept.write_bytes(b"PK cut off")
    mesh = tetrahedralize_surface(box.nodes, box.boundary, 0.03, cache_folder=tmp_path)
    assert mesh.volume == pytest.approx(0.04 * 0.04 * 0.03, rel=0.02)
    again = tetrahedralize_surface(box.nodes, box.boundary, 0.03, cache_folder=tmp_path)
    np.testing.assert_array_equal(again.nodes, mesh.nodes)
    assert list(tmp_path.iterdir()) == [kept]


def test_a_surface_much_finer_than_the_mesh_is_decimated_and_keeps_its_shape():
    fine = organ(100, 40)
    vertices, triangles = decimated(*fine, 1000)
    coarse = check_surface(vertices, triangles)
    assert 500 < len(coarse.triangles) <= 1000 < len(fine.triangles)
    assert coarse.volume == pytest.approx(fine.volume, rel=0.005)
    assert decimated(*fine, 1e5)[1] is fine.triangles


def test_a_surface_that_decimation_would_spoil_is_left_as_it_is():
    assert decimated(*BALL, 6)[1] is BALL.triangles


@pytest.mark.slow
def test_a_surface_that_intersects_itself_is_found_by_its_volume(tmp_path):
    block = block_mesh((0.06, 0.06, 0.06), (3, 3, 3), order=1)
    nodes = block.nodes.copy()
    deep = (np.abs(nodes[:, :2] - 0.03).max(axis=1) < 0.015) & (nodes[:, 2] == 0.06)
    nodes[deep, 2] = -0.05  # the middle of the top pushed out through the base
    with pytest.raises(MeshError, match=r"times the surface's volume|share no face|no underside"):
        tetrahedralize_surface(nodes, block.boundary, 0.04, cache_folder=tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_body_without_a_flat_underside_is_refused():
    ball = sphere(subdivisions=1)
    with pytest.raises(MeshError, match="no underside to rest on"):
        fem.mesh.tetrahedralize._surfaces(ball.vertices, ball.triangles)


def test_the_cache_folder_follows_the_environment(monkeypatch, tmp_path):
    monkeypatch.setenv("PALPMAP_CACHE", str(tmp_path))
    assert mesh_cache_folder() == tmp_path / "meshes"
    monkeypatch.delenv("PALPMAP_CACHE")
    assert mesh_cache_folder().parts[-2:] == ("palpmap", "meshes")


@pytest.mark.parametrize("edge", [0.0, -0.01, np.nan, 0.5, 1e-4])
def test_an_edge_length_that_cannot_work_is_refused_with_a_number_that_can(edge, tmp_path):
    with pytest.raises(MeshError, match=r"edge length.*0\.0"):
        tetrahedralize_surface(*organ(), edge, cache_folder=tmp_path)


# ---------------------------------------------------------------------------- own process


def test_a_crash_of_the_mesher_becomes_an_error():
    with pytest.raises(MeshError, match=r"The mesher crashed \(SIG"):
        _fill(BALL.vertices, BALL.triangles + 1000)


def test_a_mesher_that_does_not_end_is_stopped():
    quads = np.hstack([BALL.triangles, BALL.triangles[:, :1]])
    start = time.perf_counter()
    with pytest.raises(MeshError, match=r"did not end within 2\.5 s"):
        _fill(BALL.vertices, quads, time_limit_s=2.5)
    assert time.perf_counter() - start < 6


def test_an_exception_in_the_own_process_becomes_an_error_with_its_last_line():
    with pytest.raises(MeshError, match=r"The mesher failed: .*float"):
        _fill(BALL.vertices, BALL.triangles, edge_length_m="long")


def _fill(vertices, triangles, time_limit_s=20.0, edge_length_m: object = 0.01):
    run_job(
        "tetrahedralize",
        time_limit_s,
        vertices=vertices,
        triangles=triangles,
        edge_length_m=edge_length_m,
        most_triangles=1e9,
    )
