"""Of too many presses the loop takes some of every kind, evenly, and as many as it may."""

from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from models.errors import InputError
from models.scan import Scan
from models.thin import thinned
from palpmap.run_files import fit_run
from palpmap.study.study import load_study
from tests.paths import LAB


def scan_of(points, radius, force, travel=None) -> Scan:
    """Return a scan of presses of two rows, by force; by travel where that is given."""
    n = len(points)
    rng = np.random.default_rng(0)
    if travel is None:
        travel = 2e-5 * force / radius * (1 + 0.5 * np.sin(50 * points[:, 0]))
    return Scan(
        press=np.repeat(np.arange(n), 2),
        time_s=np.arange(2.0 * n),
        phase=np.array(["load", "hold"] * n),
        point_m=np.repeat(points, 2, axis=0),
        direction=np.tile([0.0, 0.0, -1.0], (2 * n, 1)),
        force_n=np.repeat(force, 2) * np.tile([0.5, 1.0], n) + 1e-3 * rng.normal(size=2 * n),
        displacement_m=np.repeat(travel, 2) * np.tile([0.5, 1.0], n),
        probe_radius_m=np.repeat(radius, 2),
    )


def grid(side: int) -> np.ndarray:
    x, y = np.meshgrid(np.linspace(0, 0.08, side), np.linspace(0, 0.08, side))
    return np.column_stack([x.ravel(), y.ravel(), np.zeros(side**2)])


def test_a_scan_with_few_presses_is_left_as_it_is():
    scan = scan_of(grid(4), np.full(16, 0.005), np.full(16, 0.3))
    assert thinned(scan, 16) is scan


@pytest.mark.parametrize("most", [60, 100])
def test_a_second_scan_of_the_same_places_is_not_lost(most):
    """The same grid once more, with two other tips and forces to match."""
    places = np.vstack([grid(9), grid(9)])
    other = np.where(np.arange(81) % 2, 0.003, 0.01)
    radius = np.concatenate([np.full(81, 0.005), other])
    kept = thinned(scan_of(places, radius, 60 * radius), most)
    counts = [np.count_nonzero(kept.contact_radii == r) for r in (0.003, 0.005, 0.01)]
    assert sum(counts) == most
    assert min(counts) > 0.15 * most
    assert (np.diff(kept.press_ids) > 0).all()
    for radius_m in (0.003, 0.005, 0.01):  # of each kind, all over the surface
        spread = kept.contact_points[kept.contact_radii == radius_m][:, :2]
        assert np.ptp(spread, axis=0).min() > 0.06


def test_repeated_presses_fill_what_is_left_evenly():
    places = np.vstack([grid(5)] * 4)
    kept = thinned(scan_of(places, np.full(100, 0.005), np.full(100, 0.3)), 50)
    assert len(kept.press_ids) == 50
    assert np.isin(np.arange(25), kept.press_ids).all()
    rounds = np.bincount(kept.press_ids // 25, minlength=4)
    assert rounds[1:].min() >= 8


def test_hard_places_of_a_scan_to_one_depth_are_not_chosen_more_often_than_others():
    places = grid(20)
    hard = np.hypot(places[:, 0] - 0.02, places[:, 1] - 0.03) < 0.012
    force = 1.0 + 9.0 * np.exp(-((places[:, 0] - 0.02) ** 2 + (places[:, 1] - 0.03) ** 2) / 1e-4)
    kept = thinned(scan_of(places, np.full(400, 0.003), force, np.full(400, 2e-3)), 100)
    assert np.count_nonzero(hard[kept.press_ids]) <= 1.4 * 100 * hard.mean()
    # Told forces, on the other hand, count as kinds
    twice = scan_of(np.vstack([places] * 2), np.full(800, 0.003), np.repeat([0.1, 0.3], 400))
    levels = np.bincount(thinned(twice, 100).press_ids // 400)
    assert levels.min() > 40


def test_a_fit_of_a_thinned_scan_is_compared_with_what_it_was_made_on(monkeypatch):
    side = np.linspace(0.012, 0.084, 15)
    places = np.array([(x, y, 0.048) for x in side for y in side])
    scan = scan_of(places, np.full(225, 0.005), np.full(225, 0.3))
    study = load_study(LAB / "case_a" / "study.toml")
    used = []

    def compared(fit, scan):
        used.append(scan)
        raise InputError("seen")

    monkeypatch.setattr(fit_run, "compare", compared)
    for made_on in (scan, thinned(scan)):
        fit: Any = SimpleNamespace(force_n=made_on.used().force_n)
        with pytest.raises(InputError, match="seen"):
            fit_run.finding_of(fit, study, scan)
    assert [len(scan.press_ids) for scan in used] == [225, 200]
