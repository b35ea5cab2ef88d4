"""Cells where a scan sees: planes, meshes, the stiffness of a large body pressed in its middle."""

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh, check_mesh
from fem.mesh import focused_planes, mesh_between, planes_over, probed_box, refined_planes

SIZE = np.array([0.2, 0.18, 0.1])


def grid(side: int, step_m: float, top_m: float = 0.1) -> np.ndarray:
    line = step_m * (np.arange(side) - (side - 1) / 2)
    x, y = (v.ravel() for v in np.meshgrid(0.1 + line, 0.09 + line, indexing="ij"))
    return np.column_stack([x, y, np.full(side**2, top_m)])


def test_the_whole_body_is_probed_where_presses_cover_it_or_are_few():
    box = np.array([np.zeros(3), [0.096, 0.096, 0.048]])
    line = np.linspace(0.008, 0.088, 9)
    all_over = np.stack(np.meshgrid(line, line, [0.048]), axis=-1).reshape(-1, 3)
    assert np.array_equal(probed_box(all_over, box, 0.001), box)
    large = np.array([np.zeros(3), SIZE])
    assert np.array_equal(probed_box(grid(5, 0.01), large, 0.01), large)  # a wide tip
    assert not np.array_equal(probed_box(grid(5, 0.01), large, 0.005), large)
    assert np.array_equal(probed_box(grid(4, 0.01), large, 0.005), large)
    assert np.array_equal(probed_box(np.tile(grid(1, 0.01), (30, 1)), large, 0.005), large)


@pytest.mark.parametrize("low", [0.0, 0.002, 0.03, 0.15])
def test_planes_are_even_where_a_scan_sees_and_grow_outside(low):
    planes = focused_planes(0.3, 0.01, low, low + 0.1)
    assert (planes[0], planes[-1]) == (0, pytest.approx(0.3))
    widths = np.diff(planes)
    inside = (planes[:-1] > low - 1e-9) & (planes[1:] < low + 0.1 + 1e-9)
    assert widths[inside] == pytest.approx(0.01, rel=0.03)
    growth = widths[1:] / widths[:-1]
    assert np.maximum(growth, 1 / growth).max() < 3.01
    finer = refined_planes(planes, 1.5)
    assert len(finer) - 1 == round(1.5 * (len(planes) - 1))
    assert np.diff(finer)[finer[1:] < low + 0.05].max(initial=0) < widths[0]


def test_even_planes_make_the_blocks_own_mesh():
    planes = planes_over(SIZE.tolist(), (5, 4, 3), grid(2, 0.1), 0.005)
    np.testing.assert_array_equal(mesh_between(planes).nodes, block_mesh(SIZE, (5, 4, 3)).nodes)


def test_a_model_knows_the_part_that_its_presses_show_by_its_mesh():
    points = grid(5, 0.015)
    contacts = Contacts(points, np.tile([0.0, 0, -1], (25, 1)), 0.005)
    focused = mesh_between(planes_over(SIZE.tolist(), (4, 4, 3), points, 0.005))
    even = block_mesh(SIZE, (6, 6, 4))
    one, other = (PalpationModel(m, 0.4, contacts, near_field=False) for m in (focused, even))
    assert np.array_equal(other.probed_m, even.box_m)
    assert np.array_equal(one.probed_m, probed_box(points, focused.box_m, 0.005))
    assert (np.ptp(one.probed_m, axis=0) < 0.5 * SIZE).all()


@pytest.mark.slow
def test_a_large_block_pressed_in_its_middle_has_the_stiffness_of_even_fine_cells():
    points = grid(5, 0.015)
    probed = probed_box(points, np.array([np.zeros(3), SIZE]), 0.005)
    cell = np.cbrt(np.prod(probed[1] - probed[0]) / 256)
    planes = [focused_planes(e, cell, *at) for e, at in zip(SIZE, probed.T, strict=True)]
    mesh = mesh_between(planes)
    check_mesh(mesh)
    x, y, z = (len(p) - 1 for p in planes)
    assert x * y * z < 1000
    some = Contacts(points[[0, 7, 12]], np.tile([0.0, 0, -1], (3, 1)), 0.005)
    spot = np.array([0.1, 0.09, 0.085])

    def compliance(mesh):
        model = PalpationModel(mesh, 0.48, some)
        away = np.sum((model.points_m - spot) ** 2, axis=1)
        return model.evaluate(5e3 + 2e4 * np.exp(-away / (2 * 0.009**2))).compliance

    even = compliance(block_mesh(SIZE, (26, 24, 13)))
    error, evenly_spread = (
        np.abs(compliance(m) / even - 1).max() for m in (mesh, block_mesh(SIZE, (8, 8, 4)))
    )
    assert error < 0.01 < 0.02 < evenly_spread
