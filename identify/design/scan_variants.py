"""Variants of the present scan: presses with their timing.

A design is a list of presses. Its readings follow a trapezoid of force against time, with as many
samples as the present scan has in each phase, so that one model serves both scans.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from identify.design.settings import PLAN, PlanSettings
from identify.effects.readings import Readings
from models import early_rest

_SAMPLES = {"load": 8, "hold": 8, "unload": 6}


@dataclass(frozen=True)
class Presses:
    """Presses to be made, in order; all arrays (j,) but the first two (j, 3). SI units.

    `pause_s` is the rest before a press, `released` the share of its force at which the readings of
    its unloading end.
    """

    point_m: np.ndarray
    direction: np.ndarray
    radius_m: np.ndarray
    force_n: np.ndarray
    ramp_s: np.ndarray
    hold_s: np.ndarray
    unload_s: np.ndarray
    pause_s: np.ndarray
    released: np.ndarray

    def __len__(self) -> int:
        return len(self.force_n)

    @property
    def duration_s(self) -> float:
        """Time of the whole scan."""
        parts = self.ramp_s + self.hold_s + self.unload_s + self.pause_s
        return float(np.sum(parts))

    def places_among(self, others: Presses) -> np.ndarray | None:
        """Return for each press the number of one of others with its place and tip, or None.

        None if a press has no such other.
        """
        known = {row.tobytes(): number for number, row in enumerate(others._contact)}
        found = [known.get(row.tobytes(), -1) for row in self._contact]
        return None if -1 in found else np.array(found)

    @property
    def _contact(self) -> np.ndarray:
        return np.column_stack([self.point_m, self.direction, self.radius_m])

    @property
    def rested(self) -> Presses:
        """These presses with a rest after the first eighth of them."""
        pressing_s = self.ramp_s + self.hold_s + self.unload_s
        return replace(self, pause_s=early_rest(self.pause_s, pressing_s))

    def taken(self, index: np.ndarray) -> Presses:
        """Return the presses of some indices, in their order."""
        return Presses(**{name: array[index] for name, array in vars(self).items()})


@dataclass(frozen=True)
class Design:
    """A planned scan: its difference from the present one, in words, and its presses.

    `name` is a key, `change` completes "make the scan ...".
    """

    name: str
    change: str
    presses: Presses


def presses_of(readings: Readings, seed: int = 0, settings: PlanSettings = PLAN) -> Presses:
    """Return the presses of a scan, with their typical timing.

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
    rng, released = np.random.default_rng(seed), _released(readings)
    return Presses(
        point_m=readings.point_m[first],
        direction=readings.direction[first],
        radius_m=readings.radius_m[first],
        force_n=peak,
        ramp_s=np.full(j, max(spans["load"], 1e-3)),
        hold_s=np.full(j, spans["hold"]),
        unload_s=np.full(j, spans["unload"] / (1 - released)),
        pause_s=rng.uniform(*settings.pause_s, j),
        released=np.full(j, released),
    )


def readings_of(
    presses: Presses,
    timed: bool = True,
    after: Readings | None = None,
    settings: PlanSettings = PLAN,
) -> Readings:
    """Return the readings of presses, forces as set.

    `after` is an earlier scan of the same body: clock and order go on from it.
    """
    rows: dict[str, list] = {"press": [], "time": [], "phase": [], "force": []}
    clock = 0.0
    if after is not None and after.time_s is not None:
        clock = float(after.time_s.max()) + settings.between_scans_s
    for j in range(len(presses)):
        clock += presses.pause_s[j]
        ramp, hold, unload = presses.ramp_s[j], presses.hold_s[j], presses.unload_s[j]
        parts = [("load", ramp, 0.0, 1.0), ("hold", hold, 1.0, 1.0), ("unload", unload, 1.0, 0.0)]
        for phase, span, start, end in parts:
            if span <= 0:
                continue
            read = 1 - presses.released[j] if phase == "unload" else 1.0
            share = read * np.arange(1, _SAMPLES[phase] + 1) / _SAMPLES[phase]
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


