"""The exact near field of a press against closed forms, tables and an independent solver.

A bonded elastic layer under the punch pressure of a half-space has a compliance in closed form up
to one integral (`layer_compliance`); what the finite elements give must be that. Hayes' kappa is
the layer under a truly rigid punch, whose pressure differs the more, the thinner the layer is:
the assumed pressure alone makes the compliance up to 3 % too high at a = h, nu = 0.45.
"""

from __future__ import annotations

import numpy as np
import pytest

from fem.contact import half_space
from fem.contact.contacts import Contacts
from fem.contact.half_space import FLAT, HERTZ
from fem.linear.assembly import lame
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.near_field import points as near_field_points
from fem.palpation.model import PalpationModel
from tests.fem.lab import lab, modulus_of

DOWN = (0.0, 0.0, -1.0)
# kappa of P = 2 E a w kappa/(1 - nu^2), from Hayes' integral equation; a/h, then nu = .3, .4, .45
HAYES = {
    0.2: (1.2066, 1.2323, 1.2523),
    0.4: (1.4726, 1.5422, 1.5993),
    0.6: (1.7848, 1.9178, 2.0328),
    0.8: (2.1260, 2.3402, 2.5354),
    1.0: (2.4835, 2.7938, 3.0914),
}
RATIOS = (0.3, 0.4, 0.45)
TABLE = [(a, nu, k) for a, row in HAYES.items() for nu, k in zip(RATIOS, row, strict=True)]
# How much too soft the half-space's pressure makes the layer, measured with `layer_compliance`
PRESSURE_SHAPE = {0.2: 1e-4, 0.4: 5e-4, 0.6: 4e-3, 0.8: 1.3e-2, 1.0: 2.9e-2}


def layer_compliance(a: float, nu: float, profile: str = "flat") -> float:
    """Compliance for E = 1 of a bonded layer of height 1 under a half-space's contact pressure.

    C = (1 - nu^2)/pi int_0^inf L(k) p(k a)^2 dk with the layer's kernel L (Hayes et al., J.
    Biomech. 5, 1972) and the Hankel transform p of the pressure: sin x/x, or
    3 (sin x - x cos x)/x^3.
    """
    node, weight = np.polynomial.legendre.leggauss(30)
    edges = np.linspace(0, 40, 81)  # L - 1 vanishes beyond
    k = ((edges[1:] + edges[:-1])[:, None] / 2 + node / 4).ravel()
    m, e = 3 - 4 * nu, np.exp(-2 * k)
    kernel = (m * (1 - e**2) - 4 * k * e) / (m * (1 + e**2) + (4 * k**2 + 1 + m**2) * e)
    x = k * a
    transform = np.sin(x) / x if profile == "flat" else 3 * (np.sin(x) - x * np.cos(x)) / x**3
    rest = np.tile(weight / 4, 80) @ ((kernel - 1) * transform**2) / np.pi
    return (1 - nu**2) * ((0.5 if profile == "flat" else 0.6) / a + rest)


def layer(width: float, divisions: tuple[int, int, int], order: int = 2) -> Mesh:
    """Wide block of height 1, the cells drawn to the origin in the middle of its top."""
    plain = block_mesh((2, 2, 1), divisions, order=1)
    flat = width / 2 * np.sinh(2 * (plain.nodes[:, :2] - 1)) / np.sinh(2)
    nodes = np.column_stack([flat, plain.nodes[:, 2] - 1])
    mesh = Mesh(nodes, plain.cells, plain.surfaces)
    return promote_to_tet10(mesh) if order == 2 else mesh


def compliance(mesh: Mesh, nu: float, contacts: Contacts, modulus=1.0, near_field=True):
    model = PalpationModel(mesh, nu, contacts, near_field=near_field)
    field = modulus(model.points_m) if callable(modulus) else modulus
    return model.evaluate(field).compliance


