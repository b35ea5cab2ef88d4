"""A skin: the layered half-space, the membrane, both on a body."""

from __future__ import annotations

import numpy as np
import pytest

from fem.contact.contacts import Contacts
from fem.contact.half_space import FLAT, HERTZ, mean_displacement
from fem.errors import MeshError
from fem.linear.assembly import Stiffness
from fem.mesh.block import block_mesh
from fem.mesh.mesh import Mesh, promote_to_tet10
from fem.palpation.layered_half_space import (
    _waves,
    membrane_kernel,
    skin_compliance,
    surface_kernel,
)
from fem.palpation.model import PalpationModel
from fem.palpation.richardson import RefinedModel
from fem.palpation.skin import Membrane
from tests.fem.lab import lab, modulus_of

DOWN = np.array([0.0, 0.0, -1.0])
# kappa of P = 2 E a w kappa/(1 - nu^2) for a/h = .2, from Hayes' integral equation
HAYES = {0.3: 1.2066, 0.4: 1.2323, 0.45: 1.2523, 0.5: 1.2806}

both_profiles = pytest.mark.parametrize("profile", [FLAT, HERTZ])


@pytest.mark.parametrize("nu", [0.0, 0.3, 0.45, 0.5])
def test_a_layer_on_a_rigid_base_has_the_kernel_of_hayes(nu):
    k = np.array([1e-2, 0.3, 1.0, 2.5, 7.0, 20.0])
    m, e = 3 - 4 * nu, np.exp(-2 * k)
    hayes = (m * (1 - e**2) - 4 * k * e) / (m * (1 + e**2) + (4 * k**2 + 1 + m**2) * e)
    np.testing.assert_allclose(surface_kernel(k, 1.0, nu, rigid=True), hayes, rtol=1e-9)


@pytest.mark.parametrize("nu", HAYES)
def test_a_layers_compliance_is_that_of_hayes_table(nu):
    # 1e-4 is what the half-space's pressure makes too soft, and the table's rounding
    xi, squares = _waves(0.2, 1.0, FLAT)
    rest = np.sum(squares * (surface_kernel(xi, 1.0, nu, rigid=True) - 1)) / np.pi
    kappa = (1 - nu**2) / (0.4 * (mean_displacement(0.2, nu, FLAT) + rest * (1 - nu**2)))
    assert kappa == pytest.approx(HAYES[nu], rel=2e-4)


@both_profiles
@pytest.mark.parametrize("nu", [0.3, 0.49])
def test_no_skin_changes_nothing_and_an_endless_one_is_another_half_space(profile, nu):
    whole = mean_displacement(0.005, nu, profile)
    assert abs(skin_compliance(0.005, 1e-3, 1.0, nu, profile).value[0]) < 1e-9 * whole
    assert skin_compliance(0.005, 0.0, 5.0, nu, profile).value[0] == 0
    for factor in (0.3, 5.0):
        missing = []
        for thickness in (0.5, 1.0):
            value = skin_compliance(0.005, thickness, factor, nu, profile).value[0]
            missing.append((1 / factor - 1) - value / whole)
        assert abs(missing[1]) < 0.015 * abs(1 / factor - 1)
        assert missing[0] / missing[1] == pytest.approx(2, rel=0.02)  # like 1/t


@both_profiles
@pytest.mark.parametrize("beyond", [False, True])
def test_the_derivatives_of_the_skins_compliance_are_its_slopes(profile, beyond):
    for t, f in ((1e-3, 5.0), (3e-4, 0.4), (1e-3, 1.01), (3e-3, 12.0)):

        def value(t, f):
            return skin_compliance([0.003, 0.005, 0.003], t, f, 0.45, profile, beyond).value

        found = skin_compliance([0.003, 0.005, 0.003], t, f, 0.45, profile, beyond)
        by_t = (value(t * 1.001, f) - value(t * 0.999, f)) / (0.002 * t)
        by_f = (value(t, f * 1.001) - value(t, f * 0.999)) / (0.002 * f)
        scale = mean_displacement(0.005, 0.45, profile)
        np.testing.assert_allclose(found.by_thickness, by_t, rtol=1e-4, atol=1e-6 * scale / t)
        np.testing.assert_allclose(found.by_factor, by_f, rtol=1e-4, atol=1e-6 * scale)
        assert found.value[0] == found.value[2] != found.value[1]


def test_the_thinnest_skins_fade_out_without_a_step():
    t = np.array([0.0, 2e-7, 4.9e-7, 5.1e-7, 1e-6, 1e-5, 1e-4])
    value = np.array([skin_compliance(0.005, x, 5.0, 0.45).value[0] for x in t])
    assert (np.diff(value) < 0).all()
    assert value[3] - value[2] > -2e-3 * abs(value[-1])


def test_a_soft_half_space_under_a_skin_without_stretch_is_what_a_membrane_makes_of_it():
    # Thin and hard: bending falls like t^3, stretching like t
    nu, wave = 0.3, np.array([0.05, 0.2, 1.0])
    t = 1e-5
    stretch = 0.7  # t (f - 1)
    found = surface_kernel(wave * t, 1 + stretch / t, nu) - 1
    np.testing.assert_allclose(found, membrane_kernel(wave * stretch, nu), rtol=1e-3)
    assert abs(membrane_kernel(wave, 0.5)).max() < 1e-12


