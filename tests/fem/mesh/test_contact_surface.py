"""The surface through contact points: a dome, its edges, the body below it, and refusals."""

import numpy as np
import pytest

from fem import Contacts, MeshError, PalpationModel, block_mesh
from fem.mesh import ContactSurface, under_surface
from fem.mesh.checks import check_mesh

RADIUS, HEIGHT, NU = 0.06, 0.03, 0.45


def dome(xy: np.ndarray) -> np.ndarray:
    return HEIGHT - RADIUS + np.sqrt(RADIUS**2 - (xy**2).sum(axis=1))


def grid(number: int, half_m: float = 0.02) -> np.ndarray:
    line = np.linspace(-half_m, half_m, number)
    return np.stack(np.meshgrid(line, 0.9 * line, indexing="ij"), axis=-1).reshape(-1, 2)


def touched(xy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Contact points on the dome and directions along its normals."""
    inward = -np.column_stack([xy, np.sqrt(RADIUS**2 - (xy**2).sum(axis=1))]) / RADIUS
    return np.column_stack([xy, dome(xy)]), inward


def test_a_dome_is_met_between_its_contacts_and_its_normals_too():
    points, inward = touched(grid(7))
    surface = ContactSurface.through(points, inward)
    between = np.random.default_rng(0).uniform(-0.016, 0.016, (200, 2))
    assert np.abs(surface.heights(between) - dome(between)).max() < 2e-5
    cosine = np.einsum("jc,jc->j", surface.inward_normals(between), touched(between)[1])
    assert np.degrees(np.arccos(cosine.min())) < 0.3


def test_directions_tell_the_curvature_that_few_points_do_not():
    points, inward = touched(grid(4))
    surface = ContactSurface.through(points, inward)
    alone = ContactSurface.through(points, np.tile([0.0, 0, -1], (16, 1)))
    between = np.random.default_rng(0).uniform(-0.018, 0.018, (200, 2))
    error, other = (np.abs(s.heights(between) - dome(between)).max() for s in (surface, alone))
    assert surface.with_directions
    assert not alone.with_directions
    assert error < 1e-4 < other / 4


def test_noise_of_the_touch_is_smoothed():
    points, inward = touched(grid(11))
    noisy = points + np.outer(np.random.default_rng(1).normal(0, 3e-4, len(points)), [0, 0, 1])
    surface = ContactSurface.through(noisy, inward)
    between = np.random.default_rng(0).uniform(-0.016, 0.016, (200, 2))
    assert surface.smoothing > 0
    assert np.sqrt(np.mean((surface.heights(between) - dome(between)) ** 2)) < 1.2e-4


def test_smoothing_keeps_a_paraboloid_and_takes_what_is_finer():
    xy = grid(25, half_m=0.06)
    wave = 1e-3 * np.sin(2 * np.pi * xy[:, 0] / 0.012)
    points = np.column_stack([xy, 0.03 - 4 * (xy**2).sum(axis=1) + wave])
    through = ContactSurface.through(points, np.tile([0.0, 0, -1], (len(xy), 1)))
    smooth = through.smoothed(0.008, np.full(2, -0.06), np.full(2, 0.06))
    middle = np.random.default_rng(0).uniform(-0.02, 0.02, (50, 2))
    exact = 0.03 - 4 * (middle**2).sum(axis=1)
    np.testing.assert_allclose(smooth.heights(middle), exact, atol=2e-5)
    slope = smooth.inward_normals(middle)
    np.testing.assert_allclose(-slope[:, :2] / slope[:, 2:], -8 * middle, atol=0.02)


def test_beyond_the_contacts_the_surface_keeps_its_slope_and_levels_out():
    points = np.column_stack([grid(5), 0.02 + 0.3 * grid(5)[:, 0]])
    surface = ContactSurface.through(points, np.tile([0.3, 0, -1] / np.sqrt(1.09), (25, 1)))
    out = np.column_stack([0.02 + np.array([0.0, 1e-4, 1.0, 2.0]), np.zeros(4)])
    z = surface.heights(out)
    assert z[0] == pytest.approx(0.026, abs=1e-9)
    assert (z[1] - z[0]) / 1e-4 == pytest.approx(0.3, rel=0.02)
    np.testing.assert_allclose(z[2:], 0.026 + 0.3 * surface.level_m, rtol=1e-6)


def test_flat_contacts_make_the_block():
    size, counts = (0.06, 0.05, 0.03), (5, 4, 3)
    xy = grid(5) + 0.025
    points = np.column_stack([xy, np.full(25, size[2])])
    down = np.tile([0.0, 0, -1], (25, 1))
    contacts = Contacts(points[[6, 12, 18]], down[[6, 12, 18]], 0.004)
    block = block_mesh(size, counts)
    shaped = under_surface(block, (0, 0, 0), ContactSurface.through(points, down).heights)
    expected, found = (
        PalpationModel(mesh, NU, contacts).evaluate(1e4).compliance for mesh in (block, shaped)
    )
    np.testing.assert_allclose(found, expected, rtol=1e-9)
    assert shaped.surfaces.keys() == block.surfaces.keys()


def test_a_dome_from_contacts_has_the_compliances_of_the_dome():
    points, inward = touched(grid(6))
    surface = ContactSurface.through(points, inward)
    tried = [0, 14, 15]
    contacts = Contacts(points[tried], inward[tried], 0.003, "hertz")

    def compliance(heights, counts) -> np.ndarray:
        mesh = under_surface(block_mesh((0.06, 0.06, HEIGHT), counts), (-0.03, -0.03, 0), heights)
        return PalpationModel(mesh, NU, contacts).evaluate(1e4).compliance

    true = compliance(dome, (11, 11, 5))
    np.testing.assert_allclose(compliance(surface.heights, (8, 8, 4)), true, rtol=0.01)


def test_a_surface_that_would_fall_below_the_base_is_lifted_and_stays_elsewhere():
    xy = grid(9, half_m=0.03)
    points = np.column_stack([xy, 0.03 - 25 * (xy**2).sum(axis=1)])  # a base circle of 35 mm
    inward = np.column_stack([-50 * xy, -np.ones(len(xy))])
    through = ContactSurface.through(points, inward / np.linalg.norm(inward, axis=1, keepdims=True))
    corners = np.full(2, -0.05), np.full(2, 0.05)
    clear = 0.003
    as_it_is, lifted = (through.smoothed(2e-3, *corners, *more) for more in ((), (0.0, clear)))
    everywhere = grid(60, half_m=0.05)
    assert as_it_is.heights(everywhere).min() < -0.01
    assert lifted.heights(everywhere).min() == pytest.approx(clear / 2, rel=0.15)
    high = everywhere[as_it_is.heights(everywhere) > 0.01]
    np.testing.assert_allclose(lifted.heights(high), as_it_is.heights(high), atol=1e-4)
    mesh = under_surface(
        block_mesh((0.1, 0.1, 0.02), (24, 24, 5)), (-0.05, -0.05, 0), lifted.heights
    )
    check_mesh(mesh)


def folded() -> np.ndarray:
    points = touched(grid(5))[0]
    return np.vstack([points, points[12] + [3e-4, 0, 0.006]])


@pytest.mark.parametrize(
    ("points", "sentence"),
    [
        (touched(grid(3))[0], "needs at least 10 different places, found 9"),
        (np.repeat(touched(grid(3))[0], 3, axis=0), "found 9"),
        (np.column_stack([np.linspace(0, 1, 20), 0.5 * np.linspace(0, 1, 20), np.ones(20)]),
         "20 contact points lie on a line"),
        (folded(), r"nearly one above the other \(2 such of 26\): the surface would be folded"),
    ],
)  # fmt: skip
def test_points_that_make_no_surface_are_refused(points, sentence):
    with pytest.raises(MeshError, match=sentence):
        ContactSurface.through(points, np.tile([0.0, 0, -1], (len(points), 1)))
