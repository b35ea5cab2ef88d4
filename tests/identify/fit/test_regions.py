"""A free map with labelled regions: a level each, sharp between them, smooth within.

The truth has a finer mesh of its own, and its regions are no union of cells of either mesh.
"""

from dataclasses import replace

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from identify.body.compliance import compliance
from identify.fit import read_fit, write_fit
from identify.fit.free_map_start import fit_free_map
from identify.map import GaussianMap, Grid, LabelledGrid, MaternField
from identify.measurement.experiment import BodyModel, FieldGuess, MapGuess, PlacedExperiment
from identify.measurement.noise import Noise
from models import LabelVolume, Scan

SIZE_M, NOISE = (0.06, 0.06, 0.03), Noise(1e-5, 2e-3)
TRUE_PA = {0: 6e3, 1: 24e3}  # a block inside, eight millimetres below the surface
LOW, HIGH = np.array([0.017, 0.021, 0.008]), np.array([0.037, 0.041, 0.022])


def label(points):
    return np.all((points > LOW) & (points < HIGH), axis=1).astype(int)


@pytest.fixture(scope="module")
def regions() -> LabelVolume:
    axes = [np.arange(0.0005, size, 0.001) for size in SIZE_M]
    places = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    labels = label(places.reshape(-1, 3)).reshape(places.shape[:3])
    return LabelVolume.of(labels, np.column_stack([1e-3 * np.eye(3), np.full(3, 5e-4)]))


class Labelled(GaussianMap):
    def modulus(self, points, shape=None):
        return np.where(label(points), TRUE_PA[1], TRUE_PA[0])


@pytest.fixture(scope="module")
def experiment(regions) -> PlacedExperiment:
    x, y = (a.ravel() for a in np.meshgrid(*[np.linspace(0.009, 0.051, 5)] * 2))
    points = np.column_stack([x, y, np.full(x.size, SIZE_M[2])])
    at = Contacts(points, np.tile([0, 0, -1.0], (x.size, 1)), np.full(x.size, 0.004))
    found = compliance(PalpationModel(block_mesh(SIZE_M, (15, 15, 8)), 0.45, at), Labelled(1.0))
    rng, n = np.random.default_rng(4), 6
    press, force = np.repeat(np.arange(len(at)), n), np.tile(np.linspace(0.05, 0.3, n), len(at))
    rows = len(press)
    scan = Scan(
        press=press, time_s=np.full(rows, np.nan), phase=np.full(rows, "load"),
        force_n=force + rng.normal(0, NOISE.force_n, rows),
        displacement_m=found[press] * force + rng.normal(0, NOISE.displacement_m, rows),
        point_m=points[press], direction=at.directions[press],
        probe_radius_m=at.radius_m[press],
    )  # fmt: skip
    model = PalpationModel(block_mesh(SIZE_M, (11, 11, 6)), 0.45, at)
    guess = MapGuess(field=FieldGuess(regions=regions))
    return PlacedExperiment(scan, BodyModel(model, model, model, ""), NOISE, guess)


@pytest.mark.slow
def test_regions_of_a_scan_have_their_moduli_within_their_bands(experiment, tmp_path):
    fit = fit_free_map(experiment)
    assert fit.success
    assert fit.field is not None
    outside, inside = fit.field.regions
    assert (outside.label, inside.label) == (0, 1)
    for found in (outside, inside):
        assert found.lower95_pa < TRUE_PA[found.label] < found.upper95_pa
        own = fit.map.log_pa[fit.map.grid.labels == found.label]
        assert found.modulus_pa == pytest.approx(np.exp(own.mean()))
    assert outside.seen > 0.95
    # One voxel to either side of the border, far below the spacing of the grid
    pair = np.array([[0.027, 0.031, 0.0213], [0.027, 0.031, 0.0227]])
    inner, outer = fit.map.modulus(pair)
    assert inner > 2 * outer
    write_fit(fit, tmp_path / "fit.json")
    again = read_fit(tmp_path / "fit.json")
    points = np.random.default_rng(0).uniform((0, 0, 0), SIZE_M, (500, 3))
    assert again.map.modulus(points) == pytest.approx(fit.map.modulus(points), rel=1e-12)
    assert again.field is not None
    assert again.field.regions == fit.field.regions
    # Without the labels the band of such a deep place is far wider, or misses it
    plain = fit_free_map(replace(experiment, map=MapGuess(field=FieldGuess())))
    assert plain.map.modulus(pair[:1])[0] < 0.7 * inner


def test_every_point_is_interpolated_from_its_own_region(regions):
    grid = Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.007)
    own = LabelledGrid(grid.lower_m, grid.spacing_m, grid.counts, regions)
    points = np.random.default_rng(1).uniform((0, 0, 0), SIZE_M, (4000, 3))
    weights = own.weights(points)
    assert np.asarray(weights.sum(axis=1)).ravel() == pytest.approx(np.ones(4000))
    levels = np.array([5.0, -3.0])[own.labels]
    assert weights @ levels == pytest.approx(np.array([5.0, -3.0])[regions.at(points)])
    linear = grid.points_m @ [1.0, 2.0, 3.0]  # exact where all neighbours are of one region
    far = ~label(points + 0.008).astype(bool) & ~label(points - 0.008).astype(bool)
    far &= (np.abs(points - (LOW + HIGH) / 2) > 0.02).any(axis=1)
    assert (weights @ linear)[far] == pytest.approx((points @ [1.0, 2.0, 3.0])[far])


def test_the_prior_has_a_level_a_region(regions):
    grid = Grid.over(np.array([[0, 0, 0], SIZE_M]), 0.01)
    own = LabelledGrid(grid.lower_m, grid.spacing_m, grid.counts, regions)
    prior = MaternField(own, 0.02, 0.3, 2.0)
    one = np.zeros((1, len(own)))
    one[0, 0] = 1.0
    covariance = prior.product(one)[0]
    away = np.linalg.norm(own.points_m - own.points_m[0], axis=1)
    expected = prior.covariance(away) + 4.0 * (own.labels == own.labels[0])
    assert covariance == pytest.approx(expected)
    draws = prior.draws(np.random.default_rng(2), 4000)
    step = draws[:, own.labels == 1].mean(axis=1) - draws[:, own.labels == 0].mean(axis=1)
    assert step.std() == pytest.approx(np.sqrt(8), rel=0.06)
