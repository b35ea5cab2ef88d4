"""Faulty presses by the thousand: none unreported, none over its limit of force, no scan lost.

    python benchmarks/faults.py [--scans 50] [--seed 0] [--kinds sensor_gain ...]

Each scan has a press for every kind of fault of `sim.planted.faults`, in an order drawn from its
seed, and after each a press without one. Bodies are springs of 50 to 2000 N/m, forces 0.3 to 1 N.
A press is unreported if its rows are delivered as kept while the held force is off by more than 2 %
or a row's force or travel by more than six standard deviations of the noise and 3 % of its largest.
"""

import argparse
import sys
import time
from collections import Counter

import numpy as np

from sim.motion import ScanPlan, ScanSettings
from sim.planted.faults import FAULTS, fault
from sim.robot.mechanism import Mechanisms
from sim.scan.whole_scan import run_scan

SHORT = {"ramp_s": 0.5, "hold_s": 0.6, "unload_s": 0.5, "pause_s": (0.1, 0.1)}


class _Spring:
    """F = k u."""

    def __init__(self, stiffness: float) -> None:
        self.stiffness = stiffness

    def displacement(self, press: int, force_n: float) -> float:
        return force_n / self.stiffness

    def tangent(self, press: int, force_n: float) -> float:
        return self.stiffness


def wrong_rows(press, stiffness: float, settings: ScanSettings) -> str:
    """Return what is wrong with a delivered press beyond its noise; nothing if it is right."""
    wanted = press.statistics.set_force_n
    if abs(press.statistics.force_error) > 0.02:
        return f"held force off by {100 * press.statistics.force_error:.1f} %"
    if press.statistics.contact_error_m > 4e-4:
        return f"place off by {1e3 * press.statistics.contact_error_m:.2f} mm"
    off = np.abs(press.scan.force_n - press.true_force_n).max()
    if not off <= 6 * settings.force_noise_n + 0.03 * wanted:
        return f"a force off by {off:.3g} N"
    travel = press.true_force_n / stiffness
    off = np.abs(press.scan.displacement_m - travel).max()
    # First touch is known to the noise of force over the stiffness
    if not off <= 6 * settings.displacement_noise_m + 0.03 * wanted / stiffness + 1e-4:
        return f"a travel off by {1e3 * off:.3g} mm"
    return ""


def faulty_scan(seed: int, kinds: list[str]) -> Counter:
    """Make one scan; return the counts of what happened."""
    rng = np.random.default_rng([seed, 41])
    order = [str(kind) for kind in rng.permutation(kinds)]
    stiffness = float(np.exp(rng.uniform(np.log(50), np.log(2000))))
    force = float(rng.uniform(0.3, 1.0))
    settings = ScanSettings(
        seed=seed, on_fault=("skip", "retry")[seed % 2], stiffness_n_per_m=150.0, **SHORT
    )
    count = 2 * len(order)
    x = 0.03 + 0.002 * (np.arange(count) % 20)
    points = np.column_stack([x, 0.03 + 0.01 * (np.arange(count) // 20), np.full(count, 0.048)])
    plan = ScanPlan(points, np.tile([0.0, 0.0, -1.0], (count, 1)), force)
    planted = tuple(
        fault(kind, seed, {2 * i}, attempts=int(rng.integers(1, 4))) for i, kind in enumerate(order)
    )
    limit = 2 * force + 0.5
    tally: Counter = Counter()
    run = run_scan(plan, _Spring(stiffness), settings, mechanisms=Mechanisms(planted))
    assert len(run.outcomes) == count
    by_press = {press.statistics.press: press for press in run.presses}
    for i, outcome in enumerate(run.outcomes):
        kind = order[i // 2] if i % 2 == 0 else "none"
        tally[(kind, outcome.outcome)] += 1
        if i in by_press:
            wrong = wrong_rows(by_press[i], stiffness, settings)
            if wrong and outcome.kept:
                tally[("unreported", kind)] += 1
                print(f"UNREPORTED seed {seed} press {i} {kind}: {wrong}; K {stiffness:.0f} N/m")
        elif kind == "none":
            tally[("unfounded", outcome.faults[-1].kind)] += 1
            print(f"UNFOUNDED seed {seed} press {i}: {outcome.sentence}")
        tally[("told", kind)] += bool(outcome.faults or not outcome.kept)
        if outcome.peak_force_n > limit:
            tally[("over", kind)] += 1
            print(
                f"OVER seed {seed} press {i} {kind}: {outcome.peak_force_n:.2f} of {limit:.2f} N, "
                f"K {stiffness:.0f} N/m; {outcome.sentence}"
            )
    return tally


def main() -> int:
    """Print the counts; 0 if nothing is unreported, over its limit or lost."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--scans", type=int, default=50)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--kinds", nargs="*", default=list(FAULTS))
    given = parser.parse_args()
    tally: Counter = Counter()
    started, lost = time.process_time(), 0
    for seed in range(given.seed, given.seed + given.scans):
        try:
            tally += faulty_scan(seed, given.kinds)
        except Exception as error:
            lost += 1
            print(f"LOST seed {seed}: {type(error).__name__}: {error}")
    words = ("made", "retried", "skipped", "aborted")
    print(f"{'':22}" + "".join(f"{word:>9}" for word in words) + "     told")
    for kind in [*given.kinds, "none"]:
        row = "".join(f"{tally[(kind, word)]:9}" for word in words)
        print(f"{kind:22}{row}{tally[('told', kind)]:9}")
    unreported, over, unfounded = (
        sum(n for (a, _), n in tally.items() if a == word)
        for word in ("unreported", "over", "unfounded")
    )
    presses = given.scans * len(given.kinds)
    print(
        f"{presses} faulty presses and as many others: {unreported} unreported, {over} over the "
        f"limit of force, {lost} scans lost, {unfounded} sound presses not made; "
        f"{time.process_time() - started:.0f} s of CPU"
    )
    return int(bool(unreported or over or lost))


if __name__ == "__main__":
    sys.exit(main())