@pytest.mark.parametrize("order", [1, 2])
def test_a_membranes_energy_is_that_of_plane_stress(order):
    plain = block_mesh((0.9, 1.1, 0.7), (2, 3, 2), order=1)
    tilt = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    tilt *= np.sign(np.linalg.det(tilt))
    mesh = Mesh(plain.nodes @ tilt.T, plain.cells, plain.surfaces)
    mesh = promote_to_tet10(mesh) if order == 2 else mesh
    nu = 0.37
    stiffness = Stiffness(mesh, nu, ())
    membrane = Membrane(stiffness, "top")
    slope = np.random.default_rng(4).normal(size=(3, 3))
    field = mesh.nodes @ slope.T
    in_plane = tilt[:, :2].T @ (slope + slope.T) / 2 @ tilt[:, :2]
    trace, square = np.trace(in_plane), np.sum(in_plane**2)
    density = ((1 - nu) * square + nu * trace**2) / (1 - nu**2)
    modulus = np.random.default_rng(5).uniform(1, 3, len(stiffness.points_m))
    strains = membrane.strains(field[None])
    energies = np.zeros(len(modulus))
    energies[membrane.samples] = membrane.energies(strains, strains)[0]
    assert energies.sum() == pytest.approx(0.9 * 1.1 * density, rel=1e-10)
    values = membrane.values(modulus)
    u, dofs = field.ravel(), len(stiffness.indptr) - 1
    rows = np.repeat(np.arange(dofs), np.diff(stiffness.indptr))
    double = np.where(rows == stiffness.indices, 1, 2)
    total = np.sum(double * values * u[rows] * u[stiffness.indices])
    assert total == pytest.approx(energies @ modulus, rel=1e-10)
    # Samples that lie next to the top only
    used = stiffness.points_m[energies > 0] @ tilt
    assert used[:, 2].min() > 0.35


@pytest.fixture(scope="module")
def phantom() -> RefinedModel:
    """Every fifth press of the laboratory's scan: edges, corners, inclusion."""
    contacts = Contacts(lab("case_f")[1][::5], DOWN, 0.005)
    size = (0.096, 0.096, 0.048)
    return RefinedModel(
        *(PalpationModel(block_mesh(size, cells), 0.49, contacts)
          for cells in ((8, 8, 4), (12, 12, 6)))
    )  # fmt: skip


def test_a_skinned_phantom_is_felt_as_by_an_independent_solver(phantom):
    body, _, exact = lab("case_f")
    skin = body["skin_layer"]["thickness_m"], body["skin_layer"]["modulus_factor"]
    field = modulus_of(body, phantom.points_m)
    error = phantom.evaluate(field, skin=skin).compliance / exact[::5] - 1
    assert np.sqrt(np.mean(error**2)) < 0.003
    assert abs(error).max() < 0.005
    # The skin itself is 9 %
    assert (phantom.evaluate(field).compliance > 1.05 * exact[::5]).all()


def test_the_derivatives_of_a_skinned_body_pass_taylors_test(phantom):
    model = phantom.coarse
    field = modulus_of(lab("case_f")[0], model.points_m)
    change = field * np.random.default_rng(2).uniform(-1, 1, len(field))
    start = model.evaluate(field, skin=(8e-4, 4.0))
    steps = ((8e-4 * np.array([1, 0, 0]), start.skin_sensitivity[:, 0] * 8e-4),
             (np.array([0, 4.0, 0]), start.skin_sensitivity[:, 1] * 4),
             (np.array([0, 0, 1.0]), start.sensitivity @ change))  # fmt: skip
    for (t, f, e), slope in steps:
        up, down = (
            model.evaluate(field + h * e * change, skin=(8e-4 + h * t, 4 + h * f)).compliance
            for h in (2e-4, -2e-4)
        )
        np.testing.assert_allclose((up - down) / 4e-4, slope, rtol=1e-4)


def test_a_skin_that_is_none_changes_nothing(phantom):
    model = phantom.coarse
    field = modulus_of(lab("case_f")[0], model.points_m)
    bare = model.evaluate(field)
    for skin in ((0.0, 5.0), (1e-3, 1.0)):
        found = model.evaluate(field, skin=skin)
        np.testing.assert_allclose(found.compliance, bare.compliance, rtol=1e-9)
    weak = model.evaluate(field, skin=(1e-3, 1 + 1e-5))
    at_null = model.evaluate(field, skin=(1e-3, 1.0)).skin_sensitivity[:, 1]
    np.testing.assert_allclose((weak.compliance - bare.compliance) / 1e-5, at_null, rtol=1e-3)


def test_an_impossible_skin_is_refused():
    for thickness, factor in ((-1e-3, 5.0), (1e-3, 0.0), (np.nan, 2.0), (1e-3, np.inf)):
        with pytest.raises(MeshError, match="thickness >= 0 m and a modulus factor > 0"):
            skin_compliance(0.005, thickness, factor, 0.45)
    model = PalpationModel(block_mesh((1, 1, 1), (2, 2, 2)), 0.3,
                           Contacts((0.5, 0.5, 1), DOWN, 0.1), skin_surface="hide")  # fmt: skip
    with pytest.raises(MeshError, match="no surface 'hide'"):
        model.evaluate(1.0, skin=(0.01, 2.0))