def variations(
    presses: Presses,
    timed: bool,
    most_force_n: float | None = None,
    seed: int = 0,
    settings: PlanSettings = PLAN,
) -> Iterator[Design]:
    """Yield scans that differ from the present one in one thing each.

    `most_force_n` is that of any press. None is the largest of the present scan, and with the same
    tip that of the place: robot, sensor and body have borne no more.
    """
    presses, most = _borne(presses, most_force_n)
    j, slower = len(presses), settings.slower
    small, large = float(np.median(presses.radius_m)) * np.array(settings.radii)
    yield Design(
        "two_radii",
        f"with two tips, every other press {1e3 * small:.2g} mm and {1e3 * large:.2g} mm in radius",
        _two_radii(presses, most, settings),
    )
    yield Design("same", "once more as it is", presses)
    shares = _forces(presses, most, settings)
    told = " and ".join(_as_hard(share) for share in shares if share != 1.0)
    yield Design(
        "two_forces", f"with every other press {told}",
        replace(presses, force_n=np.resize(shares, j) * presses.force_n),
    )  # fmt: skip
    if not timed:
        return
    if presses.hold_s.max() > 0:
        yield Design(
            "long_hold", "with holds four times as long",
            replace(presses, hold_s=slower * presses.hold_s),
        )  # fmt: skip
    slow = np.where(np.arange(j) % 2 == 0, slower, 1.0)
    yield Design(
        "two_speeds", "with every other press four times as slow",
        replace(presses, ramp_s=slow * presses.ramp_s, unload_s=slow * presses.unload_s),
    )  # fmt: skip
    rested = presses.rested
    long, first = rested.pause_s.max(), int(rested.pause_s.argmax())
    yield Design("rested", f"with a rest of {long:.0f} s after the first {_presses(first)}", rested)
    order = np.random.default_rng(seed).permutation(j)
    yield Design("shuffled", "with the places in random order", presses.taken(order))
    few = np.linspace(0, j - 1, min(settings.repeated, j)).round().astype(int)
    again = np.concatenate([np.arange(j), few])
    yield Design(
        "repeated", f"with {len(few)} places pressed again at the end", presses.taken(again)
    )


def mixed(
    presses: Presses,
    most_force_n: float | None = None,
    seed: int = 0,
    settings: PlanSettings = PLAN,
) -> Design:
    """Return a scan of as many presses with two tips, two forces, a random order and a rest.

    `most_force_n` see `variations`.
    """
    presses, most = _borne(presses, most_force_n)
    order = np.random.default_rng(seed).permutation(len(presses))
    both = _two_radii(presses, most, settings)
    # Each tip with each force
    share = np.resize(np.repeat(_forces(presses, most, settings), 2), len(presses))
    return Design(
        "mixed",
        "with two tips, two forces, the places in random order and an early rest",
        replace(both, force_n=np.minimum(share * both.force_n, most)).taken(order).rested,
    )


def _borne(presses: Presses, most_force_n: float | None) -> tuple[Presses, float]:
    """Return the presses with no more than a force, and that force, N."""
    most = float(presses.force_n.max()) if most_force_n is None else most_force_n
    return replace(presses, force_n=np.minimum(presses.force_n, most)), most


def _forces(presses: Presses, most_n: float, settings: PlanSettings) -> tuple[float, float]:
    """Return the two forces of a scan, in units of the present ones."""
    soft, hard = settings.forces
    borne = min(hard, most_n / float(presses.force_n.max()))
    return borne * soft / hard, borne


def _as_hard(share: float) -> str:
    """Return a share of a force in words.

    >>> _as_hard(1 / 3), _as_hard(0.5), _as_hard(1.5)
    ('a third as hard', 'half as hard', '1.5 times as hard')
    """
    words = {1 / 3: "a third", 0.5: "half"}
    near = (word for number, word in words.items() if abs(share / number - 1) < 0.02)
    return f"{next(near, f'{share:.2g} times')} as hard"


def _presses(count: int) -> str:
    """Return a number of presses in words.

    >>> _presses(1), _presses(10)
    ('press', '10 presses')
    """
    return "press" if count == 1 else f"{count} presses"


def _two_radii(presses: Presses, most_n: float, settings: PlanSettings) -> Presses:
    """Return the presses with a small and a large tip in turns."""
    turns = np.where(np.arange(len(presses)) % 2 == 0, *settings.radii)
    radius = turns * float(np.median(presses.radius_m))
    # Forces in proportion, so that all go about as deep as before
    force = np.minimum(presses.force_n * radius / presses.radius_m, most_n)
    return replace(presses, radius_m=radius, force_n=force)


def _released(readings: Readings) -> float:
    """Return the share of a press's largest force at which its readings end, the middle one's.

    A robot notes no reading as the tip leaves. At no force at all laws of contact differ most.
    """
    back = readings.phase == "unload"
    if not back.any():
        return 0.0
    share = np.full(readings.presses, np.inf)
    np.minimum.at(share, readings.press[back], (readings.force_n / readings.peak_force_n)[back])
    return float(np.clip(np.median(share[np.isfinite(share)]), 0.0, 0.9))


def _typical_span(readings: Readings, rows: np.ndarray) -> float:
    """Median duration of a phase in a press, its first step included."""
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
