"""Areas of a free map, in readings that are linear in the field."""

from dataclasses import replace

import numpy as np
import pytest

from identify.fit.free_map.areas import Area, find_areas
from identify.fit.free_map.field_posterior import FieldPosterior
from identify.fit.free_map.outline import beyond_presses
from identify.fit.free_map.settings import SPOTS
from identify.map import MaternField
from tests.identify.fit.test_spots import (
    NOISE,
    by_field,
    grid,
    posterior,
    presses,
)

__all__ = ["by_field", "grid"]


TIP_M, ACROSS = np.full(36, 0.003), np.eye(3)[:2]


@pytest.fixture(scope="module", autouse=True)
def fields_drawn_once():
    """Let all posteriors, which have one prior, share its random fields: they take the time."""
    drawn, draw = {}, MaternField.draws

    def once(prior, rng, count):
        key = str(rng.bit_generator.state), count
        if key not in drawn:
            drawn[key] = draw(prior, rng, count), rng.bit_generator.state
        fields, rng.bit_generator.state = drawn[key]
        return fields

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(MaternField, "draws", once)
        yield


def areas(by_field, found: FieldPosterior) -> tuple[Area, ...]:
    return find_areas(found, -by_field @ found.mean, presses().points_m, TIP_M, ACROSS)


def noisy(by_field, field, seed: int) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return by_field @ field + NOISE * rng.standard_normal(len(by_field))


def test_a_band_is_an_area_with_its_place_size_and_contrast(by_field, grid):
    x, y, z = grid.points_m.T
    band = np.log(2.0) * ((np.abs(y - 0.026) < 0.005) & (x > 0.014) & (x < 0.046) & (z > 0.015))
    (first,) = areas(by_field, posterior(by_field, grid, noisy(by_field, band, 1)))
    assert np.hypot(first.x_m - 0.03, first.y_m - 0.026) < 0.003
    assert first.length_m == pytest.approx(0.032, abs=0.004)
    assert first.width_m < 0.02
    assert not first.at_rim
    x, y, _ = presses().points_m.T
    inside = (np.abs(y - 0.026) < 0.005) & (x > 0.014) & (x < 0.046)
    assert first.presses == inside.sum()
    felt = -by_field @ band
    assert np.log(first.lower95) < felt[inside].mean() - felt[~inside].mean()
    assert np.log(first.upper95) > felt[inside].mean() - felt[~inside].mean()
    soft = areas(by_field, posterior(by_field, grid, noisy(by_field, -band, 1)))[0]
    assert soft.contrast < 1


def test_an_area_differs_by_more_than_all_presses_do_by_chance_and_than_a_layer_is_felt(
    by_field, grid
):
    found = posterior(by_field, grid, noisy(by_field, np.zeros(len(grid)), 4))
    sd = np.median((found.draws(np.random.default_rng(0), 400) @ by_field.T).std(axis=0))
    any_size = replace(SPOTS, area_least=0.0)
    careless = replace(any_size, area_confidence=0.0)

    def number(size: float, settings) -> int:
        felt = np.zeros(36)
        felt[[14, 15, 20, 21]] = size
        return len(find_areas(found, felt, presses().points_m, TIP_M, ACROSS, settings))

    # In standard deviations of one press: all 36 together have more than 2.7 by chance
    assert [number(2.7 * sd, s) for s in (careless, any_size)] == [1, 0]
    assert number(6.0 * sd, any_size) == 1
    assert 6.0 * sd < SPOTS.area_least
    assert [number(size, SPOTS) for size in (6.0 * sd, 0.04)] == [0, 1]


def test_areas_at_an_edge_of_the_scan_come_last_without_a_corner_in_them(by_field, grid):
    x, y, _ = grid.points_m.T
    edge = np.log(2.5) * ((x > 0.045) & (np.abs(y - 0.03) < 0.014))
    within = np.log(1.6) * ((np.abs(x - 0.022) < 0.008) & (np.abs(y - 0.03) < 0.008))
    found = areas(by_field, posterior(by_field, grid, noisy(by_field, edge + within, 5)))
    weaker, first = (a for a in found if a.contrast > 1)
    assert weaker.contrast < first.contrast
    assert np.hypot(weaker.x_m - 0.022, weaker.y_m - 0.03) < 0.004
    assert first.x_m > 0.04
    assert (weaker.at_rim, first.at_rim) == (False, True)


@pytest.mark.slow
def test_even_bodies_and_layered_ones_seldom_have_an_area(by_field, grid):
    """60 of them, one in twenty by chance."""
    false = 0
    for seed in range(60):
        layer = (seed % 3 - 1) * (np.abs(grid.points_m[:, 2] - 0.022) < 0.004)
        false += bool(areas(by_field, posterior(by_field, grid, noisy(by_field, layer, seed))))
    assert false <= 8  # three are expected; more have a chance of 1 %


def test_single_presses_are_no_area_and_those_of_each_tip_are_compared_with_their_own(
    by_field, grid
):
    even, points = np.zeros(len(grid)), presses().points_m
    slipped = noisy(by_field, even, 2)
    slipped[14] += 0.3
    assert areas(by_field, posterior(by_field, grid, slipped)) == ()
    # Over a hard base the wider tip feels a harder body
    wide = np.arange(len(points)) % 4 > 1
    of_press = noisy(by_field, even, 3) - 0.2 * wide
    found = posterior(by_field, grid, of_press)
    felt = -by_field @ found.mean + 0.2 * wide
    assert find_areas(found, felt, points, np.where(wide, 0.006, 0.003), ACROSS) == ()
    assert find_areas(found, felt, points, TIP_M, ACROSS)
    assert find_areas(found, felt, np.tile(points[:1], (len(points), 1)), TIP_M, ACROSS) == ()


def test_what_presses_in_one_line_do_not_reach_around_is_beyond_them():
    line = np.outer(np.arange(5.0), [1.0, 0.0, 0.0])
    assert beyond_presses(line, line, ACROSS).tolist() == [np.inf] * 5