def test_the_layers_integral_is_hayes_where_the_pressure_is_right():
    for a, nu, kappa in TABLE:
        too_soft = layer_compliance(a, nu) * 2 * a * kappa / (1 - nu**2) - 1
        # Never stiffer: the true pressure is the one of least energy. 1e-4 is the table's rounding
        assert -1e-4 < too_soft < PRESSURE_SHAPE[a] + 1e-4, (a, nu)
    for profile, share in (("flat", 0.5), ("hertz", 0.6)):
        thick = layer_compliance(1e-3, 0.3, profile)
        assert thick == pytest.approx(share * (1 - 0.3**2) / 1e-3, rel=2e-3)


@pytest.mark.parametrize(("a", "nu", "kappa"), TABLE)
def test_a_flat_punch_on_a_layer_has_the_stiffness_of_theory(a, nu, kappa):
    found = compliance(layer(2 * a + 6, (8, 8, 3)), nu, Contacts((0, 0, 0), DOWN, a))[0]
    assert found == pytest.approx(layer_compliance(a, nu), rel=0.005)
    too_soft = found * 2 * a * kappa / (1 - nu**2) - 1
    assert -0.005 < too_soft < PRESSURE_SHAPE[a] + 0.005


@pytest.mark.parametrize("profile", ["flat", "hertz"])
@pytest.mark.parametrize("a", [0.15, 0.5])
def test_a_nearly_incompressible_layer_is_within_one_percent(profile, a):
    contacts = Contacts((0, 0, 0), DOWN, a, profile)
    found = compliance(layer(2 * a + 6, (8, 8, 4)), 0.49, contacts)[0]
    assert found == pytest.approx(layer_compliance(a, 0.49, profile), rel=0.01)


# kappa for nu = 1/2, from Hayes' integral equation
@pytest.mark.parametrize(("a", "kappa"), [(0.2, 1.2806), (0.4, 1.6837)])
def test_up_to_the_incompressible_limit_a_layer_is_within_half_a_percent(a, kappa):
    mesh = layer(2 * a + 6, (8, 8, 4))
    contacts = Contacts((0, 0, 0), DOWN, a)
    for nu in (0.495, 0.4999):
        found = compliance(mesh, nu, contacts)[0]
        assert found == pytest.approx(layer_compliance(a, nu), rel=0.006)
    assert found == pytest.approx((1 - 0.5**2) / (2 * a * kappa), rel=0.01)


def test_the_volume_of_the_cells_does_not_lock_them():
    # Bent beside the tip, without the near field: what is left is the cells' own stiffness
    mesh = block_mesh((2, 1, 1), (4, 2, 2))
    contacts = Contacts((1.6, 0.5, 1), DOWN, 0.3)
    bending = [
        PalpationModel(mesh, nu, contacts, "x0", near_field=False).evaluate(1.0).compliance[0]
        for nu in (0.49, 0.499, 0.4999, 0.49999)
    ]
    change = -np.diff(bending) / bending[0]
    assert change[0] < 0.02
    assert change[1] < 0.2 * change[0]
    assert change[2] < 0.2 * change[1]


@pytest.mark.parametrize("profile", ["flat", "hertz"])
def test_a_body_grows_into_the_half_space_like_one_over_its_height(profile):
    nu, a = 0.3, np.array([0.2, 0.1, 0.05])
    found = [
        compliance(layer(8, (8, 8, 4)), nu, Contacts((0, 0, 0), DOWN, radius, profile))[0]
        for radius in a
    ]
    unbounded = (0.5 if profile == "flat" else 0.6) * (1 - nu**2) / a
    missing = 1 - found / unbounded
    assert missing[-1] < 0.055
    np.testing.assert_allclose(missing[:-1] / missing[1:], 2, atol=0.15)


