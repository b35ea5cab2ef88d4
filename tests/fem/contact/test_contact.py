"""Weights of a contact: resultant, moments, mesh independence, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from fem.contact.contacts import Contacts, contact_frame, contact_weights, disc_quadrature
from fem.contact.half_space import FLAT, HERTZ
from fem.contact.paraboloid import surface_curvature
from fem.errors import MeshError
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.mesh.surface import Surface

SIZE = np.array([0.09, 0.07, 0.05])
DOWN = np.array([0.0, 0.0, -1.0])
every_order = pytest.mark.parametrize("order", [1, 2])
every_profile = pytest.mark.parametrize("profile", ["flat", "hertz"])
# int p r^2 dA of unit resultant, in a^2
SECOND_MOMENT = {"flat": 2 / 3, "hertz": 2 / 5}


def irregular_block(order: int, rotation: Rotation, seed: int = 1) -> Mesh:
    """Block with nodes moved at random (on the faces: within them), tilted."""
    plain = block_mesh(SIZE, (6, 5, 3), order=1, split="alternating")
    rng = np.random.default_rng(seed)
    shift = rng.uniform(-0.2, 0.2, plain.nodes.shape) * SIZE / (6, 5, 3)
    shift[(plain.nodes == 0) | (plain.nodes == SIZE)] = 0
    mesh = Mesh(rotation.apply(plain.nodes + shift), plain.cells, plain.surfaces)
    return promote_to_tet10(mesh) if order == 2 else mesh


@every_order
@every_profile
@settings(max_examples=12, deadline=None)
@given(
    place=st.tuples(st.floats(0.3, 0.7), st.floats(0.3, 0.7)),
    radius=st.floats(0.001, 0.018),
    turn=st.tuples(*[st.floats(-3, 3)] * 3),
)
def test_the_weights_have_the_force_and_the_moments_of_the_pressure(
    order, profile, place, radius, turn
):
    rotation = Rotation.from_rotvec(turn)
    mesh = irregular_block(order, rotation)
    centre = rotation.apply([place[0] * SIZE[0], place[1] * SIZE[1], SIZE[2]])
    direction = rotation.apply(DOWN)
    weights = contact_weights(mesh, Contacts(centre, direction, radius, profile))[0]
    np.testing.assert_allclose(weights.sum(axis=0), direction, atol=1e-12)
    arm = mesh.nodes - centre
    moment = np.cross(arm, weights).sum(axis=0)
    np.testing.assert_allclose(moment, 0, atol=1e-11 * SIZE.max())
    # Quadratic elements reproduce the second moments too
    if order == 2:
        tangents = contact_frame(direction)[:2]
        scalar, local = weights @ direction, arm @ tangents.T
        second = np.einsum("n,na,nb->ab", scalar, local, local)
        expected = SECOND_MOMENT[profile] / 2 * radius**2 * np.eye(2)
        np.testing.assert_allclose(second, expected, atol=1e-10 * SIZE.max() ** 2)


@every_profile
def test_an_inclined_force_keeps_its_direction_and_its_axis(profile):
    mesh = irregular_block(2, Rotation.identity())
    direction = np.array([0.3, -0.2, -1.0]) / np.linalg.norm([0.3, -0.2, -1.0])
    centre = np.array([0.045, 0.035, SIZE[2]])
    weights = contact_weights(mesh, Contacts(centre, direction, 0.006, profile))[0]
    np.testing.assert_allclose(weights.sum(axis=0), direction, atol=1e-12)
    # The resultant passes through the contact point: the disc stands across the direction
    moment = np.cross(mesh.nodes - centre, weights).sum(axis=0)
    np.testing.assert_allclose(moment, 0, atol=1e-13)


@every_profile
def test_only_pressed_faces_carry_weight(profile):
    mesh = block_mesh(SIZE, (9, 7, 3), order=2)
    weights = contact_weights(mesh, Contacts([0.045, 0.035, SIZE[2]], DOWN, 0.008, profile))[0]
    loaded = mesh.nodes[weights.any(axis=1)]
    assert (loaded[:, 2] == SIZE[2]).all()
    assert np.hypot(*(loaded[:, :2] - [0.045, 0.035]).T).max() < 0.008 + 0.01 * np.sqrt(2)


@every_profile
@every_order
def test_a_curved_surface_carries_the_whole_force(profile, order):
    plain = block_mesh(SIZE, (10, 8, 3), order=1)
    nodes = plain.nodes.copy()
    bulge = 0.01 * np.sin(np.pi * nodes[:, 0] / SIZE[0]) * np.sin(np.pi * nodes[:, 1] / SIZE[1])
    nodes[:, 2] += bulge * nodes[:, 2] / SIZE[2]
    mesh = Mesh(nodes, plain.cells, plain.surfaces)
    mesh = promote_to_tet10(mesh) if order == 2 else mesh
    centre = np.array([0.045, 0.035, SIZE[2] + 0.01])
    weights = contact_weights(mesh, Contacts(centre, DOWN, 0.009, profile))[0]
    np.testing.assert_allclose(weights.sum(axis=0), DOWN, atol=1e-12)
    np.testing.assert_allclose(
        np.cross(mesh.nodes - centre, weights).sum(axis=0), 0, atol=1e-4 * SIZE.max()
    )


@pytest.mark.parametrize("profile", [FLAT, HERTZ])
def test_the_disc_rule_integrates_polynomials_against_the_pressure(profile):
    points, weights = disc_quadrature(profile)
    x, y = points.T
    assert weights.min() > 0
    assert np.hypot(x, y).max() < 1
    # int p r^2k dA: 2k!!/(2k+1)!! for the punch, 3 times (2k)!!/(2k+3)!! for Hertz
    fourth = 8 / 15 if profile == FLAT else 8 / 35
    second = 2 / 3 if profile == FLAT else 2 / 5
    for value, expected in (
        (np.ones_like(x), 1), (x, 0), (y, 0), (x * y, 0), (x**3, 0), (x**2, second / 2),
        (y**2, second / 2), (x**4, fourth * 3 / 8), (x**2 * y**2, fourth / 8),
    ):  # fmt: skip
        assert weights @ value == pytest.approx(expected, abs=1e-14)


@every_profile
def test_single_weights_are_those_of_a_much_finer_disc_rule(profile):
    mesh = irregular_block(2, Rotation.identity())
    contacts = Contacts([0.043, 0.036, SIZE[2]], DOWN, 0.005, profile)
    weights = contact_weights(mesh, contacts)[0] @ DOWN
    exact = contact_weights(mesh, contacts, (200, 600))[0] @ DOWN
    assert abs(weights - exact).max() < 1e-3


@pytest.mark.parametrize("direction", [DOWN, -DOWN, (1.0, 0, 0), (0.6, 0, 0.8), (0.48, -0.6, 0.64)])
def test_the_frame_of_a_contact_is_right_handed_with_the_direction_last(direction):
    frame = contact_frame(np.asarray(direction))
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-15)
    np.testing.assert_allclose(frame[2], direction)
    assert np.linalg.det(frame) == pytest.approx(1)


@every_order
def test_a_nodal_force_acts_on_the_one_node_at_the_point(order):
    mesh = block_mesh(SIZE, (3, 2, 2), order=order)
    node = mesh.surface_nodes("top")[[4, 7]]
    contacts = Contacts(mesh.nodes[node] + 1e-5, DOWN, 0.0, "nodal")
    weights = contact_weights(mesh, contacts)
    for j in (0, 1):
        np.testing.assert_array_equal(np.flatnonzero(weights[j].any(axis=1)), [node[j]])
        np.testing.assert_array_equal(weights[j, node[j]], DOWN)


def test_a_nodal_force_between_the_nodes_is_refused():
    mesh = block_mesh(SIZE, (3, 2, 2), order=1)
    points = [mesh.nodes[mesh.surface_nodes("top")[0]], (0.02, 0.02, SIZE[2])]
    with pytest.raises(MeshError, match="press 1: no node within"):
        contact_weights(mesh, Contacts(points, DOWN, 0.0, "nodal"))


@every_profile
@every_order
@pytest.mark.parametrize(
    ("point", "direction"),
    [
        ((0.004, 0.035, 0.05), DOWN),  # over the edge
        ((0.045, 0.0652, 0.05), DOWN),  # by a little
        ((0.2, 0.035, 0.05), DOWN),  # beside the body
        ((0.045, 0.035, 0.09), DOWN),  # above it
        ((0.045, 0.035, 0.025), DOWN),  # inside it
        ((0.045, 0.035, 0.05), -DOWN),  # pulling
    ],
)
def test_a_tip_that_does_not_lie_on_the_surface_is_refused_by_number(
    profile, order, point, direction
):
    mesh = block_mesh(SIZE, (6, 5, 4), order=order)
    contacts = Contacts(
        [(0.045, 0.035, 0.05), point], [DOWN, direction], radius_m=0.005, profile=profile
    )
    with pytest.raises(MeshError, match=r"press 1: the tip of radius 5 mm at .* mm hangs over"):
        contact_weights(mesh, contacts)


@every_profile
def test_a_tip_that_just_fits_is_accepted(profile):
    mesh = block_mesh(SIZE, (6, 5, 4), order=2)
    contacts = Contacts([(0.005, 0.005, 0.05), (0.085, 0.065, 0.05)], DOWN, 0.005, profile)
    np.testing.assert_allclose(
        contact_weights(mesh, contacts).sum(axis=1), [DOWN, DOWN], atol=1e-12
    )


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"profile": "cone"}, "'flat', 'hertz' or 'nodal', got 'cone'"),
        ({"directions": (0, 0, -2)}, "unit vectors"),
        ({"directions": (0, 0, np.nan)}, "unit vectors"),
        ({"radius_m": 0.0}, "radii must be positive"),
        ({"radius_m": np.nan}, "radii must be positive"),
    ],
)
def test_contacts_that_cannot_be_are_refused(change, complaint):
    good = {"points_m": (0, 0, 0), "directions": DOWN, "radius_m": 0.005, "profile": "flat"}
    with pytest.raises(MeshError, match=complaint):
        Contacts(**{**good, **change})


def test_contacts_are_read_only_copies_broadcast_to_the_points():
    points = np.zeros((3, 3))
    contacts = Contacts(points, DOWN, 0.004)
    points += 1
    assert len(contacts) == 3
    assert not contacts.points_m.any()
    np.testing.assert_array_equal(contacts.directions, np.tile(DOWN, (3, 1)))
    np.testing.assert_array_equal(contacts.radius_m, [0.004] * 3)
    for array in (contacts.points_m, contacts.directions, contacts.radius_m):
        assert not array.flags.writeable


def faceted_ball(radius: float, rings: int) -> Surface:
    angle = np.pi * np.arange(2 * rings) / rings
    points, faces, n = [[0.0, 0.0, 1.0]], [], 2 * rings
    for polar in np.pi * np.arange(1, rings) / rings:
        points += [
            [np.sin(polar) * np.cos(a), np.sin(polar) * np.sin(a), np.cos(polar)] for a in angle
        ]
    points.append([0.0, 0.0, -1.0])
    for k in range(n):
        after = (k + 1) % n
        faces.append((0, 1 + k, 1 + after))
        for ring in range(rings - 2):
            a, b = 1 + ring * n, 1 + (ring + 1) * n
            faces += [(a + k, b + k, b + after), (a + k, b + after, a + after)]
        last = 1 + (rings - 2) * n
        faces.append((len(points) - 1, last + after, last + k))
    return Surface(radius * np.array(points), np.array(faces, np.int32))


@pytest.mark.parametrize("share", [0.4, 1.0, 2.0])
def test_the_curvature_is_that_of_the_shape_behind_the_triangles(share):
    radius, rings = 0.04, 24
    surface = faceted_ball(radius, rings)
    width = np.pi * radius / rings
    corners = surface.vertices[surface.triangles[rings * 10 : rings * 12]]
    points = np.vstack([corners.mean(axis=1), corners[:, 0]])
    inwards = -points / np.linalg.norm(points, axis=1)[:, None]
    found = surface_curvature(surface, Contacts(points, inwards, share * width, "hertz"))
    assert found * radius == pytest.approx(1, abs=0.12)
    assert (found * radius).mean() == pytest.approx(1, abs=0.04)


def test_a_side_of_a_block_is_flat_also_beside_an_edge():
    mesh = block_mesh((0.04, 0.04, 0.02), (1, 1, 1))
    block = Surface(mesh.nodes, mesh.boundary[:, :3].astype(np.int32))
    points = np.array([(0.02, 0.02, 0.02), (0.036, 0.02, 0.02)])
    contacts = Contacts(points, np.array([0.0, 0.0, -1.0]), 3e-3, "hertz")
    assert surface_curvature(block, contacts) == pytest.approx(0, abs=1e-6)
