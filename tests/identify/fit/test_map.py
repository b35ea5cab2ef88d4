"""The distribution map and the coordinates in which its parameters are sought."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from identify.map.gaussian_map import GAUSSIAN, GaussianMap, Inclusion, Shape
from identify.map.parameters import parameter_space
from models.errors import InputError

TWO = GaussianMap(
    5200.0,
    (Inclusion(14000.0, 0.031, 0.062, 0.037, 0.011), Inclusion(-2100.0, 0.07, 0.02, 0.03, 0.016)),
)
BOX = np.array([[0.0, 0.0, 0.0], [0.096, 0.08, 0.048]])


def random_points(count=40, seed=3):
    return np.random.default_rng(seed).uniform(BOX[0], BOX[1], (count, 3))


def test_the_modulus_is_equation_13():
    points = random_points()
    expected = []
    for x, y, z in points:
        modulus = TWO.background_pa
        for i in TWO.inclusions:
            square = (x - i.x_m) ** 2 + (y - i.y_m) ** 2 + (z - i.z_m) ** 2
            modulus += i.weight_pa * math.exp(-square / (2 * i.radius_m**2))
        expected.append(modulus)
    assert_allclose(TWO.modulus(points), expected, rtol=1e-13)


SHAPES = (GAUSSIAN, Shape(edge=0.75), Shape(edge=-0.3), Shape(0.5, (0.7, -0.4)))


@pytest.mark.parametrize("shape", SHAPES, ids=str)
@pytest.mark.parametrize("name", TWO.names)
def test_the_gradient_is_that_of_the_modulus(name, shape):
    points = random_points()
    k = TWO.names.index(name)
    value = TWO.values[k]
    h = 1e-5 * abs(value)
    above, below = (TWO.changed({name: value + s * h}).modulus(points, shape) for s in (1, -1))
    slope = (above - below) / (2 * h)
    # Central differences with h = 1e-5: truncation and rounding are both near 1e-9 of the largest.
    found = TWO.gradient(points, shape)[:, k]
    assert_allclose(found, slope, rtol=1e-6, atol=1e-7 * np.abs(slope).max())


@pytest.mark.parametrize("shape", SHAPES, ids=str)
def test_a_shape_keeps_an_inclusions_integral(shape):
    inclusion = Inclusion(1.0, 0.0, 0.0, 0.0, 1.0)
    axis = np.linspace(-9, 9, 91)
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij"), axis=-1).reshape(-1, 3)
    found = shape.added(inclusion, grid)[0].sum() * (axis[1] - axis[0]) ** 3
    assert found == pytest.approx((2 * math.pi) ** 1.5, rel=2e-3)


def test_an_edge_of_one_would_be_a_ball_and_a_stretch_is_a_ratio_of_lengths():
    inclusion = Inclusion(1.0, 0.0, 0.0, 0.0, 0.01)
    ball = 0.01 * (3 / 4 * math.sqrt(math.pi) * 2**1.5) ** (1 / 3)  # of the Gaussian's integral
    near = np.array([[0.9 * ball, 0, 0], [1.1 * ball, 0, 0]])
    assert_allclose(Shape(edge=0.98).added(inclusion, near)[0], [1.0, 0.0], atol=0.01)

    a, b = math.log(2) * math.cos(1.0), math.log(2) * math.sin(1.0)
    along = np.array([math.cos(0.5), math.sin(0.5), 0.0])  # half the angle of (a, b)
    across = np.array([-along[1], along[0], 0.0])
    q = Shape(stretch=(a, b)).added(inclusion, 0.01 * np.vstack([along, across]))[3]
    assert_allclose(q, [0.5, 2.0], rtol=1e-12)  # lengths in the ratio 2


def test_a_map_survives_the_way_through_its_values():
    assert GaussianMap.from_values(TWO.values) == TWO


def test_a_wrong_parameter_name_lists_the_right_ones():
    with pytest.raises(InputError, match=r"'inclusion_1.x'.*inclusion_1\.x_m"):
        TWO.changed({"inclusion_1.x": 0.0})
    with pytest.raises(InputError, match="background_pa"):
        parameter_space(TWO, BOX, free=["background"])


@pytest.mark.parametrize("radius", [0.0, -0.01, math.nan])
def test_a_map_refuses_a_radius_that_is_not_positive(radius):
    with pytest.raises(InputError):
        GaussianMap(6000.0, (Inclusion(1.0, 0.0, 0.0, 0.0, radius),))


def test_a_radius_is_as_small_as_the_pressed_part_allows():
    low, high = BOX
    part = np.array([high - 0.3 * (high - low), high])
    whole, pressed = (parameter_space(TWO, BOX, probed=p).bounds[0] for p in (None, part))
    radius = TWO.names.index("inclusion_1.radius_m")
    assert pressed[radius] - whole[radius] == pytest.approx(np.log(0.3))
    assert np.array_equal(np.delete(pressed, [radius, radius + 5]),
                          np.delete(whole, [radius, radius + 5]))  # fmt: skip


def test_scaled_coordinates_lead_back_to_the_map():
    space = parameter_space(TWO, BOX)
    assert_allclose(space.to_map(space.to_scaled(TWO)).values, TWO.values, rtol=1e-14)


def test_the_slope_of_the_coordinates_is_that_of_the_values():
    space = parameter_space(TWO, BOX)
    u = space.to_scaled(TWO)
    for k in range(len(u)):
        step = np.zeros_like(u)
        step[k] = 1e-6
        change = (space.to_map(u + step).values - space.to_map(u - step).values) / 2e-6
        expected = np.zeros_like(change)
        expected[k] = space.slope(u)[k]
        assert_allclose(change, expected, rtol=1e-8, atol=1e-8 * abs(space.slope(u)[k]))


def test_fixed_parameters_keep_the_values_of_the_start():
    space = parameter_space(TWO, BOX, free=["inclusion_1.weight_pa", "inclusion_2.y_m"])
    moved = space.to_map(space.to_scaled(TWO) + 0.1)
    changed = [n for n, a, b in zip(TWO.names, TWO.values, moved.values, strict=True) if a != b]
    assert changed == ["inclusion_1.weight_pa", "inclusion_2.y_m"]


def test_no_step_makes_a_hard_inclusion_soft_or_a_background_negative():
    space = parameter_space(TWO, BOX)
    far = space.to_map(space.to_scaled(TWO) - 6.0)
    assert far.background_pa > 0
    assert far.inclusions[0].weight_pa > 0
    assert far.inclusions[0].radius_m > 0


def test_a_start_outside_the_body_is_moved_to_its_bounds_and_named():
    outside = TWO.changed({"inclusion_1.x_m": 0.2})
    space = parameter_space(outside, BOX)
    u = space.to_scaled(outside)
    assert space.to_map(u).inclusions[0].x_m == pytest.approx(0.096)
    assert space.at_bound(u) == ("inclusion_1.x_m",)