@pytest.mark.parametrize("order", [1, 2])
def test_the_near_field_makes_a_coarse_mesh_right_that_is_far_off_without(order):
    # Cells four times as wide as the tip
    mesh = block_mesh((8, 8, 4), (10, 10, 5), order=order)
    contacts = Contacts((4, 4, 4), DOWN, 0.2)
    exact = layer_compliance(0.05, 0.3) * 1 / 4
    bare = compliance(mesh, 0.3, contacts, near_field=False)[0]
    assert bare < 0.75 * exact
    assert compliance(mesh, 0.3, contacts)[0] == pytest.approx(exact, rel=0.01)


PLANE = np.zeros(7)
BENT = np.array([-0.02, 0.1, -0.05, 0.06, 0.03, -0.04, 0.02])  # a saddle, tilted; levels out


@pytest.mark.parametrize("shape", [PLANE, BENT])
@pytest.mark.parametrize("profile", [FLAT, HERTZ])
def test_the_strains_of_the_added_functions_are_the_gradients_of_v_times_1_x_y_z(profile, shape):
    a, nu = 1.3, 0.37
    lam, mu = lame(nu)

    def functions(x: np.ndarray) -> np.ndarray:
        def surface(y: np.ndarray) -> float:
            bent = shape[3:6] @ [y[0] ** 2, y[0] * y[1], y[1] ** 2]
            return shape[:3] @ [1, *y] + bent / np.sqrt(1 + shape[6] * (y @ y) ** 2)

        depth = x[2] - surface(x[:2])
        near = 1e-5 * np.eye(2)
        slope = np.array([surface(x[:2] + h) - surface(x[:2] - h) for h in near]) / 2e-5
        foot = x[:2] + depth * slope  # of the normal through x
        r = np.hypot(*foot)
        u_z, u_r = half_space.displacement(r, depth, a, nu, profile)
        if profile == FLAT:  # the press along the axis pulls a bent surface outwards
            more = half_space.outward(r, depth, a, nu)
            u_z, u_r = np.array([u_z, u_r]) + (shape[3] + shape[5]) * np.array(more[:2])
        across = u_r * foot / r
        v = np.array([*(across - slope * u_z), u_z + slope @ across])
        factors = [1, x[0] / a, x[1] / a, depth / a]
        np.testing.assert_allclose(
            near_field_points.functions(x[None], shape, a, nu, profile)[0], np.outer(factors, v)
        )
        return np.outer(factors, v)

    above = [(-2.2, 0.6, -0.4)]  # beside the tip the functions go on above the plane
    for x in [(0.4, 0.9, 0.5), (-1.7, 0.6, 0.8), *above]:
        strain, density = np.zeros((10, 4 * 6)), np.zeros((10, 4))
        corner = np.array([1.0, 0, 0, 0])
        batch = near_field_points.batch_of_points(10, 4, 10)
        near_field_points.put_point(batch, 0, np.array(x), 1.0, corner)
        near_field_points.add_batch(
            batch, 1, strain, density, shape, a, nu, profile, lam, mu, np.zeros((0, 6))
        )
        steps = 1e-4 * np.eye(3)
        slope = np.array([functions(x + h) - functions(x - h) for h in steps]) / 2e-4
        gradient = slope.transpose(1, 2, 0)
        expected = (gradient + gradient.swapaxes(1, 2)) / 2
        pairs = np.array([(0, 0), (1, 1), (2, 2), (0, 1), (0, 2), (1, 2)])
        found = strain[0].reshape(4, 6)
        np.testing.assert_allclose(
            found, expected[:, pairs[:, 0], pairs[:, 1]], atol=1e-6 * abs(expected).max()
        )
        stress = 2 * mu * expected + lam * np.einsum("maa->m", expected)[:, None, None] * np.eye(3)
        energy = np.einsum("mab,lab->ml", stress, expected)
        half = np.tril_indices(4)
        np.testing.assert_allclose(density[:, 0], energy[half], atol=1e-5 * abs(energy).max())


