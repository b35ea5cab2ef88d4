"""Scans that could be made next, as variations of the one that was: presses with their timing.

A design is a list of presses. Its readings are the trapezoid of force against time that a press
follows, with as many samples as the present scan has in each phase, so that what another scan
would show is computed with the same model as what this one shows.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from identify.effects.readings import Readings

_SAMPLES = {"load": 8, "hold": 8, "unload": 6}
_PAUSE_S = (0.1, 1.0)
BETWEEN_SCANS_S = 60.0  # rest between a scan and the next on the same body, to change the tip
SMALL, LARGE = 0.6, 2.0  # tip radii of a two-tip scan, in units of the present one
WEAK, STRONG = 0.5, 1.5  # peak forces of a scan with two, in units of the present one


@dataclass(frozen=True)
class Presses:
    """Presses to be made, in order; all arrays (j,) but the first two (j, 3). SI units.

    `pause_s` is the rest before a press.
    """

    point_m: np.ndarray
    direction: np.ndarray
    radius_m: np.ndarray
    force_n: np.ndarray
    ramp_s: np.ndarray
    hold_s: np.ndarray
    unload_s: np.ndarray
    pause_s: np.ndarray

    def __len__(self) -> int:
        return len(self.force_n)

    @property
    def duration_s(self) -> float:
        """Time of the whole scan."""
        parts = self.ramp_s + self.hold_s + self.unload_s + self.pause_s
        return float(np.sum(parts))

    def taken(self, index: np.ndarray) -> Presses:
        """Return the presses of some indices, in their order."""
        return Presses(**{name: array[index] for name, array in vars(self).items()})


@dataclass(frozen=True)
class Design:
    """A scan to be made: what changes, in words, and its presses.

    `name` is a key, `change` completes "make the scan ...".
    """

    name: str
    change: str
    presses: Presses


def presses_of(readings: Readings, seed: int = 0) -> Presses:
    """Return the presses of a scan as they were made, with their typical timing.

    Pauses are drawn anew at random, so that no frequency is locked to the rhythm.
    """
    first = readings.first
    j = readings.presses
    peak = readings.peak_force_n[first]
    spans = {phase: 1.0 for phase in _SAMPLES}
    if readings.time_s is not None:
        for phase in _SAMPLES:
            rows = readings.phase == phase
            spans[phase] = _typical_span(readings, rows) if rows.any() else 0.0
    elif not (readings.phase == "hold").any():
        spans["hold"] = 0.0
    rng = np.random.default_rng(seed)
    return Presses(
        point_m=readings.point_m[first],
        direction=readings.direction[first],
        radius_m=readings.radius_m[first],
        force_n=peak,
        ramp_s=np.full(j, max(spans["load"], 1e-3)),
        hold_s=np.full(j, spans["hold"]),
        unload_s=np.full(j, spans["unload"]),
        pause_s=rng.uniform(*_PAUSE_S, j),
    )


def readings_of(presses: Presses, timed: bool = True, after: Readings | None = None) -> Readings:
    """Return the readings that presses would give, forces as set.

    `after` is the scan that was made before on the same body: clock and order go on from it.
    """
    rows: dict[str, list] = {"press": [], "time": [], "phase": [], "force": []}
    clock = 0.0
    if after is not None and after.time_s is not None:
        clock = float(after.time_s.max()) + BETWEEN_SCANS_S
    for j in range(len(presses)):
        clock += presses.pause_s[j]
        ramp, hold, unload = presses.ramp_s[j], presses.hold_s[j], presses.unload_s[j]
        parts = [("load", ramp, 0.0, 1.0), ("hold", hold, 1.0, 1.0), ("unload", unload, 1.0, 0.0)]
        for phase, span, start, end in parts:
            if span <= 0:
                continue
            share = np.arange(1, _SAMPLES[phase] + 1) / _SAMPLES[phase]
            rows["press"].extend([j] * len(share))
            rows["time"].extend(clock + span * share)
            rows["phase"].extend([phase] * len(share))
            rows["force"].extend(presses.force_n[j] * (start + (end - start) * share))
            clock += span
    press = np.array(rows["press"])
    return Readings(
        press=press,
        order=np.arange(len(presses)) + (0 if after is None else after.presses_made),
        time_s=np.array(rows["time"]) if timed else None,
        phase=np.array(rows["phase"]),
        point_m=presses.point_m[press],
        direction=presses.direction[press],
        force_n=np.array(rows["force"]),
        radius_m=presses.radius_m[press],
        start_s=None if after is None or after.time_s is None else after.clock_start_s,
    )


def variations(presses: Presses, timed: bool, seed: int = 0) -> Iterator[Design]:
    """Yield scans that differ from the present one in one thing each."""
    j = len(presses)
    radius = float(np.median(presses.radius_m))
    yield Design(
        "two_radii",
        f"with two tips, every other press {1e3 * SMALL * radius:.2g} mm and "
        f"{1e3 * LARGE * radius:.2g} mm in radius",
        _two_radii(presses),
    )
    yield Design("same", "once more as it is", presses)
    force = np.where(np.arange(j) % 2 == 0, WEAK, STRONG) * presses.force_n
    yield Design(
        "two_forces", "with every other press half as hard and 1.5 times as hard",
        replace(presses, force_n=force),
    )  # fmt: skip
    if not timed:
        return
    if presses.hold_s.max() > 0:
        yield Design(
            "long_hold", "with holds four times as long",
            replace(presses, hold_s=4 * presses.hold_s),
        )  # fmt: skip
    slow = np.where(np.arange(j) % 2 == 0, 4.0, 1.0)
    yield Design(
        "two_speeds", "with every other press four times as slow",
        replace(presses, ramp_s=slow * presses.ramp_s, unload_s=slow * presses.unload_s),
    )  # fmt: skip
    order = np.random.default_rng(seed).permutation(j)
    yield Design("shuffled", "with the places in random order", presses.taken(order))
    few = np.linspace(0, j - 1, min(9, j)).round().astype(int)
    again = np.concatenate([np.arange(j), few])
    yield Design(
        "repeated", f"with {len(few)} places pressed again at the end", presses.taken(again)
    )


def mixed(presses: Presses, seed: int = 0) -> Design:
    """Return the scan of the same length that differs in all of that: tips, forces and order."""
    order = np.random.default_rng(seed).permutation(len(presses))
    both = _two_radii(presses)
    share = np.resize([WEAK, WEAK, STRONG, STRONG], len(presses))  # each tip with each force
    return Design(
        "mixed",
        "with two tips, two forces and the places in random order",
        replace(both, force_n=share * both.force_n).taken(order),
    )


def _two_radii(presses: Presses) -> Presses:
    """Return the presses with a small and a large tip in turns."""
    turns = np.where(np.arange(len(presses)) % 2 == 0, SMALL, LARGE)
    radius = turns * float(np.median(presses.radius_m))
    # Forces in proportion, so that all go about as deep as they did
    return replace(presses, radius_m=radius, force_n=presses.force_n * radius / presses.radius_m)


def _typical_span(readings: Readings, rows: np.ndarray) -> float:
    """Median time that the rows of a phase take in a press, its first step included."""
    assert readings.time_s is not None
    time = readings.time_s[rows]
    press = readings.press[rows]
    low = np.full(readings.presses, np.inf)
    high = np.full(readings.presses, -np.inf)
    np.minimum.at(low, press, time)
    np.maximum.at(high, press, time)
    count = np.bincount(press, minlength=readings.presses)
    some = count > 1
    if not some.any():
        return 0.0
    return float(np.median((high - low)[some] * count[some] / (count[some] - 1)))
