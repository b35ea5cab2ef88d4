"""Closed forms of the half-space against integrals of Boussinesq's point force."""

from __future__ import annotations

import numpy as np
import pytest

from fem.contact import half_space
from fem.contact.half_space import FLAT, HERTZ

every_profile = pytest.mark.parametrize("profile", [FLAT, HERTZ])
NU, A = 0.37, 1.3


def pressure(r: float, a: float, profile: int) -> float:
    """Pressure of unit resultant (Johnson, Contact Mechanics, eqs. 3.34 and 3.39)."""
    s = np.sqrt(1 - (r / a) ** 2)
    return 1 / (2 * np.pi * a**2 * s) if profile == FLAT else 3 * s / (2 * np.pi * a**2)


def boussinesq(x: np.ndarray, profile: int, nu: float, points: int = 160) -> np.ndarray:
    """Displacement at x, E = 1: the point force (Johnson, eqs. 3.18) integrated over the disc."""
    s, w = np.polynomial.legendre.leggauss(points)
    r = A * np.sin(np.pi * (s + 1) / 4)  # takes the root out of both pressures
    weight = w * np.pi / 4 * A * np.cos(np.pi * (s + 1) / 4) * r
    weight = weight * [pressure(v, A, profile) for v in r] * 2 * np.pi / points
    angle = 2 * np.pi * (np.arange(points) + 0.5) / points
    dx = x[0] - np.outer(r, np.cos(angle))
    dy = x[1] - np.outer(r, np.sin(angle))
    flat2, z = dx**2 + dy**2, x[2]
    rho = np.sqrt(flat2 + z**2)
    outwards = z / rho**3 - (1 - 2 * nu) / (rho * (rho + z))
    down = z**2 / rho**3 + 2 * (1 - nu) / rho
    scale = (1 + nu) / (2 * np.pi)
    return scale * np.array([np.sum(weight[:, None] * v)
                             for v in (outwards * dx, outwards * dy, down)])  # fmt: skip


def displacement(x: np.ndarray, profile: int, nu: float = NU) -> np.ndarray:
    r = np.hypot(x[0], x[1])
    u_z, u_r = half_space.displacement(r, x[2], A, nu, profile)
    return np.array([u_r * x[0] / r, u_r * x[1] / r, u_z])


def strain(x: np.ndarray, profile: int, nu: float = NU) -> np.ndarray:
    r = np.hypot(x[0], x[1])
    e_zz, e_rr, e_tt, e_rz = half_space.strain(r, x[2], A, nu, profile)
    frame = np.array([[x[0], x[1], 0], [-x[1], x[0], 0], [0, 0, r]]) / r
    return frame.T @ np.array([[e_rr, 0, e_rz], [0, e_tt, 0], [e_rz, 0, e_zz]]) @ frame


def stress(x: np.ndarray, profile: int, nu: float = NU) -> np.ndarray:
    e = strain(x, profile, nu)
    return (e + nu / (1 - 2 * nu) * np.trace(e) * np.eye(3)) / (1 + nu)


PLACES = np.array([(0.4, 0.3, 0.5), (-0.9, 1.1, 0.4), (2.2, -0.7, 0.6), (0.1, -0.05, 2.5)]) * A


def central(function, x: np.ndarray, axis: int, h: float = 2e-3) -> np.ndarray:
    """Fourth-order central difference."""
    step = h * np.eye(3)[axis]
    near, far = (function(x + k * step) - function(x - k * step) for k in (1, 2))
    return (8 * near - far) / (12 * h)


@every_profile
@pytest.mark.parametrize("nu", [0.0, 0.3, 0.49])
def test_the_displacement_is_the_integral_of_point_forces(profile, nu):
    for x in PLACES:
        expected = boussinesq(x, profile, nu)
        np.testing.assert_allclose(
            displacement(x, profile, nu), expected, atol=1e-9 * np.linalg.norm(expected)
        )


@every_profile
def test_the_strain_is_the_symmetric_gradient_of_the_displacement(profile):
    for x in PLACES:
        gradient = np.array([central(lambda y: displacement(y, profile), x, a) for a in range(3)])
        np.testing.assert_allclose(
            strain(x, profile), (gradient + gradient.T) / 2, atol=1e-8 * abs(gradient).max()
        )


@every_profile
def test_the_stress_is_in_equilibrium(profile):
    for x in PLACES:
        parts = np.array([central(lambda y: stress(y, profile), x, a)[a] for a in range(3)])
        np.testing.assert_allclose(parts.sum(axis=0), 0, atol=1e-7 * abs(parts).max())


@every_profile
def test_the_surface_carries_the_pressure_and_nothing_else(profile):
    for r in (0.15, 0.6, 0.93):
        on = stress(A * np.array([r * 0.6, -r * 0.8, 1e-9]), profile)
        scale = pressure(r * A, A, profile)
        np.testing.assert_allclose(on[2], [0, 0, -scale], atol=1e-6 * scale)
    for r in (1.05, 1.6, 4.0):
        free = stress(A * np.array([r * 0.6, -r * 0.8, 1e-9]), profile)
        np.testing.assert_allclose(free[2], 0, atol=1e-6 * scale)


