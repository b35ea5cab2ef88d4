"""The reduced model of a palpated block against full solutions: errors, time, memory.

Maps with one Gaussian inclusion, drawn at random: background +-10 %, weight +-35 %, place +-4 mm
(+-6 mm in depth), radius +-15 %. Part of `python benchmarks/run.py`.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.stats import qmc

from fem import Contacts, PalpationModel, block_mesh
from fem.reduced.model import ReducedModel
from identify.map.gaussian_map import GaussianMap, Inclusion

SIZE_M = (0.096, 0.096, 0.048)
CENTRE = np.array([5e3, 1.8e4, 0.040, 0.058, 0.032, 0.010])
HALF = np.array([500, 6300, 0.004, 0.004, 0.006, 0.0015])
TRAINING = 256
TESTS = 6
SNAPSHOTS = (1, 2, 4, 8, 12, 16)
REPEATS = 20


def gaussian(parameters: np.ndarray) -> GaussianMap:
    base, *inclusion = parameters.tolist()
    return GaussianMap(base, (Inclusion(*inclusion),))


def seconds(work: Callable[[], object], repeats: int) -> float:
    """Shortest time of some runs."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def full_model() -> PalpationModel:
    grid = np.arange(12, 85, 9) * 1e-3
    points = np.array([(x, y, SIZE_M[2]) for y in grid for x in grid])
    contacts = Contacts(points, np.array([0.0, 0.0, -1.0]), np.array(0.005))
    return PalpationModel(block_mesh(SIZE_M, (8, 8, 4)), 0.49, contacts)


def table() -> list[str]:
    full = full_model()
    moved = 2 * qmc.Sobol(6, seed=1).random(TRAINING) - 1
    training = np.vstack([CENTRE, CENTRE + HALF * moved[:-1]])
    fields = np.array([gaussian(one).modulus(full.points_m) for one in training])
    drawn = CENTRE + HALF * np.random.default_rng(0).uniform(-1, 1, (TESTS, 6))
    tests = [gaussian(one) for one in drawn]
    expected = [full.evaluate(one.modulus(full.points_m)).compliance for one in tests]

    def evaluate(model: PalpationModel | ReducedModel) -> None:
        points, one = model.points_m, tests[0]
        model.evaluate(one.modulus(points)).gradient(one.gradient(points))

    evaluate(full)
    of_full = seconds(lambda: evaluate(full), 3)
    lines = [
        f"{len(full.contacts)} presses with near fields; the full model takes "
        f"{1e3 * of_full:.0f} ms with all derivatives.",
        "",
        "| snapshots | rms error, % | worst, % | time, ms | full / reduced | set-up, s | MB |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for count in SNAPSHOTS:
        start = time.perf_counter()
        reduced = ReducedModel(full, fields, count)
        set_up = time.perf_counter() - start
        found = [reduced.evaluate(one.modulus(reduced.points_m)).compliance for one in tests]
        error = 100 * (np.array(found) / expected - 1)
        took = seconds(lambda model=reduced: evaluate(model), REPEATS)
        lines.append(
            f"| {count} | {np.sqrt((error**2).mean()):.4f} | {np.abs(error).max():.3f} | "
            f"{1e3 * took:.2f} | {of_full / took:.0f} | {set_up:.1f} | {reduced.bytes / 1e6:.0f} |"
        )
    return lines
