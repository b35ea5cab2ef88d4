"""The layer's contact against published stiffness factors, Sneddon's sphere and Hertz."""

from __future__ import annotations

import numpy as np
import pytest

from tests.fem.reference.hayes import layer_transfer, press_layer, punch_factor, sphere_on_layer

E, NU, R = 7e3, 0.37, 5e-3

# Hayes, Keer, Herrmann & Mockros (1972), solved to five decimals from their integral equation:
# a/h -> kappa for nu = .30, .35, .40, .45, .50
RATIOS = (0.30, 0.35, 0.40, 0.45, 0.50)
HAYES = {
    0.2: (1.2066, 1.2176, 1.2323, 1.2523, 1.2806),
    0.4: (1.4726, 1.5019, 1.5422, 1.5993, 1.6837),
    0.6: (1.7848, 1.8398, 1.9178, 2.0328, 2.2129),
    0.8: (2.1260, 2.2131, 2.3402, 2.5354, 2.8602),
    1.0: (2.4835, 2.6075, 2.7938, 3.0914, 3.6187),
    1.5: (3.4090, 3.6403, 4.0100, 4.6576, 6.0030),
    2.0: (4.3532, 4.7062, 5.2985, 6.4206, 9.1495),
}


@pytest.mark.parametrize("wide", HAYES)
def test_a_flat_tip_on_a_layer_has_the_published_stiffness(wide):
    found = [punch_factor(wide, nu) for nu in RATIOS]
    np.testing.assert_allclose(found, HAYES[wide], atol=0.6e-4)  # four decimals are printed


def test_the_stiffness_of_a_thick_layer_is_the_half_spaces():
    # Hayes' expansion begins with 1 + O(a/h); the factor of 100 is the distance from contact
    assert punch_factor(1e-4, 0.45) == pytest.approx(1, abs=3e-4)
    assert punch_factor(1e-3, 0.45) - 1 == pytest.approx(
        10 * (punch_factor(1e-4, 0.45) - 1), rel=0.01
    )


def test_waves_much_shorter_than_the_layer_do_not_feel_its_base():
    np.testing.assert_allclose(layer_transfer(np.array([25.0, 400.0]), 0.3), 1, rtol=1e-12)
    # Long waves compress it with the constrained modulus: M/x -> (1 - 2 nu)/(2 (1 - nu)^2)
    for nu in (0.1, 0.4):
        long = layer_transfer(np.array([1e-3]), nu)[0] / 1e-3
        assert long == pytest.approx((1 - 2 * nu) / (2 * (1 - nu) ** 2), rel=1e-3)


@pytest.mark.parametrize("share", [0.05, 0.4, 0.9])
def test_a_sphere_on_the_half_space_is_sneddons(share):
    a = share * R
    found = sphere_on_layer(a, R, E, NU)
    log = np.log((R + a) / (R - a))
    assert found.travel_m == pytest.approx(a / 2 * log, rel=1e-12)
    force = E / (1 - NU**2) * ((R**2 + a**2) / 2 * log - a * R)
    assert found.force_n == pytest.approx(force, rel=1e-9)


def test_a_paraboloid_on_the_half_space_is_hertz():
    found = press_layer(0.02, R, E, NU, paraboloid=True)
    plane = E / (1 - NU**2)
    assert found.radius_m == pytest.approx(np.cbrt(0.75 * 0.02 * R / plane), rel=1e-7)
    assert found.travel_m == pytest.approx(found.radius_m**2 / R, rel=1e-9)


@pytest.mark.parametrize("nu", [0.2, 0.5])
@pytest.mark.parametrize("paraboloid", [True, False])
def test_a_growing_contact_adds_force_as_a_flat_tip_of_its_size(nu, paraboloid):
    # Mossakovski: dF/dd = 2 E a kappa(a/h)/(1 - nu^2), whatever the tip's profile
    a, h, step = 3e-3, 4e-3, 1e-6
    low, high = (sphere_on_layer(a + s, R, E, nu, h, paraboloid) for s in (-step, step))
    slope = (high.force_n - low.force_n) / (high.travel_m - low.travel_m)
    assert slope == pytest.approx(2 * E * a * punch_factor(a / h, nu) / (1 - nu**2), rel=1e-6)


def test_the_pressure_under_a_sphere_falls_to_nothing_at_the_edge():
    found = sphere_on_layer(4e-3, R, E, 0.45, 5e-3)
    assert (np.diff(found.density) < 0).all()
    assert 0 < found.density[-1] < 0.01 * found.density[0]


def test_impossible_contacts_are_refused():
    with pytest.raises(ValueError, match="does not fit a sphere"):
        sphere_on_layer(1.01 * R, R, E, NU)
    with pytest.raises(ValueError, match="to its equator"):
        press_layer(50.0, R, E, NU)