def hill(cells: int, bend: float, tilt: float) -> Mesh:
    """A block 8 x 8 x 4 whose top is curved and tilted, from cells cut at the same places."""
    block = block_mesh((8, 8, 4), (cells, cells, cells // 2), order=1)
    nodes = block.nodes.copy()
    x, y = nodes[:, 0] - 4, nodes[:, 1] - 4
    nodes[:, 2] *= 1 + (tilt * x - bend * (x * x + 0.5 * y * y)) / 4
    return promote_to_tet10(Mesh(nodes, block.cells, block.surfaces))


@pytest.mark.parametrize(("bend", "tilt"), [(0.05, 0.0), (-0.05, 0.0), (0.03, 0.3)])
def test_on_a_curved_or_tilted_surface_a_coarse_mesh_with_near_field_is_right_too(bend, tilt):
    # Dome, hollow, slope; radius of curvature 10 to 17 tip radii. The meshes' tops are facets.
    tangent = np.array([1, 0, tilt]) / np.hypot(1, tilt)
    direction = (tangent[2], 0.0, -tangent[0])
    contacts = Contacts((4, 4, 4), direction, 0.6)
    coarse, fine = (compliance(hill(n, bend, tilt), 0.45, contacts)[0] for n in (8, 11))
    bare = compliance(hill(11, bend, tilt), 0.45, contacts, near_field=False)[0]
    assert bare < 0.95 * fine
    assert coarse == pytest.approx(fine, rel=0.01)


def soft_and_hard(x: np.ndarray) -> np.ndarray:
    """A modulus with strong gradients."""
    return 1 + 4 * np.exp(-((x - [0.8, 1.1, 0.7]) ** 2).sum(axis=1) / 0.18) + 0.2 * x[:, 0]


def some_presses() -> Contacts:
    rng = np.random.default_rng(5)
    points = np.column_stack([rng.uniform(0.35, 1.65, (5, 2)), np.ones(5)])
    return Contacts(points, DOWN, rng.uniform(0.08, 0.3, 5))


@pytest.mark.parametrize("order", [1, 2])
def test_the_near_field_always_raises_the_compliance(order):
    mesh = block_mesh((2, 2, 1), (6, 6, 3), order=order)
    for modulus in (1.0, soft_and_hard):
        bare = compliance(mesh, 0.4, some_presses(), modulus, near_field=False)
        assert (compliance(mesh, 0.4, some_presses(), modulus) > 1.03 * bare).all()


@pytest.mark.parametrize("near_field", [False, True])
def test_the_compliance_rises_as_each_space_of_functions_holds_the_one_before(near_field):
    spaces = [block_mesh((2, 2, 1), (n, n, n // 2), order=o) for n, o in ((4, 1), (4, 2), (8, 2))]
    found = [compliance(mesh, 0.4, some_presses(), near_field=near_field) for mesh in spaces]
    assert (np.diff(found, axis=0) > 0).all()


def test_a_tip_whose_rim_passes_through_nodes_is_like_one_beside():
    # Vertices and mid-edge nodes lie exactly on the rim of the first
    mesh = block_mesh((2, 2, 1), (8, 8, 4))
    exact, beside = compliance(
        mesh, 0.4, Contacts([(1, 1, 1), (1, 1, 1)], DOWN, [0.25, 0.25 * (1 + 1e-7)])
    )
    assert exact == pytest.approx(beside, rel=1e-4)


@pytest.fixture(scope="module")
def lab_model() -> PalpationModel:
    """Every second press of the laboratory's scan, in a checkerboard."""
    points = lab("case_a")[1][::2]
    mesh = block_mesh((0.096, 0.096, 0.048), (12, 12, 6))
    return PalpationModel(mesh, 0.49, Contacts(points, DOWN, 0.005))


@pytest.mark.parametrize("case", ["case_a", "case_e", "case_k"])
def test_an_inclusion_is_felt_as_by_an_independent_solver(case, lab_model):
    body, points, exact = lab(case)
    side = np.linspace(0.012, 0.084, 9)
    np.testing.assert_allclose(
        points, [(x, y, 0.048) for y in side for x in side], atol=1e-9
    )  # x runs fastest
    error = lab_model.evaluate(modulus_of(body, lab_model.points_m)).compliance / exact[::2] - 1
    assert np.sqrt(np.mean(error**2)) < 0.005
    assert abs(error).max() < 0.01


def test_cells_flatter_than_the_rims_quadrature_still_get_their_own_part_of_it():
    # Two presses at almost the same place on a hard layer of one flat cell: the layer's boundary
    # cuts the tube around the rim, whose points must not be dealt out by chance.
    mesh = block_mesh((2, 2, 1), (10, 10, 5), levels_m=[*np.linspace(0, 0.95, 5), 1])
    contacts = Contacts([(1, 1, 1), (1.03, 0.97, 1)], DOWN, 0.208)
    layered = PalpationModel(mesh, 0.49, contacts)
    modulus = np.where(layered.points_m[:, 2] > 0.95, 5.0, 1.0)
    one, other = layered.evaluate(modulus).compliance
    assert one == pytest.approx(other, rel=2e-3)


def test_a_tip_beside_an_edge_is_pressed_alike_on_coarse_and_fine_cells():
    # Rim 2 mm from the edge: nodes of the side face lie closer to the tip the finer the cells
    contacts = Contacts((12.0, 24.0, 24.0), DOWN, 10.0)
    meshes = (
        block_mesh((48, 48, 24), (6, 6, 3)),
        block_mesh((48, 48, 24), (8, 8, 4), split="alternating"),
        block_mesh((48, 48, 24), (12, 12, 6)),
    )
    found = [compliance(mesh, 0.3, contacts)[0] for mesh in meshes]
    np.testing.assert_allclose(found[:-1], found[-1], rtol=0.005)


def test_a_modulus_that_varies_within_a_cell_leaves_the_compliance_a_lower_bound():
    """Near field and finite elements of different moduli would make a coarse mesh too soft here.

    The tip lies beside an inclusion of 8 mm, six times as stiff, in cells of 12 mm. With the
    modulus linear in the one and quadratic in the other, 8 x 8 x 4 cells were 3.7 % softer than
    12 x 12 x 6, where all other meshes are stiffer the coarser they are.
    """
    press = Contacts(np.array([[0.048, 0.057, 0.048]]), np.array([[0, 0, -1.0]]), np.array([0.005]))
    found = []
    for cells in ((8, 8, 4), (10, 10, 5), (12, 12, 6)):
        model = PalpationModel(block_mesh((0.096, 0.096, 0.048), cells), 0.49, press)
        away = model.points_m - [0.0418, 0.0459, 0.0388]
        modulus = 6960 + 34300 * np.exp(-np.sum(away**2, axis=1) / (2 * 0.0082**2))
        found.append(float(model.evaluate(modulus).compliance[0]))
    assert found[0] < found[1] < found[2]
    assert found[0] > 0.975 * found[2]


def test_a_ball_on_the_edge_of_two_facets_feels_no_harder_body():
    # A facet's slope of 0.1 either side; cells five times as wide as the contact
    a, nu, found = 0.0024, 0.45, []
    for slope in (0.0, 0.1):
        flat = block_mesh((0.1, 0.1, 0.03), (8, 8, 2), order=2)
        x, y, z = flat.nodes.T
        lowered = z * (1 - slope * np.abs(x - 0.05) / 0.03)
        roof = Mesh(np.column_stack([x, y, lowered]), flat.cells, flat.surfaces)
        found.append(compliance(roof, nu, Contacts((0.05, 0.0512, 0.03), DOWN, a, "hertz"))[0])
    # With finer cells (24 x 24 x 8) the edge makes it 0.4 % stiffer
    assert found[1] == pytest.approx(found[0], rel=0.06)
