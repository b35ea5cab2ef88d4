"""95 % intervals in a valley that bends: depth against weight of an inclusion."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.fit.map_fit import fit_scan
from identify.fit.profile_intervals import NORMAL_95, Valley, _range, bent_intervals
from identify.map.gaussian_map import GaussianMap, Inclusion
from identify.measurement.noise import Noise
from models.scan import Scan
from tests.long import long

SIZE = (0.096, 0.096, 0.048)
NOISE = Noise(2e-5, 5e-3)
TRUTH = GaussianMap(5000.0, (Inclusion(20000.0, 0.045, 0.052, 0.035, 0.011),))
FORCE = np.array([0.1, 0.2, 0.3, 0.3, 0.3, 0.2, 0.1])


@pytest.fixture(scope="module")
def model():
    x = np.linspace(0.018, 0.078, 7)
    points = np.array([(a, b, SIZE[2]) for b in x for a in x])
    contacts = Contacts(points, [0.0, 0.0, -1.0], 0.006, "hertz")
    return PalpationModel(block_mesh(SIZE, (6, 6, 4), order=2), 0.49, contacts, near_field=False)


@pytest.fixture(scope="module")
def scan(model):
    true = compliance(model, TRUTH)
    press = np.repeat(np.arange(len(true)), len(FORCE))
    force = np.tile(FORCE, len(true))
    rng = np.random.default_rng(11)
    return Scan(
        press=press,
        time_s=0.1 * np.arange(len(press)),
        phase=np.tile(["load"] * 3 + ["hold"] * 2 + ["unload"] * 2, len(true)),
        point_m=model.contacts.points_m[press],
        direction=model.contacts.directions[press],
        force_n=force + rng.normal(0, NOISE.force_n, force.shape),
        displacement_m=true[press] * force + rng.normal(0, NOISE.displacement_m, force.shape),
        probe_radius_m=np.full(len(press), 0.006),
    )


@pytest.fixture(scope="module")
def fit(model, scan):
    return fit_scan(scan, model, noise=NOISE, start=TRUTH)


@pytest.mark.parametrize("name", ["weight_pa", "z_m"])
@pytest.mark.parametrize("end", ["upper95", *long("lower95")])
def test_chi_square_rises_by_3_84_at_the_ends_of_an_interval(model, scan, fit, name, end):
    name = f"inclusion_1.{name}"
    held = fit.map.changed({name: getattr(fit.parameters[name], end)})
    others = [other for other in TRUTH.names if other != name]
    refit = fit_scan(scan, model, noise=NOISE, start=held, free=others)
    # 3.84 is the 95 % point of chi-square; the parabola is a local picture of the valley
    assert refit.chi2 - fit.chi2 == pytest.approx(NORMAL_95**2, rel=0.3)


def test_the_bend_widens_the_interval_of_the_weight_upwards(fit):
    weight = fit.parameters["inclusion_1.weight_pa"]
    straight = weight.value * np.exp(NORMAL_95 * weight.std / weight.value)
    assert weight.upper95 > 1.02 * straight


@pytest.mark.parametrize("share", [0.0, 0.7])
def test_a_straight_valley_has_the_usual_intervals(share):
    root = np.array([[2.0, 0.0, 0.0], [0.7, 1.1, 0.0], [-0.4, 0.3, 0.6]])
    noise = root @ root.T
    # The model's own error moves the estimate in other directions than the noise
    total = noise + share * np.outer([2.0, -1.0, 0.5], [2.0, -1.0, 0.5])
    u = np.array([1.0, -2.0, 0.5])
    reach = NORMAL_95 * np.sqrt(total[1, 1])
    slope = noise[:, 1] / noise[1, 1]  # the refits know the noise alone
    sides = [[(side * NORMAL_95, u + side * reach * slope)] for side in (-1.0, 1.0)]
    no_bounds = (np.full(3, -np.inf), np.full(3, np.inf))
    valley = Valley(u, 0.0, total, noise, no_bounds, lambda position, start: (0.0, start), 1)
    half = NORMAL_95 * np.sqrt(np.diag(total))
    expected = np.column_stack([u - half, u + half])
    assert_allclose(_range(valley, sides, 1), expected, rtol=1e-3)


def test_a_valley_with_a_flat_floor_and_steep_walls_has_intervals_up_to_its_walls():
    """The covariance at the floor's middle reaches far up the walls, on either side."""

    def rise(z):
        return z / 10 + (z / 2) ** 3

    def refit(position, start):
        return 0.5 * rise(start[position]) ** 2, start[0] * np.array([1.0, 3.0])

    total = np.array([[100.0, 300.0], [300.0, 900.1]])
    names = ("inclusion_1.z_m", "inclusion_1.weight_pa")
    no_bounds = (np.full(2, -np.inf), np.full(2, np.inf))
    ends = bent_intervals(Valley(np.zeros(2), 0.0, total, total, no_bounds, refit, 6), names)
    wall = 2.39  # there the rise is 1.96
    assert rise(wall) == pytest.approx(NORMAL_95, rel=0.01)
    assert_allclose(ends, [[-wall, wall], [-3 * wall, 3 * wall]], rtol=0.3)


def test_what_lies_between_the_ends_of_a_valley_is_within_the_intervals():
    """The weight is least half way to the upper end, where a parabola through both ends is not."""

    def weight(depth):
        return 0.4 * np.expm1(-depth) + 0.15 * depth**2 * (depth > 0)

    def refit(position, start):
        return 0.5 * start[1] ** 2, np.array([weight(start[1]), start[1]])

    narrow, slope = 1e-6, -0.4  # across the valley, and along it at the minimum
    total = np.array([[slope**2 + narrow, slope], [slope, 1.0]])
    no_bounds = (np.full(2, -np.inf), np.full(2, np.inf))
    names = ("inclusion_1.weight_pa", "inclusion_1.z_m")
    ends = bent_intervals(Valley(np.zeros(2), 0.0, total, total, no_bounds, refit, 6), names)
    along = weight(np.linspace(-NORMAL_95, NORMAL_95, 401))
    assert along.argmin() not in (0, 400)
    assert ends[0] == pytest.approx([along.min(), along.max()], rel=0.1)


def test_a_floor_that_is_flat_up_to_a_bound_ends_there():
    """Without a rise of chi-square on the way to a bound, the others end where they are there."""

    def refit(position, start):
        depth = start[1]
        weight = 2.0 * depth + np.clip(start[0] - 2.0 * depth, -1e-3, 1e-3)
        walled = 0.5 * min(depth, 0.0) ** 2
        return walled, np.array([weight, depth])

    total = np.array([[4.0, 2.0], [2.0, 1.001]])
    bounds = np.array([-50.0, -50.0]), np.array([50.0, 0.5])
    ends = bent_intervals(
        Valley(np.zeros(2), 0.0, total, total, bounds, refit, 6), ("weight_pa", "inclusion_1.z_m")
    )
    assert ends[1, 1] >= 0.5
    assert np.abs(ends).max() < 6.0
