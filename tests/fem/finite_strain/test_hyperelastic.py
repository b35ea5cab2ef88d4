"""Hyperelastic laws at a point: textbook closed forms, objectivity, energy-stress-tangent."""

import numpy as np
import pytest
from scipy.optimize import brentq

from fem.errors import MeshError
from fem.finite_strain.hyperelastic import Fung, NeoHookean, Yeoh
from fem.linear.assembly import lame
from tests.fem.reference.material_point import material_point

# a law with its textbook dW/dI1 for the incompressible body, in units of mu/2
LAWS = [
    (NeoHookean(), lambda i1: 1.0),
    (Yeoh(0.3), lambda i1: 1 + 2 * 0.3 * (i1 - 3)),
    (Fung(0.5), lambda i1: np.exp(0.5 * (i1 - 3))),
]
NU = 0.37
STRETCHES = (0.6, 0.9, 1.05, 1.7)
every_law = pytest.mark.parametrize(("law", "slope"), LAWS, ids=lambda x: type(x).__name__)


def random_deformations(count: int = 5) -> np.ndarray:
    f = np.eye(3) + np.random.default_rng(4).uniform(-0.35, 0.35, (count, 3, 3))
    assert (np.linalg.det(f) > 0.2).all()
    return f


def random_rotation(seed: int) -> np.ndarray:
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q * np.sign(np.linalg.det(q))


def free_sides(law, nu: float, stretches) -> tuple[np.ndarray, np.ndarray]:
    """Stress at given stretches (one or two) with the other sides free: F and P."""

    def stress(side: float) -> tuple[np.ndarray, np.ndarray]:
        f = np.diag([*stretches, *[side] * (3 - len(stretches))])
        return f, material_point(law, nu, f[None]).stress[0]

    side = brentq(lambda s: stress(s)[1][2, 2], 0.3, 3.0, xtol=1e-15)
    return stress(side)


@every_law
@pytest.mark.parametrize("stretch", STRETCHES)
def test_uniaxial_tension_is_that_of_the_incompressible_law(law, slope, stretch):
    # P = 2 dW/dI1 (l - 1/l^2); Poisson's ratio so near 1/2 that the volume does not change
    nu = 0.5 - 1e-9
    f, p = free_sides(law, nu, [stretch])
    assert np.linalg.det(f) == pytest.approx(1, abs=1e-5)
    mu = 1 / (2 * (1 + nu))
    i1 = stretch**2 + 2 / stretch
    assert p[0, 0] == pytest.approx(mu * slope(i1) * (stretch - stretch**-2), rel=3e-5)


@every_law
@pytest.mark.parametrize("stretch", STRETCHES)
def test_equibiaxial_tension_is_that_of_the_incompressible_law(law, slope, stretch):
    nu = 0.5 - 1e-9
    _, p = free_sides(law, nu, [stretch, stretch])
    mu = 1 / (2 * (1 + nu))
    i1 = 2 * stretch**2 + stretch**-4
    expected = mu * slope(i1) * (stretch - stretch**-5)
    np.testing.assert_allclose(np.diag(p)[:2], expected, rtol=3e-5)


@every_law
@pytest.mark.parametrize("shear", [0.01, 0.4, -1.2])
def test_simple_shear_is_exact_at_any_poisson_ratio(law, slope, shear):
    # J = 1: Cauchy stress s12 = 2 dW/dI1 g, s11 - s22 = g s12 (Rivlin), I1 = 3 + g^2
    f = np.eye(3)
    f[0, 1] = shear
    cauchy = material_point(law, NU, f[None]).stress[0] @ f.T
    mu = 1 / (2 * (1 + NU))
    expected = mu * slope(3 + shear**2) * shear
    assert cauchy[0, 1] == pytest.approx(expected, rel=1e-12)
    assert cauchy[0, 0] - cauchy[1, 1] == pytest.approx(shear * expected, rel=1e-12)


@every_law
def test_compressible_uniaxial_tension_satisfies_the_principal_equations(law, slope):
    # W = mu/2 g(Q) + lambda/2 (ln J)^2 in principal stretches: l_i P_i = dW/d(ln l_i)
    lam, mu = lame(NU)
    f, p = free_sides(law, NU, [1.6])
    stretches = np.diag(f)
    log_j = np.log(stretches).sum()
    q = (stretches**2 - 1).sum() - 2 * log_j
    expected = mu * slope(3 + q) * (stretches**2 - 1) + lam * log_j
    np.testing.assert_allclose(stretches * np.diag(p), expected, atol=1e-13)
    assert stretches[1] < 1


@every_law
def test_the_stress_turns_with_the_body_and_the_material_has_no_direction(law, slope):
    f, turn = random_deformations(), random_rotation(7)
    point = material_point(law, NU, f)
    turned = material_point(law, NU, turn @ f)
    np.testing.assert_allclose(turned.energy, point.energy, rtol=1e-12)
    np.testing.assert_allclose(turned.stress, turn @ point.stress, atol=1e-12)
    within = material_point(law, NU, f @ turn.T)
    np.testing.assert_allclose(within.stress, point.stress @ turn.T, atol=1e-12)
    kirchhoff = point.stress @ f.swapaxes(1, 2)
    np.testing.assert_allclose(kirchhoff, kirchhoff.swapaxes(1, 2), atol=1e-13)


@every_law
def test_stress_and_tangent_are_derivatives_of_the_energy(law, slope):
    f, step = random_deformations(), 1e-5
    point = material_point(law, NU, f)
    for i in range(3):
        for j in range(3):
            move = np.zeros((3, 3))
            move[i, j] = step
            up, down = material_point(law, NU, f + move), material_point(law, NU, f - move)
            energy = (up.energy - down.energy) / (2 * step)
            stress = (up.stress - down.stress) / (2 * step)
            np.testing.assert_allclose(point.stress[:, i, j], energy, rtol=1e-7, atol=1e-8)
            np.testing.assert_allclose(point.tangent[:, :, :, i, j], stress, rtol=1e-7, atol=1e-7)


@every_law
def test_small_strain_is_hookes_law_and_rest_is_free_of_stress(law, slope):
    point = material_point(law, NU, np.eye(3)[None])
    assert point.energy[0] == 0
    np.testing.assert_array_equal(point.stress[0], np.zeros((3, 3)))
    strain = np.diag([1.0, -NU, -NU])  # of a bar with E = 1 that is pulled
    stress = np.einsum("iJkL,kL->iJ", point.tangent[0], strain)
    np.testing.assert_allclose(stress, np.diag([1.0, 0, 0]), atol=1e-14)


def test_laws_without_stiffening_are_neo_hookean():
    f = random_deformations()
    plain = material_point(NeoHookean(), NU, f)
    for law in (Yeoh(0.0), Fung(0.0)):
        point = material_point(law, NU, f)
        np.testing.assert_allclose(point.energy, plain.energy, rtol=1e-14)
        np.testing.assert_allclose(point.tangent, plain.tangent, rtol=1e-14)


@pytest.mark.parametrize("make", [Yeoh, Fung])
@pytest.mark.parametrize("bad", [-0.1, np.nan, np.inf])
def test_softening_coefficients_are_refused(make, bad):
    with pytest.raises(MeshError, match="stiffening coefficient"):
        make(bad)


def test_matter_turned_inside_out_is_refused():
    with pytest.raises(MeshError, match="inside out"):
        material_point(NeoHookean(), NU, np.diag([1.0, 1.0, -0.1])[None])
