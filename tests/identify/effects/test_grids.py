"""How dense candidates are in what finite elements say the presses feel, the background taken out.

Slow: a body is solved. The kit's own check of body effects is a rough stand-in for this.
"""

from itertools import pairwise

import numpy as np
import pytest

from fem import Contacts, PalpationModel, block_mesh
from identify.body.state import BodyState
from identify.catalogue import breathing, breathing_drifting
from identify.catalogue.catalogue import CATALOGUE
from identify.effects.conformance.worked_example import Inputs

SIZE = (0.096, 0.096, 0.048)
STATE = BodyState(((0.0, 0.0, 0.0), SIZE), 0.47)
SIDE = np.linspace(0.012, 0.084, 9)
POINTS = [(x, y, SIZE[2]) for x in SIDE for y in SIDE]
READINGS = Inputs({"press": tuple(range(81)), "point_m": tuple(POINTS)}).readings()
EVEN_PACE_S = 4.4
EVEN = Inputs(
    {
        "press": tuple(np.repeat(np.arange(81), 9).tolist()),
        "point_m": tuple(np.repeat(POINTS, 9, axis=0).tolist()),
        "time_s": tuple((EVEN_PACE_S * np.arange(81)[:, None] + np.linspace(0, 3, 9)).ravel()),
    }
).readings()


@pytest.fixture(scope="module")
def response():
    model = PalpationModel(block_mesh(SIZE, (8, 8, 4)), 0.47, Contacts(POINTS, (0, 0, -1), 0.005))
    x, y, z = model.points_m.T
    hard = np.exp(-((x - 0.04) ** 2 + (y - 0.058) ** 2 + (z - 0.034) ** 2) / (2 * 0.01**2))
    modulus = 6000.0 + 18000.0 * hard
    return model, modulus, model.evaluate(modulus)


@pytest.mark.parametrize("hours", [0.5, 2.0])
def test_a_long_scan_is_searched_for_a_rhythm_that_changes(hours):
    start_s = 3600 * hours * np.sort(np.random.default_rng(1).uniform(size=60))
    time_s = (start_s[:, None] + (0.0, 0.5)).ravel()
    scan = Inputs({"press": tuple(np.repeat(np.arange(60), 2)), "time_s": tuple(time_s)}).readings()
    effect = CATALOGUE["breathing_drifting"]
    assert effect.untestable(scan) is None
    drifts = {shape["drift_hz_per_s"] for shape in effect.grid(scan, STATE)}
    assert min(drifts) < 0 < max(drifts)


def test_a_rhythm_is_not_sought_where_every_frequency_keeps_step_with_the_presses(monkeypatch):
    locked = np.linspace(0.05, 2.0, 9), np.zeros(9, bool)
    for module in (breathing, breathing_drifting):
        monkeypatch.setattr(module, "free_frequencies", lambda *_: locked)
    for name in ("breathing", "breathing_drifting", "breathing_harmonics"):
        assert "keep step" in CATALOGUE[name].untestable(EVEN), name


def without(background, patterns):
    left = patterns - np.outer(background, background @ patterns) / (background @ background)
    return left / np.linalg.norm(left, axis=0)


@pytest.mark.slow
def test_any_inclusion_is_like_one_of_the_candidates(response):
    model, _, solved = response
    inclusion = CATALOGUE["extra_inclusion"]

    def felt(places):
        moduli = [
            inclusion.body(STATE, weight_pa=1.0, **p).added_pa(model.points_m) for p in places
        ]
        return without(solved.compliance, solved.sensitivity @ np.column_stack(moduli))

    rng = np.random.default_rng(3)
    anywhere = []
    for _ in range(100):
        radius, (x, y) = rng.uniform(0.006, 0.014), rng.uniform(0.012, 0.084, 2)
        z = rng.uniform(0.018, SIZE[2] - 0.4 * radius)
        anywhere.append({"x_m": x, "y_m": y, "z_m": z, "radius_m": radius})
    alike = np.abs(felt(inclusion.grid(READINGS, STATE)).T @ felt(anywhere)).max(axis=0)
    assert alike.min() > 0.85
    assert np.median(alike) > 0.95


@pytest.mark.slow
def test_neighbouring_directions_of_fibres_are_alike(response):
    _, modulus, solved = response
    grid = CATALOGUE["anisotropy"].grid(READINGS, STATE)
    angles = [c["angle_rad"] for c in grid]
    patterns = without(
        solved.compliance,
        np.column_stack(
            [solved.fibre_sensitivity((np.cos(a), np.sin(a), 0.0)) @ modulus for a in angles]
        ),
    )
    assert np.diff(angles) == pytest.approx(np.pi / len(angles))
    closed = [*patterns.T, patterns[:, 0]]  # half a turn further it is the first again
    assert min(a @ b for a, b in pairwise(closed)) > 0.8


def test_no_tone_of_a_breath_keeps_step_with_the_presses():
    """At half the rhythm of the presses the second tone comes round with each of them."""
    effect, time_s = CATALOGUE["breathing_harmonics"], float(EVEN.elapsed_s[-1])
    found = np.array([values["frequency_hz"] for values in effect.grid(EVEN, STATE)])
    for tone in (1, 2, 3):
        nearest = np.abs(found - 1 / EVEN_PACE_S / tone).min() * time_s
        assert 0.9 / tone < nearest < 2.5 / tone
    one = np.array([v["frequency_hz"] for v in CATALOGUE["breathing"].grid(EVEN, STATE)])
    assert np.abs(one - 0.5 / EVEN_PACE_S).min() < 0.2 / time_s
    assert effect.doubt({"frequency_hz": 0.5 / EVEN_PACE_S}, EVEN) is not None


def test_a_breath_that_changes_much_in_a_long_scan_is_found_around_the_best_of_the_grid():
    """The grid of a long scan has small drifts alone, of which the best is a poor start."""
    breath, pause = CATALOGUE["breathing_drifting"], np.random.default_rng(2).uniform(0, 3, 81)
    start = EVEN_PACE_S * np.arange(81) + np.cumsum(pause)
    time = tuple((start[:, None] + np.linspace(0, 3, 9)).ravel().tolist())
    readings = Inputs({"press": tuple(np.repeat(np.arange(81), 9).tolist()), "time_s": time})
    long = readings.readings()
    for first, change in ((0.345, 0.17), (0.28, -0.15), (0.5, 0.1)):
        drift = first * change / float(long.elapsed_s[-1])
        true = {"frequency_hz": first, "drift_hz_per_s": drift, "bend_hz_per_s2": 0.0}
        wave = breath.columns(long, [true])[0] @ [0.6, 0.8]

        def like(shapes, wave=wave):
            bases = np.linalg.qr(breath.columns(long, shapes))[0]
            return np.linalg.norm(bases.swapaxes(1, 2) @ wave, axis=1) / np.linalg.norm(wave)

        grid = breath.grid(long, STATE)
        coarse = like(grid)
        assert coarse.max() < 0.8
        assert like(breath.around(grid[int(np.argmax(coarse))], long)).max() > 0.93
