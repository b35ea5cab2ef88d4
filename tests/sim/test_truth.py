"""The laboratory's body: its stiffness map and its finite element model."""

import numpy as np
import pytest

from models.errors import InputError
from sim.body.soft_body import SoftBody
from sim.body.true_map import Inclusion, TruthMap
from sim.motion.settings import ScanSettings

SIZE = (0.096, 0.096, 0.048)


def test_modulus_falls_off_as_a_gaussian_in_all_three_directions():
    truth = TruthMap(5000.0, (Inclusion(8000.0, (0.04, 0.05, 0.03), 0.01),))
    points = np.array([[0.043, 0.044, 0.038], [0.0, 0.0, 0.0]])
    squared = 0.003**2 + 0.006**2 + 0.008**2
    assert truth(points)[0] == pytest.approx(5000 + 8000 * np.exp(-squared / 2e-4), rel=1e-12)
    assert truth(points)[1] == pytest.approx(5000, rel=1e-3)


@pytest.mark.parametrize("share", [0.05, 0.5, 0.85])
def test_a_blurred_ball_is_a_ball_folded_with_a_gaussian(share):
    spot = Inclusion(1.0, (0.0, 0.0, 0.0), 0.01, ball_share=share)
    assert spot.added(np.zeros((1, 3)))[0] == pytest.approx(1, rel=1e-9)
    fine = (np.arange(6000) + 0.5) * 1e-5
    values = spot.added(np.column_stack([fine, 0 * fine, 0 * fine]))
    shells = 4 * np.pi * fine**2 * values * 1e-5 / (2 * np.pi * 0.01**2) ** 1.5
    assert shells.sum() == pytest.approx(1, rel=1e-4)  # the Gaussian's integral

    rng = np.random.default_rng(0)
    direction = rng.standard_normal((400_000, 3))
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    ball = np.sqrt(5 * share) * direction * rng.random((400_000, 1)) ** (1 / 3)
    drawn = ball + np.sqrt(1 - share) * rng.standard_normal((400_000, 3))
    distance = np.linalg.norm(drawn, axis=1) * np.sqrt(shells @ fine**2 / 3)
    found = np.histogram(distance, np.linspace(0, 0.06, 31))[0] / 400_000
    np.testing.assert_allclose(shells.reshape(30, 200).sum(axis=1), found, atol=2.5e-3)


def test_a_stretched_spot_is_longer_than_wide_and_keeps_its_volume():
    spot = Inclusion(1.0, (0.0, 0.0, 0.0), 0.01, stretch=0.5, angle_rad=np.pi / 6)
    wide = 0.01 / np.cbrt(1.5)  # so that 1.5 wide^3 is 0.01^3
    along = 1.5 * wide * np.array([np.cos(np.pi / 6), np.sin(np.pi / 6), 0.0])
    across = wide * np.array([-np.sin(np.pi / 6), np.cos(np.pi / 6), 0.0])
    values = spot.added(np.array([along, across, [0.0, 0.0, wide]]))
    np.testing.assert_allclose(values, np.exp(-0.5), rtol=1e-12)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((0.0, ()), "background modulus is 0 Pa"),
        ((5000.0, (Inclusion(radius_m=0.0),)), "Inclusion 1 has a radius"),
        ((5000.0, (Inclusion(), Inclusion(weight_pa=-6000.0))), "Inclusion 2 .* stay positive"),
    ],
)
def test_an_impossible_map_is_refused(arguments, message):
    with pytest.raises(InputError, match=message):
        TruthMap(*arguments)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"ramp_s": 0.0}, "ramp_s is 0.0; it has to be positive"),
        ({"force_noise_n": -1.0}, "force_noise_n is negative"),
        ({"force_noise_n": 0.05}, "lost in a force noise of 0.05 N"),
        ({"pause_s": (2.0, 1.0)}, "shortest and the longest pause"),
        ({"depth_m": 0.0}, "depth_m is 0.0"),
    ],
)
def test_settings_that_make_no_sense_are_refused(change, message):
    with pytest.raises(InputError, match=message):
        ScanSettings(**change)


@pytest.fixture(scope="module")
def body():
    points = np.array([[0.024, 0.036, 0.048], [0.060, 0.060, 0.048]])
    down = np.tile([0.0, 0.0, -1.0], (2, 1))
    return SoftBody(SIZE, TruthMap(), 0.49, 0.005, points, down, divisions=(8, 8, 4))


def test_a_homogeneous_half_space_like_block_answers_like_a_flat_punch():
    body = SoftBody(
        (0.2, 0.2, 0.1),
        TruthMap(6000.0, ()),
        0.49,
        0.005,
        np.array([[0.1, 0.1, 0.1]]),
        np.array([[0.0, 0.0, -1.0]]),
        divisions=(10, 10, 5),
    )
    punch = (1 - 0.49**2) / (2 * 6000 * 0.005)  # F = 2 E a d / (1 - nu^2)
    # the bonded base stiffens the layer, here by about 5 % (Hayes et al., a/h = 0.05)
    assert 0.90 * punch < body.compliance_m_per_n[0] < 0.99 * punch


def test_displacement_is_linear_in_force_and_matches_the_tangent(body):
    assert body.displacement(1, 0.3) == pytest.approx(3 * body.displacement(1, 0.1))
    assert body.tangent(1, 0.3) == pytest.approx(0.3 / body.displacement(1, 0.3))


def test_the_drawn_surface_is_pressed_in_where_the_tip_is(body):
    moved = body.surface_displacement(0, 0.25)
    deepest = body.surface_nodes_m[moved[:, 2].argmin()]
    assert np.hypot(*(deepest - [0.024, 0.036, 0.048])[:2]) < 0.006
    assert moved[:, 2].min() < -0.5 * body.displacement(0, 0.25)
    on_base = body.surface_nodes_m[:, 2] == 0
    np.testing.assert_allclose(moved[on_base], 0, atol=1e-12)


def test_the_drawn_surface_is_closed_but_for_the_base_and_points_outwards(body):
    corners = body.surface_nodes_m[body.surface_triangles]
    normal = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]) / 2
    outwards = corners.mean(axis=1) - np.array(SIZE) / 2
    assert (np.einsum("ti,ti->t", normal, outwards) > 0).all()
    area = 0.096**2 + 4 * 0.096 * 0.048
    assert np.linalg.norm(normal, axis=1).sum() == pytest.approx(area)
