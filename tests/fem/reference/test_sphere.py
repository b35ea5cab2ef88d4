"""The law of a sphere against Sneddon, the exact contact of a layer, and its own differences."""

from __future__ import annotations

import numpy as np
import pytest

from fem.contact import half_space
from fem.contact.contacts import disc_quadrature
from fem.contact.half_space import FLAT, HERTZ
from tests.fem.reference.hayes import layer_transfer, punch_factor, sphere_on_layer
from tests.fem.reference.sphere import (
    depth_logarithm,
    far_coefficients,
    far_from_flat,
    sphere_travel,
)

E, NU, R = 7e3, 0.45, 5e-3
K = (1 - NU**2) / E
TINY = 1e-12  # N, where the line to the origin ends


def hertz_compliance(a: float, h: float) -> float:
    """Compliance of a layer of unit k under Hertz' pressure, by its transform."""
    x, w = np.polynomial.legendre.leggauss(600)
    x, w = 15 * (x + 1), 15 * w  # wave numbers times h
    s = x * a / h
    transform = 3 * (np.sin(s) - s * np.cos(s)) / s**3
    return 0.6 / a + float(w @ ((layer_transfer(x, NU) - 1) * transform**2)) / (np.pi * h)


def layer_far(radii: np.ndarray, h: float) -> np.ndarray:
    compliance = [[K * hertz_compliance(a, h) for a in radii]]
    return far_coefficients(radii, np.array(compliance), np.array([K]))


@pytest.mark.parametrize("share", [0.02, 0.3, 0.6, 0.95])
def test_on_a_half_space_the_sphere_is_sneddons(share):
    exact = sphere_on_layer(share * R, R, E, NU)
    found = sphere_travel(np.array([exact.force_n]), R, K, np.array([0.0]), smallest_n=TINY)
    assert found.radius_m[0] == pytest.approx(share * R, rel=1e-9)
    assert found.travel_m[0] == pytest.approx(exact.travel_m, rel=1e-9)
    assert found.slope[0] == pytest.approx(K / (2 * share * R), rel=1e-9)


@pytest.mark.parametrize(
    ("h", "share", "error"),
    [
        (0.048, 0.6, 1e-4),
        (0.02, 0.6, 3e-4),
        (0.01, 0.6, 1e-3),
        (0.005, 0.4, 5e-3),
        (0.005, 0.6, 6e-3),
    ],
)
def test_on_a_layer_the_travel_is_right_to_the_order_of_the_pressures_shape(h, share, error):
    # The second-order error grows with (a/h)^6 or so; here a/h is up to 0.6
    exact = sphere_on_layer(share * R, R, E, NU, h)
    far = layer_far(0.7 * R * np.array([1, 0.5, 0.25]), h)
    found = sphere_travel(np.array([exact.force_n]), R, K, far, smallest_n=TINY)
    assert found.travel_m[0] == pytest.approx(exact.travel_m, rel=error)
    ignored = sphere_travel(np.array([exact.force_n]), R, K, np.array([0.0]), smallest_n=TINY)
    assert abs(ignored.travel_m[0] / exact.travel_m - 1) > 10 * error


def test_a_flat_tips_compliance_gives_the_travel_on_a_thick_layer():
    h, flat = 0.048, 5e-3
    compliance = K / (2 * flat * punch_factor(flat / h, NU))
    far = far_from_flat(np.array([compliance]), np.array([flat]), np.array([K]))
    for share in (0.2, 0.6):
        exact = sphere_on_layer(share * R, R, E, NU, h)
        found = sphere_travel(np.array([exact.force_n]), R, K, far, smallest_n=TINY)
        assert found.travel_m[0] == pytest.approx(exact.travel_m, rel=1e-3)
        # as the docstring's closed formula, but for the sphere's depth
        a = np.cbrt(0.75 * exact.force_n * R * K)
        closed = a**2 / R + exact.force_n * (compliance - K / (2 * flat))
        assert closed == pytest.approx(exact.travel_m, rel=0.01 if share < 0.3 else 0.1)


def test_every_derivative_is_the_difference_of_travels():
    force, far = np.array([0.003, 0.02, 0.08]), np.array([-0.01, 2.0, -300.0])
    log, start = 1e-3, 4e-3

    def travel(q: np.ndarray) -> np.ndarray:
        return sphere_travel(
            force * q[0], R * q[1], K * q[2], far * q[3:6], log * q[6], start
        ).travel_m

    exact = sphere_travel(force, R, K, far, log, start)
    expected = np.column_stack([
        exact.slope * force, exact.d_radius * R, exact.d_near * K, exact.d_far * far,
        exact.d_log * log,
    ])  # fmt: skip
    for i in range(7):
        step = 1e-4 * np.eye(7)[i]
        difference = (travel(1 + step) - travel(1 - step)) / 2e-4
        # 1e-12 m: rounding of travels of a millimetre, over the step
        np.testing.assert_allclose(difference, expected[:, i], rtol=1e-6, atol=1e-11)


def test_the_logarithm_is_that_of_a_modulus_that_rises_with_depth():
    # First order: dC = -int dE eps:D:eps of the half-space's own field, E' = dE/dz
    def energy(a: float, reach: float = 60.0) -> float:
        x, w = np.polynomial.legendre.leggauss(90)
        depth, around = reach ** ((x + 1) / 2) - 1, reach ** ((x + 1) / 2) - 1
        measure = w / 2 * np.log(reach) * (depth + 1)
        total = 0.0
        for z, wz in zip(depth * a, measure * a, strict=True):
            e = np.array([half_space.strain(r, z, a, NU, HERTZ) for r in around * a])
            trace = e[:, :3].sum(axis=1)
            density = (
                NU / (1 - 2 * NU) * trace**2 + (e[:, :3] ** 2).sum(axis=1) + 2 * e[:, 3] ** 2
            ) / (1 + NU)
            total += wz * z * np.sum(measure * a * 2 * np.pi * around * a * density)
        return total

    # Lengths cut off at 60 a: between a = 1 and 2 with the same cut the difference is -l ln 2
    inner, outer = energy(1.0, 80.0), energy(2.0, 40.5)
    expected = depth_logarithm(np.array([1 - NU**2]), np.array([1.0]), NU)[0] * np.log(2)
    assert inner - outer == pytest.approx(expected, rel=0.01)


def test_a_hertz_contact_is_a_quarter_closer_to_itself_than_a_flat_one():
    def mean_log(first: int, second: int) -> float:
        # the same disc at two angles, so that no two points meet
        (x, p), (y, q) = disc_quadrature(first), disc_quadrature(second)
        turn = np.pi / 32
        y = y @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        return float(p @ np.log(np.linalg.norm(x[:, None] - y, axis=2)) @ q)

    assert mean_log(HERTZ, HERTZ) - mean_log(FLAT, FLAT) == pytest.approx(-0.25, abs=0.01)


def test_small_and_negative_forces_lie_on_a_line():
    force = np.array([-0.01, 0.0, 0.5e-3, 1e-3])
    found = sphere_travel(force, R, K, np.array([-0.02]), smallest_n=1e-3)
    np.testing.assert_allclose(found.travel_m, force / 1e-3 * found.travel_m[-1], rtol=1e-12)
    assert found.travel_m[1] == 0
    np.testing.assert_array_equal(found.radius_m[:2], 0)
    np.testing.assert_allclose(found.slope[:3], found.travel_m[-1] / 1e-3)


def test_a_force_beyond_the_equator_is_refused_with_the_sample():
    with pytest.raises(ValueError, match="sample 1: 90 N"):
        sphere_travel(np.array([0.01, 90.0]), R, K, np.array([0.0]))