@every_profile
def test_far_away_only_the_force_is_felt(profile):
    r, z = 3e3, 4e3
    rho = np.hypot(r, z)
    u_z, u_r = half_space.displacement(r, z, A, NU, profile)
    scale = (1 + NU) / (2 * np.pi)
    assert u_z == pytest.approx(scale * (z**2 / rho**3 + 2 * (1 - NU) / rho), rel=1e-6)
    expected = scale * (r * z / rho**3 - (1 - 2 * NU) * r / (rho * (rho + z)))
    assert u_r == pytest.approx(expected, rel=1e-6)


def test_a_rigid_punch_sinks_evenly_and_a_sphere_leaves_a_parabola():
    for r in (0.0, 0.31, 0.77, 0.999):
        flat = half_space.displacement(r * A, 0.0, A, NU, FLAT)[0]
        assert flat == pytest.approx((1 - NU**2) / (2 * A), rel=1e-12)
        # Johnson eq. 3.41a: pi p0 (1 - nu^2)/(4 a E) (2 a^2 - r^2), p0 = 3 F/(2 pi a^2)
        sphere = half_space.displacement(r * A, 0.0, A, NU, HERTZ)[0]
        assert sphere == pytest.approx(3 * (1 - NU**2) * (2 - r**2) / (8 * A), rel=1e-12)


@every_profile
def test_the_mean_displacement_is_the_work_of_the_pressure(profile):
    s, w = np.polynomial.legendre.leggauss(40)
    r = A * np.sin(np.pi * (s + 1) / 4)
    measure = 2 * np.pi * r * w * np.pi / 4 * A * np.cos(np.pi * (s + 1) / 4)
    work = sum(
        m * pressure(v, A, profile) * half_space.displacement(v, 0.0, A, NU, profile)[0]
        for m, v in zip(measure, r, strict=True)
    )
    assert half_space.mean_displacement(A, NU, profile) == pytest.approx(work, rel=1e-10)


def test_hertz_is_the_superposition_of_punches():
    s, w = np.polynomial.legendre.leggauss(60)
    radii, share = A * (s + 1) / 2, w / 2 * 3 * ((s + 1) / 2) ** 2
    for r, z in ((0.4, 0.6), (1.9, 0.3), (0.0, 1.2), (0.7, 2.0)):
        for function in (half_space.displacement, half_space.strain):
            parts = np.array([function(r, z, a, NU, FLAT) for a in radii])
            np.testing.assert_allclose(
                function(r, z, A, NU, HERTZ), share @ parts, atol=1e-9 * abs(parts).max()
            )


@every_profile
def test_the_sign_of_a_zero_depth_does_not_matter(profile):
    # Projection onto a tip's frame makes negative zeros; a square root's branch must not see them
    for r in (0.0, 0.5, 1.5):
        below = half_space.displacement(r, 0.0, A, NU, profile)
        assert half_space.displacement(r, -0.0, A, NU, profile) == pytest.approx(below, rel=1e-14)


@every_profile
@pytest.mark.parametrize("a", [1.0, 0.005, 1.3])
def test_the_displacement_is_continuous_at_the_rim(profile, a):
    # A mesh node can lie exactly there; only the strain is singular
    at = half_space.displacement(a, 0.0, a, NU, profile)
    for r, z in ((a * (1 + 1e-10), 0.0), (a * (1 - 1e-10), 0.0), (a, a * 1e-10)):
        near = half_space.displacement(r, z, a, NU, profile)
        np.testing.assert_allclose(at, near, rtol=1e-4)


def outward(x: np.ndarray) -> np.ndarray:
    r = np.hypot(x[0], x[1])
    u_z, u_r = half_space.outward(r, x[2], A, NU)[:2]
    return np.array([u_r * x[0] / r, u_r * x[1] / r, u_z])


def outward_gradient(x: np.ndarray, step: float = 1e-5) -> np.ndarray:
    steps = step * np.eye(3)
    return np.array([outward(x + h) - outward(x - h) for h in steps]).T / (2 * step)


def outward_stress(x: np.ndarray) -> np.ndarray:
    gradient = outward_gradient(x)
    strain = (gradient + gradient.T) / 2
    return (strain + NU / (1 - 2 * NU) * np.trace(strain) * np.eye(3)) / (1 + NU)


@pytest.mark.parametrize("place", [(0.4, 0.3), (0.9, 0.2), (1.7, 0.8)])
def test_the_outward_traction_is_the_flat_pressure_times_the_distance(place):
    r, z = A * np.array(place)
    x = np.array([r, 0.0, z])
    gradient = outward_gradient(x)
    np.testing.assert_allclose(
        half_space.outward(r, z, A, NU)[2:],
        [gradient[2, 2], gradient[2, 0], gradient[0, 2], gradient[0, 0], gradient[1, 1]],
        rtol=1e-6, atol=1e-8 * abs(gradient).max(),
    )  # fmt: skip
    steps = 1e-3 * A * np.eye(3)
    force = sum((outward_stress(x + h) - outward_stress(x - h))[:, i] for i, h in enumerate(steps))
    assert np.abs(force).max() < 1e-4 * np.abs(outward_stress(x)).max()
    surface = outward_stress(np.array([r, 0.0, 2e-5 * A]))
    expected = r * pressure(r, A, FLAT) if r < A else 0.0
    scale = A * pressure(0.0, A, FLAT)
    assert -surface[0, 2] == pytest.approx(expected, abs=1e-3 * scale)
    assert surface[2, 2] == pytest.approx(0, abs=1e-3 * scale)
